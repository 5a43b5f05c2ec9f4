"""Scenarios: what files say, and how they are refused."""

import re
from dataclasses import asdict, replace

import pytest
import yaml

from glassgait.diagrams.commands import DrawnCommands, FixedCommand, SliderCommand
from glassgait.diagrams.scenario import (
    SCENARIO_DIRECTORY,
    SCENARIO_GROUPS,
    Pushes,
    Scenario,
    load_scenario,
    load_scenarios,
    scenario_names,
)
from glassgait.diagrams.station import StationConfig
from glassgait.models.errors import InputError
from glassgait.models.estimation.imu import ImuErrors
from glassgait.models.task.randomization import NOMINAL
from glassgait.models.task.reward import RewardWeights
from glassgait.models.task.termination import TerminationLimits
from glassgait.models.task.terrain import Terrain

SHIPPED = {
    "training": Scenario(),
    "sap_2ms": Scenario("SAP 2 ms", StationConfig(time_step=0.002), max_robots=10),
    "similar_1ms": Scenario("similar 1 ms", StationConfig(0.001, "similar"), max_robots=6),
    "lagged_0.5ms": Scenario("lagged 0.5 ms", StationConfig(0.0005, "lagged"), max_robots=4),
    "cenic_1e-5": Scenario("CENIC 1e-5", StationConfig(0.0), accuracy=1e-5, max_robots=1),
    "friction_0.5": Scenario("friction 0.5", StationConfig(friction=0.5)),
    "friction_1.25": Scenario("friction 1.25", StationConfig(friction=1.25)),
    "push_0.5": Scenario("pushes of 0.5 m/s", pushes=Pushes(0.5)),
    "push_1.0": Scenario("pushes of 1 m/s", pushes=Pushes(1.0)),
    "payload_2kg": Scenario("trunk + 2 kg", StationConfig(payload=2.0)),
    "true_body_state": Scenario("true body state", true_body_state=True),
    "latency_10ms": Scenario("each action 10 ms late", latency=0.01),
    "latency_20ms": Scenario("each action 20 ms late", latency=0.02),
    "weak_motors": Scenario("motors at 80 %", StationConfig(motor_strength=0.8)),
    "strong_motors": Scenario("motors at 120 %", StationConfig(motor_strength=1.2)),
    "soft_gains": Scenario("joint gains at 80 %", StationConfig(stiffness=32.0, damping=0.8)),
    "stiff_gains": Scenario("joint gains at 120 %", StationConfig(stiffness=48.0, damping=1.2)),
    "rotor_inertia": Scenario("rotors of 0.01 kg·m²", StationConfig(armature=0.01)),
    "payload_front": Scenario(
        "2 kg, 10 cm ahead", StationConfig(payload=2.0, payload_position=(0.1, 0.0, 0.0))
    ),
    "soft_ground": Scenario(
        "soft ground", StationConfig(ground_stiffness=5000.0, relaxation_time=0.03)
    ),
    "slope_5deg": Scenario("slope of 5°", StationConfig(terrain=Terrain(slope=5.0))),
    "slope_10deg": Scenario("slope of 10°", StationConfig(terrain=Terrain(slope=10.0))),
    "contact_flips": Scenario("1 % of contacts misread", contact_flips=0.01),
    "mujoco": Scenario("MuJoCo 2 ms", StationConfig(time_step=0.002, engine="mujoco")),
}


GROUNDS = {
    "patches": Terrain(patches=0.33, patch_friction=0.4),
    "steps_5cm": Terrain("steps", height=0.05),
    **{f"slope_{angle}": Terrain(slope=float(angle)) for angle in (10, 15, 20, 25)},
    "slope_10_mujoco": Terrain(slope=10.0),
    **{
        f"{kind}_{cm}cm{engine}": Terrain(kind, amplitude=cm / 100)
        for kind in ("blocks", "uneven")
        for cm in (4, 6)
        for engine in ("", "_mujoco")
    },
    **{
        f"{way}_{cm}cm": Terrain("steps", height=sign * cm / 100, endless=True)
        for way, sign in (("up", 1), ("down", -1))
        for cm in (5, 8, 10)
    },
}
MUJOCO = {"engine": "mujoco", "time_step": 0.002}
CLIMB = FixedCommand(0.4, 0.0, 8)
HARSH = {
    "payload_4kg": Scenario("trunk + 4 kg", StationConfig(payload=4.0)),
    "latency_30ms": Scenario("each action 30 ms late", latency=0.03),
    "slippery_late_loaded": Scenario(
        "friction 0.4, 20 ms late, + 2 kg", StationConfig(friction=0.4, payload=2.0), latency=0.02
    ),
    "push_2.0": Scenario("pushes of 2 m/s every 5 s", pushes=Pushes(2.0, 5.0)),
    "front_stuck_open": Scenario("contact sensor of FL stuck open", stuck_open=("FL",)),
    "front_stuck_closed": Scenario("contact sensor of FL stuck closed", stuck_closed=("FL",)),
    "rear_stuck_open": Scenario("contact sensor of RL stuck open", stuck_open=("RL",)),
    "rear_stuck_closed": Scenario("contact sensor of RL stuck closed", stuck_closed=("RL",)),
}


def test_shipped_scenarios_are_what_their_names_say():
    assert {name: load_scenario(name) for name in scenario_names()} == SHIPPED
    assert scenario_names()[0] == "training"
    assert load_scenarios(["harsh"]) == HARSH


def test_shipped_grounds_are_what_their_names_say():
    grounds = load_scenarios(["grounds"])
    assert {name: world.station.terrain for name, world in grounds.items()} == GROUNDS
    for name, world in grounds.items():
        own = Scenario(
            world.title,
            StationConfig(terrain=GROUNDS[name], **(MUJOCO if name.endswith("mujoco") else {})),
            heading=180.0 if name.startswith("slope") else 0.0,
        )
        assert world == (replace(own, command=CLIMB) if GROUNDS[name].endless else own)


def test_the_training_file_shows_every_setting_at_its_default():
    shown = yaml.safe_load((SCENARIO_DIRECTORY / "training.yaml").read_text())
    assert shown == Scenario().to_plain()


def test_the_default_is_the_world_that_evaluations_had():
    assert Scenario().randomization() == NOMINAL
    assert not Scenario().names_a_command


@pytest.fixture
def written(tmp_path):
    """Writes a person's own file."""

    def write(text, name="icy.yaml"):
        path = tmp_path / name
        path.write_text(text)
        return path

    return write


def test_a_file_says_only_what_differs_from_training(written):
    path = written("station: {friction: 0.3}\n")
    assert load_scenario(path) == Scenario("icy", StationConfig(friction=0.3))
    assert load_scenario(str(path)) == load_scenario(path)


EVERYTHING = Scenario(
    title="everything, at once",
    station=StationConfig(0.005, "lagged", 0.7, 1.5, 0.02),
    heading=45.0,
    sensor_noise=0.5,
    encoder_bias=0.02,
    imu=ImuErrors(gyroscope_bias=0.1, delay=2),
    stuck_open=("FL",),
    stuck_closed=("RL", "RR"),
    latency=0.03,
    pushes=Pushes(0.3, 7.5),
    true_body_state=True,
    max_robots=3,
    weights=RewardWeights(torque=-1e-5, air_time=2.0),
    limits=TerminationLimits(trunk_height=0.15, shank_share=0.8),
)


@pytest.mark.parametrize(
    "scenario",
    [
        *SHIPPED.values(),
        EVERYTHING,
        Scenario(command=FixedCommand(0.25, -0.1, 7)),
        Scenario(command=DrawnCommands((0.0, 0.75))),
        Scenario(command=SliderCommand()),
    ],
    ids=lambda scenario: scenario.title,
)
def test_a_scenario_written_as_plain_values_is_loaded_as_the_same(scenario, tmp_path):
    path = tmp_path / "saved.yaml"
    path.write_text(yaml.safe_dump(scenario.to_plain()))
    assert load_scenario(path) == scenario
    assert load_scenario(path).digest() == scenario.digest()


def test_every_setting_is_in_the_digest():
    digests = {SHIPPED["training"].digest()}
    for name, value in asdict(EVERYTHING).items():
        if value != asdict(Scenario())[name]:
            digests.add(replace(Scenario(), **{name: getattr(EVERYTHING, name)}).digest())
    digests.add(Scenario(command=FixedCommand()).digest())
    digests.add(SHIPPED["cenic_1e-5"].digest())
    assert len(digests) == 17


@pytest.mark.parametrize(
    ("text", "key"),
    [
        ("frictoin: 0.3", "unknown key 'frictoin'; remove it"),
        ("gravity: 3", "gravity"),
        ("stations: {}", "'stations'; write 'station'"),
        ("station: {frictoin: 0.3}", "station.frictoin"),
        ("station: {friction: ice}", "station.friction"),
        ("station: {friction: -1}", "station.friction"),
        (
            "station: {time_step: -0.01}",
            "station.time_step is -0.01; it must be greater than or equal to 0",
        ),
        ("station: {relaxation_time: -1}", "station.relaxation_time"),
        ("station: {payload: -1}", "station.payload"),
        ("station: {payload: .nan}", "station.payload"),
        ("station: {dissipation: -1}", "station.dissipation"),
        ("station: {stiffness: -1}", "station.stiffness"),
        ("station: {damping: -1}", "station.damping"),
        ("station: {armature: -1}", "station.armature"),
        ("station: {contact_solver: tamsi}", "station.contact_solver"),
        ("station: 3", "station"),
        ("station: {time_step: 0.015}", "time_step"),
        ("station: {time_step: 1.0e-7}", "time_step"),
        ("station: {time_step: 5.0e-324}", "2000 steps"),
        ("station: {time_step: 0}", "station.time_step is 0"),
        ("station: {slope: 60}", "slope"),
        ("station: {motor_strength: 0}", "motor_strength"),
        ("station: {ground_stiffness: 5}", "ground_stiffness"),
        ("station: {payload_position: [0, 0]}", "payload_position"),
        ("station: {engine: bullet}", "engine"),
        ("station: {contact_force: 5}", "contact_force"),
        ("station: {contact_time: 0.02}", "contact_time"),
        ("station: {engine: mujoco, contact_time: 0}", "contact_time"),
        ("station: {slope: 5}", "station.slope"),
        ("station: {terrain: {kind: ice}}", "station.terrain.kind"),
        ("station: {terrain: {kind: blocks, cell: 0}}", "station.terrain.cell"),
        ("station: {terrain: {kind: blocks, amplitude: .nan}}", "station.terrain.amplitude"),
        ("station: {terrain: {kind: steps, height: 0.5}}", "height"),
        ("station: {terrain: {height: 0.07}}", "height"),
        ("station: {terrain: {amplitude: 0.04}}", "amplitude has no effect on a plane; give kind"),
        ("station: {terrain: {slope: 3, wavelength: 1.0}}", "wavelength"),
        ("station: {terrain: {cells: 4}}", "cells has no effect on a plane without patches"),
        ("station: {terrain: {kind: plane, cell: 0.5}}", "cell"),
        ("station: {terrain: {direction: 90}}", "direction has no effect without slope"),
        ("station: {terrain: {kind: blocks, patch_friction: 0.1}}", "patch_friction"),
        ("station: {terrain: {kind: steps, hight: 0.05}}", "station.terrain.hight"),
        ("{station: {terrain: {kind: steps}, time_step: 0}, accuracy: 1.0e-3}", "terrain.kind"),
        ("station: {engine: mujoco, contact_solver: lagged}", "contact_solver"),
        ("accuracy: 1.0e-3", "accuracy"),
        ("accuracy: 1e-3", "write it as 1.0e-5"),
        ("{station: {time_step: 0}, accuracy: 1.0e-3, pushes: {speed: 1}}", "pushes.speed"),
        ("pushes: {speed: .inf}", "speed"),
        ("true_body_state: 1", "true_body_state"),
        ("max_robots: 0", "max_robots"),
        ("title: 5", "title"),
        ("title: ''", "title"),
        ("latency: 0.005", "latency"),
        ("latency: 0.05", "latency"),
        ("encoder_bias: -0.01", "encoder_bias"),
        ("encoder_bias: .nan", "encoder_bias"),
        ("encoder_bias: 2", "encoder_bias"),
        ("imu: 1", "imu"),
        ("imu: {gyro_bias: 1}", "'imu.gyro_bias'"),
        ("imu: {gyroscope_bias: -1}", "gyroscope_bias"),
        ("imu: {accelerometer_bias: .nan}", "accelerometer_bias"),
        ("imu: {attitude_bias: 2}", "attitude_bias"),
        ("imu: {delay: 6}", "delay"),
        ("imu: {delay: 0.5}", "delay"),
        ("latency: -0.01", "latency"),
        ("contact_flips: 1.5", "contact_flips"),
        ("heading: 200", "heading"),
        ("stuck_open: [XL]", "stuck_open"),
        ("stuck_closed: [FL, FL]", "stuck_closed"),
        ("stuck_open: [FL]\nstuck_closed: [FR, FL]", "stuck_closed"),
        ("command: {speed: fast}", "speed is 'fast'"),
        ("command: {sped: 1}", "'sped'; write 'speed'"),
        ("command: {speed_range: [1, 0]}", "speed_range"),
        ("command: {speed_range: [0, 1], speed: 1}", "'speed'"),
        ("command: {sliders: false}", "sliders"),
        ("command: sliders", "command"),
        ("station: &a {friction: 1}", "anchors"),
        ("pushes: !Pushes {speed: 1}", "tags"),
        ("max_robots: 1\nmax_robots: 2", "max_robots"),
        ("- 1", "mapping"),
        ("", "mapping"),
    ],
)
def test_a_bad_file_is_refused_by_its_name_and_key(written, text, key):
    path = written(text)
    with pytest.raises(InputError, match=re.escape(key)) as refused:
        load_scenario(path)
    message = str(refused.value)
    assert message.startswith((f"{path}: ", "scenario 'icy'"))
    assert message.isprintable()


@pytest.mark.parametrize(
    "terrain",
    [
        "{patches: 0.3, cells: 4, patch_friction: 0.2}",
        "{slope: 3, direction: 90}",
        "{kind: plane, amplitude: 0.04, height: 0.05}",
    ],
)
def test_keys_that_have_an_effect_or_list_all_of_a_named_kind_are_taken(written, terrain):
    ground = load_scenario(written(f"station: {{terrain: {terrain}}}\n")).station.terrain
    assert {key: getattr(ground, key) for key in yaml.safe_load(terrain)} == yaml.safe_load(terrain)


def test_unknown_names_are_refused_with_the_known_ones(tmp_path):
    with pytest.raises(InputError, match="ice"):
        load_scenario("ice")
    with pytest.raises(InputError, match=r"icy\.yaml"):
        load_scenario(tmp_path / "icy.yaml")
    with pytest.raises(InputError, match="rename"):
        load_scenario(tmp_path / f"{'a' * 81}.yaml")


def test_a_file_named_like_a_shipped_scenario_must_be_it(written):
    whole = (SCENARIO_DIRECTORY / "training.yaml").read_text()
    assert load_scenario(written(whole, "training.yaml")) == Scenario()
    with pytest.raises(InputError, match="training"):
        load_scenario(written("station: {friction: 0.3}", "training.yaml"))


def test_scenarios_are_distinguished_by_their_names(written, tmp_path):
    icy = written("station: {friction: 0.3}")
    (tmp_path / "other").mkdir()
    other = written("station: {friction: 0.2}", "other/icy.yaml")
    assert list(load_scenarios(["all"])) == list(scenario_names())
    assert list(load_scenarios([str(icy), "training"])) == ["icy", "training"]
    assert list(load_scenarios(["training", "all", str(icy)])) == [*scenario_names(), "icy"]
    with pytest.raises(InputError, match=r"other/icy\.yaml"):
        load_scenarios([str(icy), str(other)])


@pytest.mark.parametrize(
    "settings", [{"sensor_noise": -1.0}, {"command": 0.5}, {"accuracy": 1e-20}, {"title": "a\nb"}]
)
def test_settings_out_of_range_are_refused_in_python(settings):
    with pytest.raises(InputError, match="|".join(settings)):
        Scenario(**settings)


def test_the_page_shows_what_ships_and_a_file_that_is_read(written):
    page = (SCENARIO_DIRECTORY / "README.md").read_text()
    table = page.partition("## What ships")[2].partition("##")[0]
    assert set(re.findall(r"`(\w[^`]*)`", table)) >= {
        name for group in SCENARIO_GROUPS for name in scenario_names(group)
    }
    own = written(page.partition("```yaml\n")[2].partition("```")[0])
    assert load_scenario(own) == Scenario("sheer ice", StationConfig(friction=0.3))


def test_scenarios_of_one_title_are_refused(tmp_path):
    for name, friction in (("one", 0.3), ("two", 0.4)):
        (tmp_path / f"{name}.yaml").write_text(f"title: x\nstation: {{friction: {friction}}}\n")
    with pytest.raises(InputError, match="title"):
        load_scenarios([str(tmp_path / "one.yaml"), str(tmp_path / "two.yaml")])

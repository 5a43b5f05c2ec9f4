"""Scenarios: files, and how they are refused."""

import re

import pytest
import yaml

from glassgait.diagrams.commands import DrawnCommands, FixedCommand, SliderCommand
from glassgait.diagrams.scenario import (
    SCENARIO_DIRECTORY,
    SCENARIO_GROUPS,
    Scenario,
    load_scenario,
    load_scenarios,
    scenario_names,
)
from glassgait.diagrams.station import StationConfig
from glassgait.models.errors import InputError
from glassgait.models.estimation.sensors import ImuErrors
from glassgait.models.task.randomization import NOMINAL
from glassgait.models.task.termination import TerminationLimits
from glassgait.studies.common.run import to_plain


@pytest.fixture
def written(tmp_path):
    """Writes a scenario file."""

    def write(text, name="icy.yaml"):
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(text)
        return path

    return write


def test_shipped_scenarios_load_in_groups():
    assert scenario_names()[0] == "nominal"
    shipped = load_scenarios(list(SCENARIO_GROUPS))
    assert len(shipped) > 50
    assert shipped["slope_10_mujoco"].station.engine == "mujoco"
    assert shipped["push_2.0"].push_speed == 2.0


def test_the_nominal_file_shows_every_setting_at_its_default():
    shown = yaml.safe_load((SCENARIO_DIRECTORY / "nominal.yaml").read_text())
    assert shown == to_plain(Scenario())
    assert Scenario().randomization() == NOMINAL


def test_a_file_says_only_what_differs_from_nominal(written):
    path = written("station: {friction: 0.3}\n")
    assert load_scenario(path) == Scenario("icy", StationConfig(friction=0.3))
    assert load_scenario(str(path)) == load_scenario(path)


EVERYTHING = Scenario(
    title="everything, at once",
    station=StationConfig(0.005, "lagged", 0.7, 1.5, 0.02),
    imu=ImuErrors(gyroscope_bias=0.1, delay=2),
    stuck_closed=("RL", "RR"),
    latency=0.03,
    true_body_state=True,
    limits=TerminationLimits(trunk_height=0.15, shank_share=0.8),
)


@pytest.mark.parametrize(
    "scenario",
    [
        EVERYTHING,
        Scenario(command=FixedCommand(0.25, -0.1, 7)),
        Scenario(command=DrawnCommands((0.0, 0.75))),
        Scenario(command=SliderCommand()),
    ],
)
def test_a_scenario_written_as_plain_values_is_loaded_as_the_same(scenario, written):
    loaded = load_scenario(written(yaml.safe_dump(to_plain(scenario))))
    assert loaded == scenario
    assert loaded.digest() == scenario.digest() != Scenario().digest()


@pytest.mark.parametrize(
    ("text", "key"),
    [
        ("frictoin: 0.3", "unknown key 'frictoin'; remove it"),
        ("station: {frictoin: 0.3}", "station.frictoin"),
        ("station: {time_step: 0.015}", "time_step"),
        ("station: {time_step: 0}", "station.time_step is 0"),
        ("station: {contact_force: 5}", "contact_force"),
        ("station: {engine: mujoco, contact_solver: lagged}", "contact_solver"),
        ("station: {terrain: {kind: steps, height: 0.5}}", "height"),
        ("title: ''", "title"),
        ("latency: 0.005", "latency"),
        ("imu: {gyro_bias: 1}", "'imu.gyro_bias'"),
        ("stuck_open: [FL]\nstuck_closed: [FR, FL]", "stuck_closed"),
        ("command: {speed_range: [0, 1], speed: 1}", "'speed'"),
        ("- 1", "mapping"),
    ],
)
def test_a_bad_file_is_refused_by_its_name_and_key(written, text, key):
    path = written(text)
    with pytest.raises(InputError, match=re.escape(key)) as refused:
        load_scenario(path)
    message = str(refused.value)
    assert message.startswith((f"{path}: ", "scenario 'icy'"))
    assert message.isprintable()


def test_unknown_names_are_refused_with_the_known_ones(tmp_path):
    for name, message in (("ice", "nominal"), (tmp_path / "icy.yaml", r"icy\.yaml")):
        with pytest.raises(InputError, match=message):
            load_scenario(name)


def test_scenarios_are_distinguished_by_their_names_and_titles(written):
    icy, other = written("station: {friction: 0.3}"), written("title: x", "other/icy.yaml")
    assert list(load_scenarios(["nominal", "all", str(icy)])) == [*scenario_names(), "icy"]
    with pytest.raises(InputError, match=r"other/icy\.yaml"):
        load_scenarios([str(icy), str(other)])
    same = written("{title: x, latency: 0.01}", "same.yaml")
    with pytest.raises(InputError, match="title"):
        load_scenarios([str(other), str(same)])
    with pytest.raises(InputError, match="nominal"):
        load_scenario(written("station: {friction: 0.3}", "nominal.yaml"))

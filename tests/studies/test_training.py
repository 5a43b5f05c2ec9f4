"""Training: resuming, records, and what goes wrong."""

import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from shutil import copytree

import numpy as np
import pytest
import torch
import yaml

from glassgait.diagrams.domain_randomization import (
    DomainRandomization,
    GroupRanges,
    TerrainRanges,
)
from glassgait.models.errors import InputError
from glassgait.models.files import load_arrays
from glassgait.models.policies.library import EXPERT_DIRECTORY, load_policy
from glassgait.models.robots.joint_law import JointLaw
from glassgait.models.robots.library import load_robot
from glassgait.models.task.gait import GAIT_DIRECTORY, load_gait
from glassgait.models.task.observation import ObservationLayout
from glassgait.models.task.symmetry import REFLECT_JOINTS, mirrored_states, reflect_observation
from glassgait.studies.common.run_folder import CHECKPOINT_NAME
from glassgait.studies.training.config import CurriculumConfig, PpoConfig, TrainingConfig
from glassgait.studies.training.mirror import Mirrored
from glassgait.studies.training.record import read_config, trainings
from glassgait.studies.training.study import TrainingRun

A1 = load_robot()


TINY = TrainingConfig(
    updates=4,
    n_robots=8,
    worlds=DomainRandomization(n_groups=2, fine_steps=(0.005,)),
    friction_updates=2,
    checkpoint_updates=2,
    ppo=PpoConfig(steps_per_update=8, actor_layers=(16,), critic_layers=(16,), epochs=2),
)

KILLED = """
import os, signal, sys
from pathlib import Path
from glassgait.models.task.gait import load_gait
from glassgait.studies.training.study import TrainingRun
sys.path.insert(0, sys.argv[2])
from test_training import TINY

def report(run, row):
    if run.progress.update == 3:
        os.kill(os.getpid(), signal.SIGKILL)

TrainingRun(TINY, load_gait("trot"), Path(sys.argv[1])).run(report)
"""


def training_run(config, folder, **resume):
    return TrainingRun(config, load_gait(config.gait), folder, **resume)


def silent(run, row):
    pass


def weights(folder):
    return load_arrays(folder / "trot.safetensors")[0]


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    """A folder of a run that ended. Tests that go on with it copy it."""
    folder = tmp_path_factory.mktemp("trained")
    training_run(TINY, folder).run(silent)
    return folder


def test_entropy_and_divergence_fall_as_scheduled(tmp_path):
    schedule = replace(
        TINY.ppo,
        entropy=0.01,
        final_entropy=0.001,
        entropy_decay=(0, 3),
        final_kl=0.002,
        kl_decay=(1, 3),
    )
    run = training_run(replace(TINY, ppo=schedule), tmp_path)
    seen = []
    run.run(
        lambda run, row: seen.append((run.learner.ppo.entropy_coef, run.learner.ppo.desired_kl))
    )
    assert [entropy for entropy, _ in seen] == pytest.approx([0.01, 0.007, 0.004, 0.001])
    assert [divergence for _, divergence in seen] == pytest.approx([0.01, 0.01, 0.006, 0.002])


@pytest.mark.slow
def test_a_run_killed_and_resumed_ends_with_the_same_weights(trained, tmp_path):
    killed = tmp_path / "killed"
    here = str(Path(__file__).parent)
    ended = subprocess.run(
        [sys.executable, "-c", KILLED, str(killed), here], check=False, capture_output=True
    )
    assert ended.returncode == -signal.SIGKILL, ended.stderr.decode()
    resumed = training_run(TINY, killed, resume=True)
    assert resumed.progress.update == 2
    resumed.run(silent)
    whole, again = weights(trained), weights(killed)
    assert whole.keys() == again.keys()
    for name, value in whole.items():
        np.testing.assert_array_equal(value, again[name], err_msg=name)


def test_checkpoints_hold_everything(tmp_path):
    run = training_run(TINY, tmp_path)
    run.update()
    run.save()
    again = training_run(TINY, tmp_path, resume=True)
    for mine, theirs in ((run.learner, again.learner), (run.environment, again.environment)):
        arrays, values = mine.to_arrays()
        found_arrays, found_values = theirs.to_arrays()
        assert values == found_values
        assert arrays.keys() == found_arrays.keys()
        for name, value in arrays.items():
            np.testing.assert_array_equal(value, found_arrays[name], err_msg=name)


@pytest.mark.parametrize(
    ("gait", "mirrored", "states"),
    [("trot", True, (1, 0)), ("walk", True, (2, 3, 0, 1)), ("trot", False, None)],
)
def test_the_expert_acts_as_the_network_that_was_trained(gait, mirrored, states, tmp_path):
    config = replace(TINY, gait=gait, mirrored=mirrored, senses="learned")
    run = training_run(config, tmp_path)
    run.update()
    run.save()
    policy = load_policy(tmp_path / f"{gait}.safetensors")
    assert policy.mirrored_states == states
    observations = run.environment.observe()
    with torch.no_grad():
        expected = run.learner.ppo.actor(observations).numpy()
        estimate = run.estimator(observations["proprioception"]).numpy()
    own = observations["proprioception"].numpy().astype(float)
    np.testing.assert_allclose(policy.estimator(own), estimate, atol=1e-5)
    seen = np.concatenate([own, estimate.astype(float)], axis=1)
    np.testing.assert_allclose(policy(seen), expected, atol=1e-5)


@pytest.mark.parametrize("limited", [True, False])
def test_an_expert_says_whether_it_learned_with_limited_targets(limited, tmp_path):
    station = replace(TINY.worlds.station, stiffness=40.0, damping=1.0)
    worlds = replace(TINY.worlds, station=station)
    run = training_run(replace(TINY, limit_targets=limited, worlds=worlds), tmp_path)
    assert run.environment.simulator.task.joint_law == JointLaw((40.0, 1.0), limited)
    run.update()
    run.save()
    expert = load_policy(tmp_path / "trot.safetensors")
    law = JointLaw((40.0, 1.0), limited)
    assert expert.joint_law == (law.with_limits(expert.robot) if limited else law)


@pytest.mark.parametrize("mirrored", [True, False])
def test_a_trained_experts_image_acts_as_it_does_only_if_it_is_mirrored(mirrored, tmp_path):
    run = training_run(replace(TINY, mirrored=mirrored), tmp_path)
    run.update()
    run.save()
    policy = load_policy(tmp_path / "trot.safetensors")
    reflect = reflect_observation(policy.observation_names, mirrored_states(load_gait("trot")))
    seen = run.environment.simulator.observe()
    difference = np.abs(REFLECT_JOINTS(policy(reflect(seen))) - policy(seen)).max()
    assert (difference < 1e-12) == mirrored


def random_network(n_in, n_out, size, seed):
    network = torch.nn.Sequential(
        torch.nn.Linear(n_in, 16), torch.nn.ELU(), torch.nn.Linear(16, n_out)
    )
    generator = torch.Generator().manual_seed(seed)
    for parameter in network.parameters():
        torch.nn.init.normal_(parameter, std=size, generator=generator)
    return network.double()


@pytest.mark.parametrize("gait", ["trot", "walk", "half_bound"])
@pytest.mark.parametrize("size", [0.1, 1.0, 10.0])
def test_a_mirrored_network_treats_sides_alike_whatever_its_weights_are(gait, size, generator):
    machine = load_gait(gait)
    names = ObservationLayout(machine.n_states, imu=True).names
    reflect = reflect_observation(names, mirrored_states(machine))
    network = random_network(len(names), 12, size, seed=3)
    mirrored = Mirrored(network, reflect, REFLECT_JOINTS)
    x = generator.normal(size=(20, len(names)))

    def act(module, observations):
        with torch.no_grad():
            return module(torch.from_numpy(observations)).numpy()

    own = act(mirrored, x)
    np.testing.assert_allclose(REFLECT_JOINTS(act(mirrored, reflect(x))), own, rtol=1e-9)
    # What treats sides alike already is left as it is; what does not, is not.
    again = Mirrored(mirrored, reflect, REFLECT_JOINTS)
    np.testing.assert_allclose(act(again, x), own, rtol=1e-9)
    assert not np.allclose(act(network, x), own)


def test_a_gait_that_favours_a_side_trains_without_a_mirror(tmp_path):
    path = tmp_path / "lopsided.yaml"
    text = (GAIT_DIRECTORY / "walk.yaml").read_text()
    path.write_text(text.replace("when: FR & RL & RR & ~FL", "when: RL & RR & ~FL"))
    config = replace(TINY, gait=str(path), updates=1)
    assert config.mirrored
    training_run(config, tmp_path / "run").run(silent)
    assert load_policy(tmp_path / "run" / "lopsided.safetensors").mirrored_states is None


def test_the_record_reports_how_the_expert_was_trained(tmp_path):
    training_run(replace(TINY, updates=2), tmp_path).run(silent)
    record = yaml.safe_load((tmp_path / "trot.yaml").read_text())
    assert record["control_steps"] == 2 * 8 * 8
    assert record["config"]["ppo"]["steps_per_update"] == 8
    assert record["seed"] == 0
    assert len((tmp_path / "trot.csv").read_text().splitlines()) == 3


def test_difficulty_rises_only_while_the_rhythm_is_kept(tmp_path):
    run = training_run(TINY, tmp_path)
    run._raise_demands(0.4, 0.0)
    assert run.environment.simulator.difficulty == pytest.approx(0.2)
    run._raise_demands(0.6, 0.0)
    assert run.environment.simulator.difficulty == pytest.approx(0.22)
    for _ in range(100):
        run._raise_demands(0.6, 0.0)
    assert run.environment.simulator.difficulty == 1.0


def test_hardship_rises_once_the_machine_asks_for_all_and_few_fail(tmp_path):
    curriculum = CurriculumConfig(initial_difficulty=0.99, initial_hardship=0.5, hardship_rise=0.1)
    run = training_run(replace(TINY, curriculum=curriculum), tmp_path)
    environment = run.environment
    hardships = []
    for rhythm, failure_rate in ((0.6, 0.0), (0.4, 0.0), (0.6, 0.01), (0.6, 0.0), (0.6, 0.004)):
        run._raise_demands(rhythm, failure_rate)
        hardships.append(environment.hardship)
    assert hardships == pytest.approx([0.5, 0.5, 0.5, 0.6, 0.7])
    _, values = environment.to_arrays()
    assert values["hardship"] == environment.simulator.push_share == environment.hardship


HARDER = replace(
    TINY,
    friction_updates=1,
    worlds=replace(TINY.worlds, groups=GroupRanges(terrains=TerrainRanges(share=1.0))),
    curriculum=CurriculumConfig(initial_hardship=0.2),
)


def test_the_ground_grows_with_the_hardship_and_a_resumed_run_stands_on_the_same(
    tmp_path, monkeypatch
):
    def harder(run, rhythm, failure_rate):
        run.environment.hardship += 0.2

    monkeypatch.setattr(TrainingRun, "_raise_demands", harder)
    whole = training_run(HARDER, tmp_path)
    heights = []
    ground = whole.environment.simulator.physics.ground
    points = np.stack(np.meshgrid(*2 * [np.linspace(-1, 1, 21)], [0.0]), -1).reshape(1, -1, 3)

    def look(run, row):
        ground = run.environment.simulator.physics.ground(8)
        heights.append(np.ptp(ground.height(np.repeat(points, 8, axis=0)), axis=1).max())

    assert not ground(8).is_level
    whole.run(look)
    assert heights[0] < heights[1] < heights[2] < heights[3]
    stopped = tmp_path / "stopped"
    stopped.mkdir()
    training_run(replace(HARDER, updates=2), stopped).run(silent)
    training_run(HARDER, stopped, resume=True).run(look)
    assert heights[4:] == heights[2:4]
    own, other = weights(tmp_path), weights(stopped)
    assert all((own[name] == other[name]).all() for name in own)


def test_level_ground_is_not_laid_anew(tmp_path):
    level = GroupRanges(terrains=TerrainRanges(share=0.0))
    config = replace(TINY, worlds=replace(TINY.worlds, groups=level))
    environment = training_run(config, tmp_path).environment
    physics = environment.simulator.physics
    environment.hardship = 0.5
    environment.draw_worlds()
    assert environment.simulator.physics is physics


def test_an_episode_ends_where_nothing_can_be_earned(unforgiving, tmp_path):
    environment = TrainingRun(TINY, unforgiving, tmp_path).environment
    simulator = environment.simulator
    simulator.reset()
    simulator.state.machine.state[:3] = simulator.task.gait.states.index("missed")
    step = environment.step(torch.zeros(TINY.n_robots, 12))
    assert step.dones.tolist() == [True] * 3 + [False] * 5
    assert not step.time_outs.any()
    assert not step.task.terminated.any()
    assert set(simulator.state.steps[:3]) == {0}


def test_an_experts_record_gives_back_its_settings(tmp_path):
    training_run(replace(TINY, updates=1), tmp_path).run(silent)
    assert read_config(tmp_path / "trot.yaml") == replace(TINY, updates=1)
    shipped = read_config(EXPERT_DIRECTORY / "trot.yaml")
    assert (shipped.worlds.fine_steps, shipped.worlds.mujoco_share) == ((), 0.875)
    assert (shipped.senses, shipped.limit_targets) == ("imu", True)
    assert len(shipped.worlds.stations(A1, np.random.default_rng(0))) == 16
    assert shipped.ppo.actor_layers == (256, 128, 64)


def test_a_record_that_ships_can_be_followed_from_any_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    record = EXPERT_DIRECTORY / "half_bound.yaml"
    start = read_config(record).warm_start
    assert start is not None
    assert load_policy(Path(start)).gait == "half_bound"
    assert trainings(record) == [EXPERT_DIRECTORY / "ground" / "half_bound_first.yaml", record]


def test_a_runs_own_result_is_not_taken_for_what_it_began_as(trained, tmp_path, monkeypatch):
    start = tmp_path / "trot.safetensors"
    start.write_bytes((trained / "trot.safetensors").read_bytes())
    monkeypatch.chdir(tmp_path)
    training_run(replace(TINY, updates=1, warm_start=start.name), Path("out")).run(silent)
    start.unlink()
    assert read_config(tmp_path / "out" / "trot.yaml").warm_start == start.name


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("gait: trot", "has no key 'config'"),
        ("config: {gate: trot}", "unknown key 'gate'"),
        ("config: {seed: many}", "key 'seed' is 'many'; it must be a whole number"),
        ("config: {worlds: {station: {friction: -1.0}}}", "friction'? is -1.0"),
        ("config: [", "not valid YAML"),
    ],
)
def test_bad_records_are_refused(tmp_path, text, message):
    path = tmp_path / "record.yaml"
    path.write_text(text)
    with pytest.raises(InputError, match=message):
        read_config(path)


def test_a_missing_or_damaged_checkpoint_cannot_be_resumed(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        training_run(TINY, tmp_path, resume=True)
    run = training_run(TINY, tmp_path)
    run.update()
    run.save()
    training_run(replace(TINY, updates=9), tmp_path, resume=True)
    for other in (replace(TINY, ppo=PpoConfig()), replace(TINY, seed=1)):
        with pytest.raises(InputError, match="is of another run"):
            training_run(other, tmp_path, resume=True)
    (tmp_path / CHECKPOINT_NAME).write_bytes(b"nonsense")
    with pytest.raises(InputError, match="damaged"):
        training_run(TINY, tmp_path, resume=True)


def test_an_expert_that_was_not_written_is_written_on_resume(trained, tmp_path):
    folder = copytree(trained, tmp_path / "run")
    written = weights(folder)
    for path in folder.glob("trot.*"):
        path.unlink()
    training_run(TINY, folder, resume=True).run(silent)
    assert {path.suffix for path in folder.glob("trot.*")} == {".safetensors", ".yaml", ".csv"}
    for name, value in weights(folder).items():
        np.testing.assert_array_equal(value, written[name], err_msg=name)


@pytest.mark.parametrize("robot", ["a1", pytest.param("go2", marks=pytest.mark.slow)])
def test_an_actor_begins_as_the_expert_it_starts_from_while_its_critic_learns(
    robot, trained, tmp_path
):
    ppo = replace(TINY.ppo, critic_updates=1)
    started = str(trained / "trot.safetensors")
    run = training_run(replace(TINY, robot=robot, warm_start=started, ppo=ppo), tmp_path / "second")
    run.update()
    run.save()
    first, second = weights(trained), weights(tmp_path / "second")
    for name, value in first.items():
        np.testing.assert_array_equal(value, second[name], err_msg=name)
    run.update()
    run.save()
    changed = weights(tmp_path / "second")
    assert any((first[name] != changed[name]).any() for name in first)


@pytest.mark.parametrize(
    ("start", "config", "message"),
    [
        ("students/trot/statewise_linear.safetensors", TINY, "network of an expert"),
        ("experts/walk.safetensors", TINY, "as many states"),
        ("experts/trot.safetensors", TINY, "--ppo.actor-layers 256 128 64"),
        ("experts/trot.safetensors", replace(TINY, senses="odometry"), "the same senses"),
        ("experts/gallop.safetensors", TINY, "gallop"),
        (
            "experts/trot.safetensors",
            replace(TINY, mirrored=False, ppo=PpoConfig(steps_per_update=8)),
            "--no-mirrored",
        ),
    ],
)
def test_refuses_to_start_from_what_does_not_fit(start, config, message, tmp_path):
    path = EXPERT_DIRECTORY.parent / start
    with pytest.raises(InputError, match=message):
        training_run(replace(config, warm_start=str(path)), tmp_path)


def test_a_robot_of_ones_own_learns_on_from_its_own_expert(own_robot, tmp_path):
    config = replace(TINY, robot=own_robot, updates=1)
    training_run(config, tmp_path / "first").run(silent)
    started = str(tmp_path / "first" / "trot.safetensors")
    training_run(replace(config, warm_start=started), tmp_path / "second")


def test_a_run_goes_on_only_from_the_expert_it_started_from(trained, tmp_path):
    started = tmp_path / "start.safetensors"
    started.write_bytes((trained / "trot.safetensors").read_bytes())
    config = replace(TINY, warm_start=str(started))
    training_run(config, tmp_path / "second").run(silent)
    training_run(replace(TINY, seed=1, updates=1), tmp_path / "other").run(silent)
    started.write_bytes((tmp_path / "other" / "trot.safetensors").read_bytes())
    with pytest.raises(InputError):
        training_run(replace(config, updates=6), tmp_path / "second", resume=True)

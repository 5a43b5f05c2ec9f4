"""Training: what is learned, exact resume, records, and what goes wrong."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
import yaml

from glassgait.diagrams.domain_randomization import GroupRanges, TerrainRanges
from glassgait.models.errors import InputError
from glassgait.models.files import load_arrays
from glassgait.models.policies.library import EXPERT_DIRECTORY, load_policy
from glassgait.models.robots.quadruped import LEGS
from glassgait.models.robots.robot import JointLaw
from glassgait.models.task.gait import GAIT_DIRECTORY, load_gait
from glassgait.models.task.observation import REFLECT_JOINTS, entries_of, reflect_observation
from glassgait.models.task.symmetry import mirrored_states
from glassgait.studies.common.run import CHECKPOINT_NAME
from glassgait.studies.common.settings_file import read_settings
from glassgait.studies.distillation.config import DistillationConfig, RefinementConfig
from glassgait.studies.training.config import CurriculumConfig, PpoConfig, TrainingConfig
from glassgait.studies.training.record import recipe, trainings
from glassgait.studies.training.run import TrainingRun


@pytest.fixture
def start(tiny_training):
    """Makes a tiny run, with some other settings."""

    def make(folder, *, resume=False, **settings):
        config = replace(tiny_training, **settings)
        return TrainingRun(config, load_gait(config.gait), folder, resume=resume)

    return make


def weights(folder):
    return load_arrays(folder / "trot.safetensors")[0]


def assert_equal(whole, other):
    assert whole.keys() == other.keys()
    for name, value in whole.items():
        np.testing.assert_array_equal(value, other[name], err_msg=name)


def updated(run):
    """Updates a run once, and returns the expert that it writes."""
    run.update()
    run.write_result()
    return load_policy(run.folder / f"{run.gait.name}.safetensors")


def test_entropy_and_divergence_fall_as_scheduled(start, tiny_training, tmp_path):
    schedule = {"entropy": 0.01, "final_entropy": 0.001, "entropy_decay": (0, 3)}
    schedule |= {"desired_kl": 0.01, "final_kl": 0.002, "kl_decay": (1, 3)}
    run, seen = start(tmp_path, ppo=replace(tiny_training.ppo, **schedule)), []
    for _ in range(4):
        run.update()
        seen.append((run.learner.ppo.entropy_coef, run.learner.ppo.desired_kl))
    assert [entropy for entropy, _ in seen] == pytest.approx([0.01, 0.007, 0.004, 0.001])
    assert [divergence for _, divergence in seen] == pytest.approx([0.01, 0.01, 0.006, 0.002])


@pytest.mark.parametrize("actor", ["dense", "local"])
def test_a_stopped_run_resumes_to_the_same_weights(actor, start, tmp_path):
    whole, stopped = tmp_path / "whole", tmp_path / "stopped"
    start(whole, actor=actor).run()
    start(stopped, actor=actor, updates=2).run()
    start(stopped, actor=actor, resume=True).run()
    assert_equal(weights(whole), weights(stopped))
    # A run may be killed after its last checkpoint and before its result.
    (stopped / "trot.safetensors").unlink()
    start(stopped, actor=actor, resume=True).run()
    assert_equal(weights(whole), weights(stopped))


@pytest.mark.parametrize(("gait", "mirrored"), [("trot", True), ("walk", True), ("trot", False)])
def test_legs_of_a_local_actor_ignore_other_legs(gait, mirrored, start, tmp_path, generator):
    ppo = PpoConfig(steps_per_update=8, actor_layers=(16, 8), critic_updates=1)
    settings = {"gait": gait, "mirrored": mirrored, "actor": "local", "ppo": ppo}
    updated(start(tmp_path / "first", **settings))
    warm_start = str(tmp_path / "first" / f"{gait}.safetensors")
    run = start(tmp_path, warm_start=warm_start, **settings)
    run.update()
    policy = updated(run)
    legs = [entry.leg for entry in entries_of(policy.observation_names)]
    seen, others = generator.normal(size=(2, len(legs)))
    acts = run.learner.ppo.actor.mlp
    slopes = torch.autograd.functional.jacobian(acts, torch.tensor(seen[None]).float())[0, :, 0]
    for i, row in enumerate(slopes.numpy()):
        ignored = [leg not in (None, LEGS[i // 3]) for leg in legs]
        np.testing.assert_array_equal(row == 0.0, ignored)
        assert policy(np.where(ignored, others, seen))[i] == policy(seen)[i]


def test_checkpoints_hold_everything(start, tmp_path):
    run = start(tmp_path, senses="learned")
    run.update()
    run.save()
    again = start(tmp_path, senses="learned", resume=True)
    for mine, theirs in ((run.learner, again.learner), (run.environment, again.environment)):
        arrays, values = mine.to_arrays()
        found_arrays, found_values = theirs.to_arrays()
        assert values == found_values
        assert_equal(arrays, found_arrays)


@pytest.mark.parametrize(
    ("gait", "mirrored", "states", "actor"),
    [
        ("trot", True, (1, 0), "dense"),
        ("walk", True, (2, 3, 0, 1), "local"),
        ("trot", False, None, "dense"),
    ],
)
def test_the_expert_acts_as_the_network_that_was_trained(
    gait, mirrored, states, actor, start, tmp_path
):
    run = start(tmp_path, gait=gait, mirrored=mirrored, actor=actor, senses="learned")
    policy = updated(run)
    assert policy.mirrored_states == states
    observations = run.environment.observe()
    with torch.no_grad():
        expected = run.learner.ppo.actor(observations).numpy()
        estimate = run.estimator(observations["proprioception"]).numpy()
    proprioception = observations["proprioception"].numpy().astype(float)
    np.testing.assert_allclose(policy.estimator(proprioception), estimate, atol=1e-5)
    seen = np.concatenate([proprioception, estimate.astype(float)], axis=1)
    np.testing.assert_allclose(policy(seen), expected, atol=1e-5)
    reflect = reflect_observation(policy.observation_names, mirrored_states(load_gait(gait)))
    difference = np.abs(REFLECT_JOINTS(policy(reflect(seen))) - policy(seen)).max()
    assert (difference < 1e-12) == mirrored


@pytest.mark.parametrize("limited", [True, False])
def test_an_expert_says_whether_it_learned_with_limited_targets(
    limited, start, tiny_training, tmp_path
):
    station = replace(tiny_training.worlds.station, stiffness=40.0, damping=1.0)
    worlds = replace(tiny_training.worlds, station=station)
    run = start(tmp_path, limit_targets=limited, worlds=worlds)
    law = JointLaw((40.0, 1.0), limited)
    assert run.environment.simulator.task.joint_law == law
    expert = updated(run)
    assert expert.joint_law == (law.with_limits(expert.robot) if limited else law)


def test_a_gait_that_favours_a_side_trains_without_a_mirror(start, tmp_path):
    path = tmp_path / "lopsided.yaml"
    text = (GAIT_DIRECTORY / "walk.yaml").read_text()
    path.write_text(text.replace("when: FR & RL & RR & ~FL", "when: RL & RR & ~FL"))
    assert updated(start(tmp_path, gait=str(path))).mirrored_states is None


def test_the_record_gives_back_the_settings(trained, tiny_training):
    record = yaml.safe_load((trained / "trot.yaml").read_text())
    assert record["control_steps"] == 4 * 8 * 8
    assert len((trained / "trot.csv").read_text().splitlines()) == 5
    assert read_settings(TrainingConfig(), trained / "trot.yaml") == tiny_training


def test_demands_rise_only_while_the_rhythm_is_kept_and_few_fail(start, tmp_path, monkeypatch):
    curriculum = CurriculumConfig(initial_difficulty=0.97, initial_hardship=0.5, hardship_rise=0.1)
    run, seen, rates = start(tmp_path, curriculum=curriculum), [], {}
    update = type(run.learner).update
    monkeypatch.setattr(type(run.learner), "update", lambda *given: update(*given) | rates)
    cases = [(0.4, 0.0), (0.6, 0.0), (0.6, 0.0), (0.6, 0.01), (0.6, 0.0), (0.6, 0.004)]
    for rates["rhythm"], rates["failure_rate"] in cases:
        run.update()
        seen.append((run.environment.simulator.difficulty, run.environment.simulator.push_share))
    difficulties, hardships = zip(*seen, strict=True)
    assert difficulties == pytest.approx([0.97, 0.99, 1.0, 1.0, 1.0, 1.0])
    assert hardships == pytest.approx([0.5, 0.5, 0.5, 0.5, 0.6, 0.7])


def test_the_ground_grows_with_the_hardship_and_stays_after_a_resume(
    start, tiny_training, tmp_path
):
    groups = GroupRanges(terrains=TerrainRanges(share=1.0))
    harder = {"friction_updates": 1, "worlds": replace(tiny_training.worlds, groups=groups)}
    points = np.stack(np.meshgrid(*2 * [np.linspace(-1, 1, 21)], [0.0]), -1).reshape(1, -1, 3)

    def height(run):
        ground = run.environment.simulator.physics.ground(8)
        return np.ptp(ground.height(np.repeat(points, 8, axis=0)), axis=1).max()

    run = start(tmp_path, **harder)
    run.update()
    before, run.environment.simulator.push_share = height(run), 0.6
    run.update()
    run.save()
    assert height(run) > 2.0 * before > 0.0
    assert height(start(tmp_path, resume=True, **harder)) == height(run)


def test_the_first_updates_may_do_without_drake(start, tiny_training, tmp_path):
    worlds = replace(tiny_training.worlds, fine_steps=(), mujoco_share=0.5)
    settings = {"curriculum": CurriculumConfig(mujoco_updates=3), "friction_updates": 1}
    run, seen = start(tmp_path, worlds=worlds, **settings), []
    for _ in range(4):
        run.update()
        engines = run.environment.simulator.physics._engines
        seen.append([engine.stations[0].engine for engine in engines])
        run.save()
        run = start(tmp_path, resume=True, worlds=worlds, **settings)
    assert seen == [*[["mujoco"]] * 3, ["mujoco", "drake"]]


def test_an_episode_ends_where_nothing_can_be_earned(unforgiving, tiny_training, tmp_path):
    environment = TrainingRun(tiny_training, unforgiving, tmp_path).environment
    simulator = environment.simulator
    simulator.reset()
    simulator.state.memory.machine.state[:3] = simulator.task.gait.states.index("missed")
    step = environment.step(torch.zeros(tiny_training.n_robots, 12))
    assert step.dones.tolist() == [True] * 3 + [False] * 5
    assert not step.time_outs.any()
    assert not step.task.terminated.any()
    assert set(simulator.state.steps[:3]) == {0}


def test_paths_of_files_and_records_can_be_followed_from_any_folder(tmp_path, monkeypatch):
    mine = tmp_path / "mine.yaml"
    mine.write_text("scenario: ice.yaml")
    assert read_settings(DistillationConfig(), mine).scenario == str(tmp_path / "ice.yaml")
    monkeypatch.chdir(tmp_path)
    config = TrainingConfig(gait="gaits/hop.yaml", warm_start="a.safetensors")
    mine.write_text(yaml.safe_dump({"config": recipe(config)}))
    monkeypatch.chdir("/")
    found = read_settings(TrainingConfig(), mine)
    assert found.gait == str(tmp_path / config.gait)
    assert found.warm_start == str(tmp_path / "a.safetensors")
    record = EXPERT_DIRECTORY / "half_bound.yaml"
    warm_start = read_settings(TrainingConfig(), record).warm_start
    assert warm_start is not None
    assert load_policy(Path(warm_start)).gait == "half_bound"
    assert trainings(record) == [EXPERT_DIRECTORY / "ground" / "half_bound_first.yaml", record]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("study: transfer", "record without settings of a training"),
        ("[trot]", "is not a mapping of settings"),
        ("ppo: {learning_rate: .inf}", "learning_rate"),
        ("config: {gate: trot}", "'gate'"),
        ("config: {seed: many}", "seed"),
        ("config: [", "not valid YAML"),
    ],
)
def test_bad_records_are_refused(tmp_path, text, message):
    path = tmp_path / "record.yaml"
    path.write_text(text)
    with pytest.raises(InputError, match=message):
        read_settings(TrainingConfig(), path)
    with pytest.raises(InputError):
        read_settings(RefinementConfig(), path)


def test_a_missing_or_damaged_checkpoint_is_refused(start, tmp_path):
    with pytest.raises(InputError, match="no such file"):
        start(tmp_path, resume=True)
    run = start(tmp_path)
    run.update()
    run.save()
    start(tmp_path, updates=9, resume=True)
    with pytest.raises(InputError, match="damaged"):
        start(tmp_path, resume=True, ppo=PpoConfig())
    (tmp_path / CHECKPOINT_NAME).write_bytes(b"nonsense")
    with pytest.raises(InputError, match="damaged"):
        start(tmp_path, resume=True)


def test_an_actor_begins_as_another_expert_while_its_critic_learns(
    trained, start, tiny_training, tmp_path
):
    ppo = replace(tiny_training.ppo, critic_updates=1)
    started = tmp_path / "start.safetensors"
    started.write_bytes((trained / "trot.safetensors").read_bytes())
    settings = {"warm_start": str(started), "ppo": ppo}
    run = start(tmp_path, **settings)
    updated(run)
    assert_equal(weights(trained), weights(tmp_path))
    updated(run)
    changed = weights(tmp_path)
    assert any((value != changed[name]).any() for name, value in weights(trained).items())


@pytest.mark.parametrize(
    ("path", "settings", "message"),
    [
        ("students/trot/linear_per_state.safetensors", {}, "network of an expert"),
        ("experts/walk.safetensors", {}, "as many states"),
        ("experts/trot.safetensors", {}, "actor_layers: \\[256, 128, 64\\]"),
        ("experts/trot.safetensors", {"senses": "odometry"}, "the same senses"),
        ("experts/gallop.safetensors", {}, "gallop"),
        ("experts/trot.safetensors", {"mirrored": False, "ppo": PpoConfig()}, "--no-mirrored"),
        ("experts/trot.safetensors", {"actor": "local", "ppo": PpoConfig()}, "--actor dense"),
    ],
)
def test_refuses_to_start_from_what_does_not_fit(path, settings, message, start, tmp_path):
    with pytest.raises(InputError, match=message):
        start(tmp_path, warm_start=str(EXPERT_DIRECTORY.parent / path), **settings)

"""The study of left and right: R² in the mirror, pairs of joints, and what it writes."""

import json

import numpy as np
import pandas as pd
import pytest
from sklearn.metrics import r2_score

from glassgait.models.policies.library import load_expert
from glassgait.models.policies.linear import LinearPolicy
from glassgait.models.robots import quadruped
from glassgait.models.task.gait import GAIT_DIRECTORY, load_gait
from glassgait.models.task.observation import ObservationLayout, machine_state_entries
from glassgait.models.task.symmetry import REFLECT_JOINTS, mirrored_states, reflect_observation
from glassgait.studies.cli import main
from glassgait.studies.distillation.collection import collect_alone
from glassgait.studies.distillation.students.dataset import Dataset
from glassgait.studies.evaluation import symmetry
from glassgait.studies.evaluation.symmetry import (
    drawn_importances,
    left_right_table,
    mirror_r2,
)

NAMES = ObservationLayout(2, imu=True).names
N = len(NAMES)
REFLECT = reflect_observation(NAMES, (1, 0))
SMALL = ["--n-robots", "3", "--n-steps", "10", "--n-samples", "20", "--repeats", "2"]


def linear(weights, names=NAMES, gait="trot"):
    return LinearPolicy(gait, names, weights, np.zeros(quadruped.N_JOINTS))


def samples_of(generator, names=NAMES, robots=6, steps=50):
    observations = generator.normal(size=(robots * steps, len(names)))
    state = machine_state_entries(names)
    n_states = state.stop - state.start
    observations[:, state] = np.eye(n_states)[generator.integers(n_states, size=robots * steps)]
    episodes = np.repeat(np.arange(1, robots + 1), steps)
    return Dataset(observations, np.zeros((robots * steps, 12)), episodes)


def weights_of(*pairs):
    """Weights that are 1 where a joint takes an observation, given by their names."""
    weights = np.zeros((quadruped.N_JOINTS, N))
    for joint, name in pairs:
        weights[quadruped.JOINTS.index(joint), NAMES.index(name)] = 1.0
    return weights


def row_of(policy, generator, joint, observation, side):
    samples = samples_of(generator)
    importances = drawn_importances(policy, samples, generator, n_samples=200, repeats=6)
    table = left_right_table(importances, NAMES, REFLECT)
    table = table.set_index(["joint", "observation", "side"])
    return table.loc[(joint, observation, side)]


@pytest.mark.parametrize("gait", ["trot", "bound", "walk", "half_bound"])
def test_a_policy_that_treats_sides_alike_has_an_r2_of_1(gait, generator):
    machine = load_gait(gait)
    names = ObservationLayout(machine.n_states, imu=True).names
    reflect = reflect_observation(names, mirrored_states(machine))
    weights = generator.normal(size=(12, len(names)))
    image = (weights[REFLECT_JOINTS.index] * REFLECT_JOINTS.sign[:, None])[:, reflect.index]
    alike = linear(0.5 * (weights + image * reflect.sign), names, gait)
    lopsided = linear(weights, names, gait)
    samples = samples_of(generator, names)
    assert mirror_r2(alike, samples, reflect, generator, 20) == pytest.approx((1.0, 1.0, 1.0))
    r2, low, high = mirror_r2(lopsided, samples, reflect, generator, 20)
    assert low < r2 < high < 0.5


def test_r2_is_of_the_mirrored_actions_against_the_own(generator):
    policy = linear(generator.normal(size=(12, N)))
    samples = samples_of(generator)
    own = policy(samples.observations)
    image = REFLECT_JOINTS(policy(REFLECT(samples.observations)))
    found, _, _ = mirror_r2(policy, samples, REFLECT, generator, 2)
    assert found == pytest.approx(r2_score(own, image))
    assert found != pytest.approx(r2_score(image, own))


def test_the_interval_is_of_robots(generator):
    policy = linear(generator.normal(size=(12, N)))
    one = samples_of(generator, robots=1).observations
    alike = Dataset(np.tile(one, (5, 1)), np.zeros((250, 12)), np.repeat(np.arange(1, 6), 50))
    r2, low, high = mirror_r2(policy, alike, REFLECT, generator, 50)
    assert (low, high) == pytest.approx((r2, r2))


PAIRS = [
    ("FL_hip", "DoF Pos FL Hip", "FR_hip", "DoF Pos FR Hip", "DoF Pos Hip", "own"),
    ("FL_hip", "DoF Pos RR Hip", "FR_hip", "DoF Pos RL Hip", "DoF Pos Hip", "other"),
    ("RR_thigh", "Foot Height FL", "RL_thigh", "Foot Height FR", "Foot Height", "other"),
    ("RL_calf", "DoF Vel RL Thigh", "RR_calf", "DoF Vel RR Thigh", "DoF Vel Thigh", "own"),
]


@pytest.mark.parametrize(("joint", "name", "image_joint", "image_name", "merged", "side"), PAIRS)
def test_joints_and_observations_are_paired_by_the_mirror(
    joint, name, image_joint, image_name, merged, side, generator
):
    place = (joint.split("_")[1], merged, side)
    both = linear(weights_of((joint, name), (image_joint, image_name)))
    row = row_of(both, generator, *place)
    assert row["agree"]
    assert row["left_share"] == pytest.approx(0.5, abs=0.1)
    row = row_of(linear(weights_of((joint, name))), generator, *place)
    of_left_leg = " FL" in name or " RL" in name
    assert row["left_share"] == (1.0 if of_left_leg else 0.0)
    assert not row["agree"]


def test_looking_across_is_no_image_of_looking_at_the_own_side(generator):
    policy = linear(weights_of(("FL_hip", "DoF Pos FL Hip"), ("RL_hip", "DoF Pos RR Hip")))
    own, other = (row_of(policy, generator, "hip", "DoF Pos Hip", s) for s in ("own", "other"))
    assert (own["left_share"], other["left_share"]) == (1.0, 0.0)


def test_a_share_of_nothing_is_none(generator):
    policy = linear(weights_of(("FL_hip", "DoF Pos FL Hip")))
    row = row_of(policy, generator, "calf", "Foot Height", "own")
    assert (row["left"], row["right"], row["agree"]) == (0.0, 0.0, True)
    assert np.isnan(row["left_share"])


def test_every_pair_is_listed_once(generator):
    importances = generator.uniform(size=(3, 12, N))
    table = left_right_table(importances, NAMES, REFLECT)
    assert len(table) == 60
    of_legs = [" FL" in name or " RL" in name for name in NAMES]
    whole = importances.mean(axis=0)[:, of_legs].sum()
    # Each row is the mean of two joints.
    assert 2 * table["left"].sum() == pytest.approx(whole)


def test_importances_are_of_the_policys_own_actions_and_repeat_with_their_seed(generator):
    policy = linear(generator.normal(size=(12, N)))
    samples = samples_of(generator)
    other = Dataset(samples.observations, samples.actions + 9.0, samples.episodes)
    first, again = (
        drawn_importances(policy, own, np.random.default_rng(5), n_samples=40, repeats=2)
        for own in (samples, other)
    )
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first[0], first[1])


def test_the_expert_visits_what_is_measured():
    expert = load_expert("trot")
    samples = collect_alone(load_gait("trot"), expert, expert, n_robots=4, n_steps=6, seed=1)
    assert np.unique(samples.episodes, return_counts=True)[1].tolist() == [6] * 4
    np.testing.assert_allclose(samples.actions, expert(samples.observations), atol=1e-12)


def test_command_writes_tables_and_figure_and_resumes_to_the_same(tmp_path, monkeypatch, refused):
    monkeypatch.setattr(symmetry, "RESAMPLES", 20)
    output = tmp_path / "symmetry"
    policies = ["expert", "sparse_formula"]
    command = ["evaluate", "symmetry", "--gait", "walk", "--policy", *policies, *SMALL]
    command += ["--output", str(output)]
    main(command)
    assert {path.name for path in output.iterdir() if path.name[0] != "."} == {
        "cases", "config.yaml", "metrics.json", "symmetry.csv", "symmetry.md", "symmetry.png",
        "symmetry.pdf", "left_right.csv", "left_right.md",
    }  # fmt: skip
    table = pd.read_csv(output / "symmetry.csv")
    assert table["policy"].tolist() == policies
    assert (table["pairs"] == 60).all()
    left_right = pd.read_csv(output / "left_right.csv")
    assert len(left_right) == 60 * len(table)
    metrics = (output / "metrics.json").read_text()
    assert set(json.loads(metrics, parse_constant=pytest.fail)) == {"symmetry", "left_right"}
    assert "continue it with --resume" in refused(command)
    main([*command, "--resume"])
    assert (output / "metrics.json").read_text() == metrics


@pytest.fixture
def lopsided(tmp_path):
    path = tmp_path / "lopsided.yaml"
    text = (GAIT_DIRECTORY / "walk.yaml").read_text()
    path.write_text(text.replace("when: FR & RL & RR & ~FL", "when: RL & RR & ~FL"))
    return str(path)


def test_a_gait_without_a_mirror_image_is_reported_and_left_out(
    lopsided, tmp_path, capsys, refused
):
    output = tmp_path / "runs"
    some = ["--policy", "gbm", *SMALL, "--output", str(output)]
    main(["evaluate", "symmetry", "--gait", lopsided, "half_bound", *some])
    assert "lopsided.yaml: has no mirror image" in capsys.readouterr().out.replace("\n", "")
    assert [path.name for path in output.iterdir()] == ["half_bound"]
    alone = ["evaluate", "symmetry", "--gait", lopsided, "--output", str(tmp_path / "none")]
    assert "--gait" in refused(alone)
    assert not (tmp_path / "none").exists()


def test_several_gaits_take_no_files_of_ones_own(tmp_path, refused):
    several = ["evaluate", "symmetry", "--gait", "trot", "walk"]
    assert "name one gait for them" in refused([*several, "--source", str(tmp_path)])

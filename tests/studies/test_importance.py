"""Importances: groups, methods, and the table beside the paper's."""

import numpy as np
import pandas as pd
import pytest

from glassgait.models.formulas.grammar import parse_expression, variable_names
from glassgait.models.policies.described import load_described
from glassgait.models.policies.linear import LinearPerStatePolicy, LinearPolicy
from glassgait.models.policies.symbolic import SymbolicPolicy
from glassgait.models.robots import quadruped
from glassgait.models.robots.library import load_robot
from glassgait.models.task.observation import ObservationLayout, machine_state_entries
from glassgait.studies.cli import main
from glassgait.studies.distillation.dataset import Dataset
from glassgait.studies.importance.measures import (
    PAPER_TOP,
    merge_importances,
    observation_groups,
    permutation_importance,
    top_observations,
    top_table,
)

A1 = load_robot()


NAMES = ObservationLayout(2).names
N = len(NAMES)


def linear(weights):
    return LinearPolicy("trot", NAMES, weights, np.zeros(quadruped.N_JOINTS))


def samples_of(policy, generator, count=500):
    observations = generator.normal(size=(count, N))
    observations[:, machine_state_entries(NAMES)] = np.eye(2)[generator.integers(2, size=count)]
    return Dataset(observations, policy(observations), np.ones(count, dtype=np.int64))


def test_groups_hold_every_observation_once():
    groups = observation_groups(NAMES)
    assert sorted(np.concatenate(list(groups.values()))) == list(range(N))
    assert len(groups["DoF Pos Thigh"]) == 4
    np.testing.assert_allclose(merge_importances(np.ones((12, N)), NAMES).sum(axis=1), N)


def test_permutation_finds_what_a_joint_depends_on(generator):
    weights = np.zeros((12, N))
    weights[:, 5], weights[3, 7] = 1.0, 2.0
    policy = linear(weights)
    losses = permutation_importance(policy, samples_of(policy, generator), generator, repeats=3)
    assert losses.shape == (3, 12, N)
    mean = losses.mean(axis=0)
    assert np.argmax(mean, axis=1).tolist() == [5, 5, 5, 7, *[5] * 8]
    assert not np.delete(mean, [5, 7], axis=1).any()


def test_permutation_shuffles_a_frames_entry_in_all_frames_of_a_network(describe, generator):
    weights = np.zeros((141, 12))
    weights[[18, 21]] = 0.1  # the commanded forward speed in the last two frames
    policy = load_described(describe(weights=weights))
    memories = generator.normal(size=(300, policy.n_memory))
    samples = Dataset(memories, policy(memories), np.ones(300, dtype=np.int64))
    names = [*policy.inputs]
    mean = permutation_importance(policy, samples, generator, repeats=2).mean(axis=(0, 1))
    assert names[6] == "command forward" and names[10] == "joint_position FR_thigh"
    assert np.flatnonzero(mean).tolist() == [6]
    assert mean[6] == pytest.approx(2.0, abs=0.3)
    assert len(observation_groups(tuple(names))["last_action thigh"]) == 4


def test_the_machines_state_is_shuffled_as_one(generator):
    seen = []
    entries = machine_state_entries(NAMES)

    class Watched(LinearPolicy):
        def __call__(self, observation):
            seen.append(observation[:, entries])
            return super().__call__(observation)

    weights = np.zeros((12, N))
    weights[:, entries] = [1.0, -1.0]
    policy = Watched("trot", NAMES, weights, np.zeros(12))
    samples = samples_of(policy, generator, count=300)
    mean = permutation_importance(policy, samples, generator, repeats=2).mean(axis=0)
    assert all((states.sum(axis=1) == 1.0).all() for states in seen)
    np.testing.assert_array_equal(mean[:, entries][:, 0], mean[:, entries][:, 1])
    # Of two equally frequent states another sample's is wrong half the time: R² falls from 1 to -1.
    group = merge_importances(mean, NAMES)[0, list(observation_groups(NAMES)).index("RM State")]
    assert group == pytest.approx(2.0, abs=0.3)


def test_slopes_count_with_the_observations_spread(generator):
    names = variable_names(N)
    formula = parse_expression("3 * x2 - x4 * x4", names)
    policy = SymbolicPolicy("trot", NAMES, [[formula] * 12])
    observations = samples_of(policy, generator, 4000).observations
    observations[:, 2] *= 10.0
    method, importances = policy.importance(observations)
    assert method == "derivatives"
    spread = observations.std(axis=0)
    assert importances[0, 2] == pytest.approx(3 * spread[2] / A1.action_scale)
    angle = policy.quantities(observations)[:, 4]
    slope = np.abs(2 * angle).mean() / A1.action_scale
    assert importances[0, 4] == pytest.approx(slope * spread[4])
    assert importances.sum() == pytest.approx(importances[:, [2, 4]].sum())


def test_laws_of_states_count_by_the_time_in_them(generator):
    weights = np.zeros((2, 12, N))
    weights[0, :, 2] = 4.0
    policy = LinearPerStatePolicy("trot", NAMES, weights, np.zeros((2, 12)))
    observations = generator.normal(size=(100, N))
    observations[:, machine_state_entries(NAMES)] = [1.0, 0.0]
    observations[:75, machine_state_entries(NAMES)] = [0.0, 1.0]
    _, found = policy.importance(observations)
    np.testing.assert_allclose(found[:, 2], 0.25 * 4.0 * observations[:, 2].std())


def test_top_observations_merge_legs_and_list_what_any_joint_named():
    importances = np.zeros((12, N))
    for joint in range(12):
        importances[joint, NAMES.index("RM Iters")] = 1.0
        for leg in quadruped.LEGS:
            importances[joint, NAMES.index(f"DoF Pos {leg} Hip")] = 0.5
        importances[joint, NAMES.index("Command X")] = 0.2
    importances[0, NAMES.index("Command X")] = 5.0
    tops = top_observations(importances, NAMES)
    assert tops["thigh"] == [["DoF Pos Hip"], ["RM Iters"], ["Command X"]]
    assert tops["hip"][0] == ["DoF Pos Hip", "Command X"]


def test_agreement_with_the_paper_is_marked():
    importances = np.zeros((12, N))
    for joint in range(12):
        for place, name in enumerate(("Prev Action FL Hip", "RM State 0", "Command Yaw")):
            importances[joint, NAMES.index(name)] = 3.0 - place
    table = top_table(importances, NAMES, "trot", "impurity").set_index("joint type")
    assert table.loc["hip", "1st"] == "Prev Action Hip*"
    assert table.loc["hip", "2nd"] == "RM State*"
    assert table.loc["hip", "3rd"] == "Command Yaw"


def test_the_papers_names_are_observations():
    known = set(observation_groups(NAMES))
    for gaits in PAPER_TOP.values():
        for kinds in gaits.values():
            for places in kinds.values():
                assert set().union(*places) <= known


def test_command_writes_maps_and_tables(distilled, tmp_path):
    small = ["--n-samples", "20", "--repeats", "2", "--source", str(distilled)]
    main(["importance", *small, "--policy", "histogram_gbm", "--output", str(tmp_path)])
    assert (tmp_path / "importances.csv").exists()
    for kind in ("csv", "md", "png", "pdf"):
        assert (tmp_path / f"histogram_gbm_impurity.{kind}").exists()
    table = pd.read_csv(tmp_path / "top_observations.csv")
    assert set(table["method"]) == {"permutation", "impurity"}

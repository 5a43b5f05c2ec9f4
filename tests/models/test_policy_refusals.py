"""Policies that are refused: of another gait or layout, of unknown kind, or impossible."""

import numpy as np
import pytest

from glassgait.models.errors import InputError
from glassgait.models.files import load_arrays, save_arrays
from glassgait.models.policies.library import EXPERT_DIRECTORY, load_expert, load_policy
from glassgait.models.policies.linear import LinearPolicy, StatewiseLinearPolicy
from glassgait.models.policies.neural import Network, NeuralPolicy
from glassgait.models.policies.open_loop import OpenLoopPolicy
from glassgait.models.policies.symbolic import StatewiseSymbolicPolicy, SymbolicPolicy
from glassgait.models.task.gait import GAIT_DIRECTORY, load_gait, parse_gait
from glassgait.models.task.observation import ObservationLayout

NAMES = ObservationLayout(2).names
N = len(NAMES)


def test_policies_refuse_another_gait_or_layout(linear):
    policy = linear
    policy.check(gait="trot", observation_names=NAMES)
    with pytest.raises(InputError, match="trot"):
        policy.check(gait="pace", observation_names=NAMES)
    with pytest.raises(InputError, match="Command X"):
        policy.check(gait="trot", observation_names=("Speed", *NAMES[1:]))
    with pytest.raises(InputError, match=r"49.*51"):
        policy.check(gait="trot", observation_names=(*NAMES, "a", "b"))


def test_files_of_unknown_kind_or_with_parts_missing_are_refused(linear, tmp_path):
    path = tmp_path / "policy.safetensors"
    linear.save(path)
    arrays, header = load_arrays(path)
    save_arrays(path, arrays, header | {"kind": "oracle"})
    with pytest.raises(InputError, match="oracle"):
        load_policy(path)
    save_arrays(path, {}, header)
    with pytest.raises(InputError, match="weights"):
        load_policy(path)
    save_arrays(path, arrays, header | {"format": 99})
    with pytest.raises(InputError, match="format"):
        load_policy(path)


def test_experts_must_be_neural_and_of_the_gait(linear, neural, tmp_path):
    path = tmp_path / "policy.safetensors"
    linear.save(path)
    with pytest.raises(InputError, match="an expert is neural"):
        load_expert("trot", path)
    neural.save(path)
    with pytest.raises(InputError, match="trot"):
        load_expert("walk", path)
    with pytest.raises(InputError, match="amble"):
        load_expert("amble")


def test_arrays_that_no_policy_can_have_are_refused_in_python_as_well(
    neural, symbolic, small_trees, small_additive
):
    zeros = np.zeros
    for make, message in (
        (lambda: LinearPolicy("trot", NAMES, zeros((2, N)), zeros(2)), r"must be \(12, 49\)"),
        (lambda: LinearPolicy("trot", NAMES, zeros((12, N)), zeros((12, 1))), "'intercepts' is of"),
        (lambda: LinearPolicy("trot", NAMES, zeros((12, N), dtype=int), zeros(12)), "type int64"),
        (lambda: StatewiseLinearPolicy("trot", NAMES, zeros((3, 12, N)), zeros((3, 12))), "2, 12"),
        (lambda: OpenLoopPolicy("trot", NAMES, zeros((2, 0, 12))), "iterations, 12"),
        (lambda: OpenLoopPolicy("trot", NAMES, np.full((2, 5, 12), np.nan)), "holds nan"),
        (lambda: small_trees(features=np.full((12, 2, 3), 300)), "holds 300; .* from 0 to 48"),
        (lambda: small_trees(features=np.full((12, 2, 3), -1)), "holds -1"),
        (lambda: small_trees(leaves=zeros((12, 2, 3))), r"must be \(12, 2, 4\)"),
        (lambda: small_trees(thresholds=np.full((12, 2, 3), np.nan)), "holds nan"),
        (
            lambda: small_trees(
                features=zeros((12, 2, 4), dtype=int),
                thresholds=zeros((12, 2, 4)),
                leaves=zeros((12, 2, 5)),
            ),
            "4 inner nodes",
        ),
        (lambda: small_additive(cuts=np.tile([0.0, np.inf, 1.0], (N, 1))), "does not ascend"),
        (lambda: small_additive(pairs=np.array([[0, N]])), "holds 49"),
        (lambda: small_additive(pair_joints=np.array([12])), "holds 12; .* from 0 to 11"),
        (lambda: small_additive(deviations=np.full((12, N, 4), -1.0)), "holds -1"),
        (lambda: NeuralPolicy("trot", NAMES, neural.estimator, neural.estimator), "actor.0.w"),
        (lambda: NeuralPolicy("trot", NAMES, neural.actor, neural.actor), r"must be \(8, 42\)"),
        (lambda: NeuralPolicy("trot", NAMES, Network((), ()), neural.estimator), "lacks the array"),
        (lambda: SymbolicPolicy("trot", NAMES, symbolic.expressions[:2]), "12 joints"),
        (lambda: StatewiseSymbolicPolicy("trot", NAMES, symbolic.expressions), "2 states"),
    ):
        with pytest.raises(InputError, match=message):
            make()
    assert small_trees().depth == 2
    assert small_additive(
        pairs=zeros((0, 2), dtype=int),
        pair_joints=zeros(0, dtype=int),
        pair_tables=zeros((0, 2, 2)),
        pair_deviations=zeros((0, 2, 2)),
    )(zeros(N)).shape == (12,)


def test_names_that_no_policy_can_have_are_refused(open_loop, symbolic):
    weights, intercepts = np.zeros((12, N)), np.zeros(12)
    iterations = NAMES.index("RM Iters")
    for gait, names, message in (
        (5, NAMES, "the gait is of type int"),
        ("", NAMES, "the gait is ''"),
        ("trot", "x" * N, "names of observations"),
        ("trot", (), "names of observations"),
        ("trot", (5, *NAMES[1:]), "observation is of type int"),
        ("trot", (NAMES[1], *NAMES[1:]), "observes 'Command Yaw' twice"),
        ("trot", ("RM State 2", *NAMES[1:]), "in a row"),
        ("trot", ("Clock", *NAMES[1:]), "no observation is called 'Clock'; make the policy anew"),
    ):
        with pytest.raises(InputError, match=message):
            LinearPolicy(gait, names, weights, intercepts)
    without = (*NAMES[:iterations], "Clock", *NAMES[iterations + 1 :])
    with pytest.raises(InputError, match="RM Iters"):
        OpenLoopPolicy("trot", without, open_loop.table)
    with pytest.raises(InputError, match="Clock"):
        SymbolicPolicy("trot", without, symbolic.expressions)


def test_header_fields_of_another_kind_are_refused(linear, tmp_path):
    path = tmp_path / "policy.safetensors"
    linear.save(path)
    arrays, header = load_arrays(path)
    for key, value, message in (
        ("format", True, "not a policy of format 1"),
        ("kind", ["linear"], "'kind' of its header is of type list; it must be text"),
        ("observation_names", "x" * N, "of type str; it must be a list of names"),
        ("values", None, "of type NoneType; it must be a mapping"),
    ):
        save_arrays(path, arrays, header | {key: value})
        with pytest.raises(InputError, match=message) as refused:
            load_policy(path)
        assert str(refused.value).startswith(f"{path}: ")
    save_arrays(path, arrays, header | {"made by": "hand"})
    assert load_policy(path).kind == "linear"


def test_an_expert_of_a_gait_that_has_other_states_now_is_refused(tmp_path):
    whole = (GAIT_DIRECTORY / "trot.yaml").read_text()
    text = whole.replace("states: [q0, q1]", "states: [q0, q1, q2]")
    text += "  - {from: q0, to: q2, when: FL & FR & RL & RR}\n"
    gait = parse_gait(text, name="trot")
    with pytest.raises(InputError, match=r"trot\.safetensors"):
        load_expert(gait, EXPERT_DIRECTORY / "trot.safetensors")
    assert load_expert(load_gait("trot")).gait == "trot"

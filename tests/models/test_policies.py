"""Policies of every kind: their files, actions, explanations and refusals."""

import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from interpret.glassbox import ExplainableBoostingRegressor
from sklearn.ensemble import GradientBoostingRegressor, HistGradientBoostingRegressor

from glassgait.models.errors import InputError
from glassgait.models.estimation.odometry import Odometry
from glassgait.models.files import load_arrays, save_arrays
from glassgait.models.formulas.grammar import parse_formula
from glassgait.models.formulas.quantities import Vocabulary, known_definitions
from glassgait.models.policies.additive import AdditivePolicy
from glassgait.models.policies.boosting import (
    BoostedTreesPolicy,
    lower_neighbours,
    single_precision_cuts,
)
from glassgait.models.policies.library import (
    EXPERT_DIRECTORY,
    load_expert,
    load_policy,
    load_student,
)
from glassgait.models.policies.linear import LinearPerStatePolicy, LinearPolicy
from glassgait.models.policies.neural import Network, NeuralPolicy, elu
from glassgait.models.policies.reading_cost import reading_cost
from glassgait.models.policies.symbolic import SymbolicPerStatePolicy, SymbolicPolicy
from glassgait.models.robots import quadruped
from glassgait.models.robots.library import load_robot
from glassgait.models.robots.robot import JointLaw
from glassgait.models.task.gait import GAIT_DIRECTORY, parse_gait
from glassgait.models.task.observation import ObservationLayout

A1 = load_robot()
NAMES = ObservationLayout(2).names
N = len(NAMES)
KINDS = (
    *("neural", "linear", "per_state", "symbolic", "symbolic_per_state"),
    *("trees", "rounded_trees", "additive"),
)
SUMS = ("linear", "per_state", "symbolic", "symbolic_per_state", "additive")


@pytest.fixture(scope="session")
def boosted_models(samples):
    observations, actions = samples()
    return [
        GradientBoostingRegressor(n_estimators=15, max_depth=3, random_state=j).fit(
            observations, actions[:, j]
        )
        for j in range(quadruped.N_JOINTS)
    ]


@pytest.fixture(scope="session")
def additive_models(samples):
    observations, actions = samples()
    return [
        ExplainableBoostingRegressor(
            feature_types=["continuous"] * N,
            outer_bags=1,
            interactions=j % 3,
            max_rounds=20,
            n_jobs=1,
            random_state=j,
        ).fit(observations, actions[:, j])
        for j in range(quadruped.N_JOINTS)
    ]


@pytest.fixture
def small_trees():
    """Makes a policy of two trees per joint, with some arrays changed."""

    def make(**changes):
        arrays = {
            "features": np.zeros((12, 2, 3), dtype=np.int32),
            "thresholds": np.full((12, 2, 3), np.inf),
            "leaves": np.ones((12, 2, 4)),
            "intercepts": np.zeros(12),
            "importances": np.zeros((12, N)),
        }
        return BoostedTreesPolicy("trot", NAMES, **(arrays | changes))

    return make


@pytest.fixture
def small_additive():
    """Makes an additive policy with four bins and one pair, with some arrays changed."""

    def make(**changes):
        arrays = {
            "cuts": np.tile([0.0, 1.0, np.inf], (N, 1)),
            "pair_cuts": np.tile([0.0], (N, 1)),
            "tables": np.zeros((12, N, 4)),
            "pairs": np.array([[0, 1]]),
            "pair_joints": np.array([3]),
            "pair_tables": np.zeros((1, 2, 2)),
            "deviations": np.zeros((12, N, 4)),
            "pair_deviations": np.zeros((1, 2, 2)),
            "intercepts": np.zeros(12),
        }
        return AdditivePolicy("trot", NAMES, **(arrays | changes))

    return make


@pytest.fixture
def policy_of(request, random_trees, random_additive):
    """Makes a policy of a kind."""

    def make(kind):
        if kind == "additive":
            return random_additive(np.random.default_rng(3), n_pairs=20)
        if kind.endswith("trees"):
            return random_trees(np.random.default_rng(3), rounded=kind == "rounded_trees")
        return request.getfixturevalue(kind)

    return make


@pytest.mark.parametrize("kind", KINDS)
def test_a_file_gives_back_the_same_policy(kind, policy_of, samples, tmp_path):
    policy = policy_of(kind).with_joint_law(JointLaw((40.0, 1.0), limited=True))
    path, rows = tmp_path / f"policy{policy.suffix}", samples(20, seed=5)[0]
    policy.save(path)
    loaded = load_policy(path)
    assert type(loaded) is type(policy)
    assert (loaded.gait, loaded.observation_names) == ("trot", NAMES)
    assert loaded.joint_law == policy.joint_law
    assert policy.digest() != policy_of(kind).digest()
    np.testing.assert_array_equal(loaded(rows), policy(rows))


def test_an_expert_with_odometry_is_saved_with_its_gain(imu_expert, tmp_path):
    path = tmp_path / "expert.safetensors"
    imu_expert.save(path)
    loaded = load_policy(path)
    assert loaded.estimator == Odometry(gain=0.3)
    assert loaded.layout.imu and loaded.observation_names == imu_expert.observation_names
    other = NeuralPolicy("trot", loaded.observation_names, loaded.actor, Odometry(gain=0.2))
    assert other.digest() != loaded.digest()


@pytest.mark.parametrize(
    "change",
    [
        {"values": {"odometry": {"gain": 2.0}}},
        {"joint_law": {"gains": [40]}},
        {"joint_law": {"p": 40}},
        {"format": 99},
        {"kind": "oracle"},
        {"kind": ["neural"]},
        {"observation_names": list(NAMES)},
        {"observation_names": ["Speed", *NAMES[1:]]},
        {"values": None},
        {"robot": "spot"},
    ],
    ids=str,
)
def test_a_header_that_is_not_valid_is_refused(change, imu_expert, tmp_path):
    path = tmp_path / "expert.safetensors"
    imu_expert.save(path)
    arrays, header = load_arrays(path)
    save_arrays(path, arrays, header | change)
    with pytest.raises(InputError, match=rf"^{path}: "):
        load_policy(path)


@pytest.mark.parametrize("real", [np.float16, np.float32])
@pytest.mark.parametrize("whole", [np.uint8, np.uint16, np.int64])
def test_narrow_types_of_numbers_are_taken(real, whole, policy_of, samples, tmp_path):
    for kind in ("linear", "trees", "additive", "neural"):
        policy, path = policy_of(kind), tmp_path / "policy.safetensors"
        policy.save(path)
        arrays, header = load_arrays(path)
        narrow = {
            name: array.astype(real if array.dtype.kind == "f" else whole)
            for name, array in arrays.items()
        }
        save_arrays(path, narrow, header)
        assert load_policy(path)(samples(5)[0]).dtype == np.float64


@pytest.mark.parametrize("kind", ["trees", "rounded_trees", "additive"])
def test_a_compact_policy_is_smaller_and_acts_as_it_is_saved(kind, policy_of, samples, tmp_path):
    policy, rows, sizes = policy_of(kind), samples(200)[0], []
    for number, one in enumerate((policy, policy.compact())):
        path = tmp_path / f"{number}.safetensors"
        one.save(path)
        np.testing.assert_array_equal(load_policy(path)(rows), one(rows))
        sizes.append(path.stat().st_size)
    assert sizes[1] < sizes[0]
    assert 0 < np.abs(policy.compact()(rows) - policy(rows)).max() < 1e-6
    go2 = type(policy)("trot", NAMES, robot=load_robot("go2"), **arrays_of(policy))
    assert go2.compact().robot.name == "go2"


def arrays_of(policy):
    return {name: getattr(policy, name) for name in policy.array_specs}


@given(st.floats(-1e6, 1e6), st.integers(-3, 3), st.sampled_from([-1, 0, 1]))
def test_cuts_divide_doubles_as_rounding_to_single_precision_does(threshold, ulps, nudge):
    cut = single_precision_cuts(np.array(threshold))
    lower = lower_neighbours(cut)
    assert lower is not None
    np.testing.assert_array_equal(single_precision_cuts(lower), cut)
    single = np.float32(threshold)
    for _ in range(abs(ulps)):
        single = np.nextafter(single, np.float32(np.copysign(np.inf, ulps)))
    halfway = 0.5 * (float(single) + float(np.nextafter(single, np.float32(np.inf))))
    for x in (float(single), halfway, threshold, float(cut)):
        value = np.nextafter(x, np.copysign(np.inf, nudge)) if nudge else x
        assert (value <= cut) == (float(np.float32(value)) <= threshold)


@pytest.mark.parametrize("kind", KINDS)
def test_batches_agree_with_single_rows(kind, policy_of, samples):
    policy, rows = policy_of(kind), samples(12, seed=6)[0]
    batch = policy(rows.reshape(3, 4, -1))
    assert batch.shape == (3, 4, 12)
    single = np.array([policy(row) for row in rows])
    np.testing.assert_allclose(batch.reshape(12, 12), single, rtol=0, atol=1e-12)


@pytest.mark.parametrize("kind", KINDS)
def test_an_observation_that_is_not_finite_gives_the_action_nan(kind, policy_of, samples):
    policy, rows = policy_of(kind), samples(4, seed=6)[0]
    rows[1], rows[2, 5], rows[3, -1] = np.nan, np.inf, -np.inf
    actions = policy(rows)
    np.testing.assert_array_equal(actions[0], policy(np.where(np.isfinite(rows), rows, 0.0))[0])
    assert all(
        np.isnan([action, policy(row)]).all()
        for action, row in zip(actions[1:], rows[1:], strict=True)
    )


def test_policies_act_by_their_state(per_state, symbolic_per_state, samples):
    rows, joint = samples(2, seed=4)[0], np.arange(12)
    rows[:, per_state._one_hot] = np.eye(2)
    values = symbolic_per_state.quantities(rows)
    targets = A1.joint_targets(symbolic_per_state(rows))
    for state in range(2):
        expected = per_state.weights[state] @ rows[state] + 1.0
        np.testing.assert_allclose(per_state(rows)[state], expected)
        product = values[state, joint] * values[state, joint + 1 + state]
        np.testing.assert_allclose(targets[state], 1 + state + product)


def test_a_network_is_a_perceptron_with_elu(neural, samples):
    row, actor = samples(1)[0][0], neural.actor
    hidden = elu(actor.weights[0] @ row + actor.biases[0])
    np.testing.assert_allclose(neural(row), actor.weights[1] @ hidden)
    np.testing.assert_allclose(elu(np.array([-1.0, 2.0])), [np.exp(-1) - 1, 2.0])


def test_boosted_trees_equal_scikit_learn(boosted_models, samples):
    rows = samples(1000, seed=8)[0]
    policy = BoostedTreesPolicy.compile("trot", NAMES, boosted_models)
    # Values at thresholds take the same branch as in scikit-learn, which rounds them.
    at = policy.thresholds[np.isfinite(policy.thresholds)][:N]
    rows[0, : len(at)], rows[1, : len(at)] = at, np.nextafter(at, np.inf)
    expected = np.stack([model.predict(rows) for model in boosted_models], axis=1)
    np.testing.assert_allclose(policy(rows), expected, rtol=0, atol=1e-12)
    single = sum(policy.tree_values(rows, 3).T) + policy.intercepts[3]
    np.testing.assert_allclose(single, expected[:, 3], rtol=0, atol=1e-12)


def test_histogram_trees_equal_scikit_learn(samples):
    rows, actions = samples(1000, seed=8)
    options = {"max_leaf_nodes": 9, "early_stopping": False}
    models = [
        HistGradientBoostingRegressor(max_iter=10 + j % 2, random_state=j, **options).fit(
            rows, actions[:, j]
        )
        for j in range(quadruped.N_JOINTS)
    ]
    policy = BoostedTreesPolicy.compile("trot", NAMES, models)
    np.testing.assert_allclose(policy.importances.sum(axis=1), 1.0)
    expected = np.stack([model.predict(rows) for model in models], axis=1)
    np.testing.assert_allclose(policy(rows), expected, rtol=0, atol=1e-12)


def test_additive_equals_interpret_also_outside_the_training_range(additive_models, samples):
    rows = samples(1000, seed=9)[0]
    rows[:100] *= 10.0
    policy = AdditivePolicy.compile("trot", NAMES, additive_models)
    expected = np.stack([model.predict(rows) for model in additive_models], axis=1)
    np.testing.assert_allclose(policy(rows), expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize("kind", SUMS)
def test_contributions_add_up_to_the_target(kind, policy_of, samples):
    policy, rows = policy_of(kind), samples(5, seed=7)[0]
    targets = A1.joint_targets(policy(rows))
    for joint in (0, "RL_hip", 11):
        parts = policy.explain(rows, joint)
        assert parts.values.shape == (5, len(parts.terms))
        assert len(policy.factored_terms(quadruped.joint_index(joint))) == len(parts.terms)
        wanted = targets[:, quadruped.joint_index(joint)]
        np.testing.assert_allclose(parts.values.sum(axis=1), wanted, rtol=0, atol=1e-9)
        single = policy.explain(rows[2], joint)
        np.testing.assert_allclose(single.values, parts.values[2], rtol=0, atol=1e-12)
    with pytest.raises(InputError, match="unknown joint"):
        policy.explain(rows, "FL_knee")


def test_terms_are_written_as_in_the_file():
    vocabulary = Vocabulary(NAMES, known_definitions(A1, NAMES))
    text = "late*(0.25*cmd.v - cmd.yaw*2) + 0.125*q.FL_hip"
    formula = parse_formula(text, vocabulary.symbols)
    policy = SymbolicPolicy("trot", NAMES, [[formula] * 12], definitions=vocabulary.definitions)
    terms = policy.explain(np.zeros(N), 0).terms
    assert terms == ("late*(0.25*cmd.v)", "-late*(cmd.yaw*2)", "0.125*q.FL_hip")
    # A joint has six operations and three numbers, the shared definition three and two.
    assert reading_cost(policy) == (round((6 * 12 + 3) / 12), 3 * 12 + 2)


def test_policies_cost_to_read_what_the_page_says():
    page = (Path(__file__).parents[2] / "models" / "README.md").read_text().replace(",", "")
    rows = re.findall(r"^\| `(\w+)` \|[^|]+\| (\d\d+) \| (\d+) \|", page, re.MULTILINE)
    assert len(rows) == 7
    for kind, *said in rows:
        policy = load_expert("trot") if kind == "expert" else load_student("trot", kind)
        assert list(reading_cost(policy)) == list(map(int, said))


def test_trees_and_networks_do_not_split_into_contributions(neural, samples):
    with pytest.raises(InputError, match="neural"):
        neural.explain(samples(1)[0][0], 0)


@pytest.mark.parametrize("kind", ["symbolic", "symbolic_per_state"])
def test_derivatives_are_the_slopes_of_the_actions(kind, policy_of, samples):
    policy, step, rows = policy_of(kind), 1e-6, samples(4, seed=7)[0]
    derivatives = policy.derivatives(rows)
    assert derivatives.shape == (4, 12, N)
    for variable in (0, 3, 8):
        nudge = step * np.eye(N)[variable]
        slope = (policy(rows + nudge) - policy(rows - nudge)) / (2 * step)
        np.testing.assert_allclose(derivatives[..., variable], slope, atol=1e-6)


def test_another_gait_robot_or_layout_is_refused(linear):
    linear.check(gait="trot", observation_names=NAMES, robot=A1)
    for change, said in (
        ({"gait": "pace"}, "trot"),
        ({"robot": load_robot("go2")}, "go2"),
        ({"observation_names": ("Speed", *NAMES[1:])}, "Command X"),
        ({"observation_names": (*NAMES, "a", "b")}, r"49.*51"),
    ):
        with pytest.raises(InputError, match=said):
            linear.check(**({"gait": "trot", "observation_names": NAMES} | change))


def test_an_expert_must_be_neural_and_of_the_gait(linear, neural, tmp_path):
    path = tmp_path / "policy.safetensors"
    linear.save(path)
    with pytest.raises(InputError, match="an expert is neural"):
        load_expert("trot", path)
    neural.save(path)
    with pytest.raises(InputError, match="trot"):
        load_expert("walk", path)
    with pytest.raises(InputError, match="amble"):
        load_expert("amble")
    whole = (GAIT_DIRECTORY / "trot.yaml").read_text()
    text = whole.replace("states: [q0, q1]", "states: [q0, q1, q2]")
    gait = parse_gait(f"{text}  - {{from: q0, to: q2, when: FL & FR & RL & RR}}\n", name="trot")
    with pytest.raises(InputError, match=r"trot\.safetensors: has other RM"):
        load_expert(gait, EXPERT_DIRECTORY / "trot.safetensors")


def test_arrays_that_no_policy_can_have_are_refused(neural, symbolic, small_trees, small_additive):
    zeros = np.zeros
    eye = {"features": zeros((12, 2, 4), dtype=int), "thresholds": zeros((12, 2, 4))}
    for make, said in (
        (lambda: LinearPolicy("trot", NAMES, zeros((2, N)), zeros(2)), "'weights' is of shape"),
        (lambda: LinearPolicy("trot", NAMES, zeros((12, N)), zeros((12, 1))), "'intercepts' is of"),
        (lambda: LinearPolicy("trot", NAMES, zeros((12, N), dtype=int), zeros(12)), "type int64"),
        (lambda: LinearPolicy("trot", NAMES, zeros((12, N))), "lacks the array 'intercepts'"),
        (lambda: LinearPolicy("", NAMES, zeros((12, N)), zeros(12)), "the gait is ''"),
        (lambda: LinearPolicy("trot", NAMES[1:], zeros((12, N)), zeros(12)), "observations"),
        (lambda: LinearPerStatePolicy("trot", NAMES, zeros((3, 12, N)), zeros((3, 12))), "2 state"),
        (lambda: small_trees(features=np.full((12, 2, 3), 300)), "holds 300; .* from 0 to 48"),
        (lambda: small_trees(leaves=zeros((12, 2, 3))), "'leaves' is of shape"),
        (lambda: small_trees(thresholds=np.full((12, 2, 3), np.nan)), "holds nan"),
        (lambda: small_trees(**eye, leaves=zeros((12, 2, 5))), "4 inner nodes"),
        (lambda: small_additive(cuts=np.tile([0.0, np.inf, 1.0], (N, 1))), "does not ascend"),
        (lambda: small_additive(pairs=np.array([[0, N]])), "holds 49"),
        (lambda: small_additive(deviations=np.full((12, N, 4), -1.0)), "holds -1"),
        (lambda: NeuralPolicy("trot", NAMES, neural.estimator, neural.estimator), "actor.0.w"),
        (lambda: NeuralPolicy("trot", NAMES, neural.actor, neural.actor), "estimator.0.weight"),
        (lambda: NeuralPolicy("trot", NAMES, Network((), ()), neural.estimator), "0 layers"),
        (lambda: SymbolicPolicy("trot", NAMES, [symbolic.formulas_by_state[0][:2]]), "must be"),
        (lambda: SymbolicPerStatePolicy("trot", NAMES, symbolic.formulas_by_state), r"\(2, 12\)"),
    ):
        with pytest.raises(InputError, match=said):
            make()
    nothing = {"pairs": zeros((0, 2), dtype=int), "pair_joints": zeros(0, dtype=int)}
    tables = dict.fromkeys(("pair_tables", "pair_deviations"), zeros((0, 2, 2)))
    assert small_additive(**nothing, **tables)(zeros(N)).shape == (12,)

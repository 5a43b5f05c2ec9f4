"""What holds for every kind of policy: files, refusals, and compiled against the library."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from interpret.glassbox import ExplainableBoostingRegressor
from sklearn.ensemble import GradientBoostingRegressor, HistGradientBoostingRegressor

from glassgait.models.a1 import robot
from glassgait.models.errors import InputError
from glassgait.models.files import load_arrays, save_arrays
from glassgait.models.policies.additive import AdditivePolicy
from glassgait.models.policies.boosting import BoostedTreesPolicy
from glassgait.models.policies.expression_text import parse_expression, variable_names
from glassgait.models.policies.library import EXPERT_DIRECTORY, load_expert, load_policy
from glassgait.models.policies.linear import LinearPolicy, StatewiseLinearPolicy
from glassgait.models.policies.neural import Network, NeuralPolicy, elu
from glassgait.models.policies.open_loop import OpenLoopPolicy
from glassgait.models.policies.policy import first_not_finite
from glassgait.models.policies.precision import single_precision_cuts
from glassgait.models.policies.symbolic import StatewiseSymbolicPolicy, SymbolicPolicy
from glassgait.models.task.gait import GAIT_DIRECTORY, load_gait, parse_gait
from glassgait.models.task.observation import ObservationLayout

NAMES = ObservationLayout(2).names
N = len(NAMES)


def samples(count=400, seed=0):
    generator = np.random.default_rng(seed)
    observations = generator.normal(size=(count, N))
    one_hot = slice(NAMES.index("RM State 0"), NAMES.index("RM State 1") + 1)
    observations[:, one_hot] = np.eye(2)[generator.integers(2, size=count)]
    mixing = generator.normal(size=(N, robot.N_JOINTS))
    actions = np.tanh(observations @ mixing) + observations[:, :1] * observations[:, 2:14]
    return observations, actions


@pytest.fixture(scope="module")
def boosted_models():
    observations, actions = samples()
    return [
        GradientBoostingRegressor(n_estimators=15, max_depth=3, random_state=j).fit(
            observations, actions[:, j]
        )
        for j in range(robot.N_JOINTS)
    ]


@pytest.fixture(scope="module")
def additive_models():
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
        for j in range(robot.N_JOINTS)
    ]


def neural():
    generator = np.random.default_rng(1)

    def network(n_in, n_out):
        sizes = (n_in, 8, n_out)
        shapes = list(zip(sizes[1:], sizes[:-1], strict=True))
        return Network(
            tuple(
                generator.normal(size=shape).astype(np.float32).astype(float) for shape in shapes
            ),
            tuple(np.zeros(shape[0]) for shape in shapes),
        )

    return NeuralPolicy("trot", NAMES, network(N, robot.N_JOINTS), network(N - 7, 7))


def linear():
    weights = np.random.default_rng(2).normal(size=(robot.N_JOINTS, N))
    return LinearPolicy("trot", NAMES, weights, np.ones(robot.N_JOINTS))


def statewise():
    weights = np.random.default_rng(3).normal(size=(2, robot.N_JOINTS, N))
    return StatewiseLinearPolicy("trot", NAMES, weights, np.ones((2, robot.N_JOINTS)))


def symbolic():
    names = variable_names(N)
    texts = [
        f"({0.1 * j} * x{j} + sin(x{j + 1} * -2.5)) / 3 - tanh(x3)^2 + x1**3" for j in range(12)
    ]
    return SymbolicPolicy("trot", NAMES, [parse_expression(text, names) for text in texts])


def statewise_symbolic():
    names = variable_names(N)
    texts = [[f"{s} + x{j} * x{j + s}" for j in range(12)] for s in (1, 2)]
    formulas = [[parse_expression(text, names) for text in own] for own in texts]
    return StatewiseSymbolicPolicy("trot", NAMES, formulas)


def open_loop():
    table = np.random.default_rng(4).normal(size=(2, 6, robot.N_JOINTS))
    return OpenLoopPolicy("trot", NAMES, table)


@pytest.fixture(scope="module")
def histogram_models():
    observations, actions = samples()
    return [
        HistGradientBoostingRegressor(
            max_iter=10 + j % 2, max_leaf_nodes=9, random_state=j, early_stopping=False
        ).fit(observations, actions[:, j])
        for j in range(robot.N_JOINTS)
    ]


def every_policy(boosted_models, additive_models):
    return [
        neural(),
        linear(),
        statewise(),
        symbolic(),
        statewise_symbolic(),
        open_loop(),
        BoostedTreesPolicy.compile("trot", NAMES, boosted_models),
        AdditivePolicy.compile("trot", NAMES, additive_models),
    ]


def test_files_give_back_the_same_policy(boosted_models, additive_models, tmp_path):
    observations, _ = samples(20, seed=5)
    for policy in every_policy(boosted_models, additive_models):
        path = tmp_path / f"{policy.kind}.safetensors"
        policy.save(path)
        loaded = load_policy(path)
        assert type(loaded) is type(policy)
        assert (loaded.gait, loaded.observation_names) == ("trot", NAMES)
        np.testing.assert_array_equal(loaded(observations), policy(observations))


def test_batches_agree_with_single_rows(boosted_models, additive_models):
    observations, _ = samples(12, seed=6)
    for policy in every_policy(boosted_models, additive_models):
        batch = policy(observations.reshape(3, 4, -1))
        assert batch.shape == (3, 4, 12)
        single = np.array([policy(row) for row in observations])
        np.testing.assert_allclose(batch.reshape(12, 12), single, rtol=0, atol=1e-12)


def test_contributions_add_up_to_the_action(additive_models):
    observations, _ = samples(5, seed=7)
    additive = AdditivePolicy.compile("trot", NAMES, additive_models)
    for policy in (linear(), statewise(), symbolic(), statewise_symbolic(), additive):
        for joint in (0, 5, 11):
            parts = policy.explain(observations, joint)
            assert parts.values.shape == (5, len(parts.terms))
            np.testing.assert_allclose(
                parts.values.sum(axis=1), policy(observations)[:, joint], rtol=0, atol=1e-9
            )
            single = policy.explain(observations[2], joint)
            assert single.terms == parts.terms
            np.testing.assert_allclose(single.values, parts.values[2], rtol=0, atol=1e-12)
    assert parts.terms[-1].count("&") == 1


def test_terms_begin_with_the_weighted_observation():
    text = f"x0 * tanh(5.0 * x1 + -2.0) * (0.25 * x2) + {1 / 3} * x1"
    formula = parse_expression(text, variable_names(len(NAMES)))
    policy = SymbolicPolicy("trot", NAMES, [formula] * robot.N_JOINTS)
    terms = policy.explain(np.zeros(len(NAMES)), 0).terms
    assert terms == (
        f"0.25 * {NAMES[0]} * {NAMES[2]} * tanh((5 * {NAMES[1]}) - 2)",
        f"0.333 * {NAMES[1]}",
    )


def test_terms_name_their_gates():
    late = f"tanh((5.0 * x{NAMES.index('RM Iters')} + -2.0))"
    formula = parse_expression(f"{late} * (0.25 * x0)", variable_names(len(NAMES)))
    policy = SymbolicPolicy("trot", NAMES, [formula] * robot.N_JOINTS)
    assert policy.explain(np.zeros(len(NAMES)), 0).terms == (f"0.25 * {NAMES[0]} * Late",)


def test_trees_and_networks_do_not_split_into_contributions():
    with pytest.raises(InputError, match=r"kind 'neural' do not split"):
        neural().explain(samples(1)[0][0], 0)


@pytest.mark.parametrize("make", [symbolic, statewise_symbolic])
def test_derivatives_are_the_slopes_of_the_actions(make):
    policy, step = make(), 1e-6
    observations, _ = samples(4, seed=7)
    derivatives = policy.derivatives(observations)
    assert derivatives.shape == (4, 12, N)
    for variable in (0, 3, 8):
        nudge = step * np.eye(N)[variable]
        slope = (policy(observations + nudge) - policy(observations - nudge)) / (2 * step)
        np.testing.assert_allclose(derivatives[..., variable], slope, atol=1e-6)


def test_boosted_trees_equal_scikit_learn(boosted_models):
    observations, _ = samples(3000, seed=8)
    policy = BoostedTreesPolicy.compile("trot", NAMES, boosted_models)
    importances = [model.feature_importances_ for model in boosted_models]
    np.testing.assert_array_equal(policy.importances, importances)
    expected = np.stack([model.predict(observations) for model in boosted_models], axis=1)
    np.testing.assert_allclose(policy(observations), expected, rtol=0, atol=1e-12)


def test_boosted_trees_take_scikit_learns_branch_at_the_threshold(boosted_models):
    observations, _ = samples(1, seed=8)
    tree = boosted_models[0].estimators_[0, 0].tree_
    at = np.repeat(observations, 3, axis=0)
    feature, threshold = tree.feature[0], tree.threshold[0]
    at[:, feature] = [threshold, np.nextafter(threshold, 9), np.nextafter(threshold, -9)]
    policy = BoostedTreesPolicy.compile("trot", NAMES, boosted_models)
    expected = np.stack([model.predict(at) for model in boosted_models], axis=1)
    np.testing.assert_allclose(policy(at), expected, rtol=0, atol=1e-12)


def test_histogram_trees_equal_scikit_learn(histogram_models):
    observations, _ = samples(3000, seed=8)
    policy = BoostedTreesPolicy.compile("trot", NAMES, histogram_models)
    np.testing.assert_allclose(policy.importances.sum(axis=1), 1.0)
    expected = np.stack([model.predict(observations) for model in histogram_models], axis=1)
    np.testing.assert_allclose(policy(observations), expected, rtol=0, atol=1e-12)


@given(
    st.floats(-1e6, 1e6),
    st.integers(-3, 3),
    st.sampled_from([-1, 0, 1]),
)
def test_cuts_part_doubles_as_rounding_to_single_precision_does(threshold, ulps, nudge):
    cut = single_precision_cuts(np.array(threshold))
    single = np.float32(threshold)
    for _ in range(abs(ulps)):
        single = np.nextafter(single, np.float32(np.copysign(np.inf, ulps)))
    neighbour = np.nextafter(single, np.float32(np.inf))
    halfway = 0.5 * (float(single) + float(neighbour))
    for x in (float(single), halfway, threshold, float(cut)):
        value = np.nextafter(x, np.copysign(np.inf, nudge)) if nudge else x
        assert (value <= cut) == (float(np.float32(value)) <= threshold)


def test_statewise_formulas_are_those_of_the_state():
    observations, _ = samples(2, seed=4)
    policy = statewise_symbolic()
    observations[:, policy._one_hot] = np.eye(2)
    action = policy(observations)
    joint = np.arange(12)
    np.testing.assert_allclose(action[0], 1 + observations[0, joint] * observations[0, joint + 1])
    np.testing.assert_allclose(action[1], 2 + observations[1, joint] * observations[1, joint + 2])


def test_open_loop_actions_are_looked_up_and_held_at_the_end():
    policy = open_loop()
    observations, _ = samples(3, seed=4)
    observations[:, policy._one_hot] = [[1, 0], [0, 1], [0, 1]]
    observations[:, NAMES.index("RM Iters")] = [0.3, 0.0, 2.5]
    expected = policy.table[[0, 1, 1], [3, 0, 5]]
    np.testing.assert_array_equal(policy(observations), expected)


def test_additive_equals_interpret_also_outside_the_training_range(additive_models):
    observations, _ = samples(3000, seed=9)
    observations[:100] *= 10.0
    policy = AdditivePolicy.compile("trot", NAMES, additive_models)
    expected = np.stack([model.predict(observations) for model in additive_models], axis=1)
    np.testing.assert_allclose(policy(observations), expected, rtol=0, atol=1e-12)
    single = np.array([policy(row) for row in observations[:50]])
    np.testing.assert_allclose(single, expected[:50], rtol=0, atol=1e-12)


def test_statewise_linear_uses_the_weights_of_its_state():
    policy = statewise()
    observations, _ = samples(2, seed=4)
    observations[:, policy._one_hot] = np.eye(2)
    for state in range(2):
        expected = policy.weights[state] @ observations[state] + 1.0
        np.testing.assert_allclose(policy(observations)[state], expected)


def test_neural_network_is_a_perceptron_with_elu():
    policy = neural()
    observation = samples(1)[0][0]
    hidden = elu(policy.actor.weights[0] @ observation + policy.actor.biases[0])
    np.testing.assert_allclose(policy(observation), policy.actor.weights[1] @ hidden)
    np.testing.assert_allclose(elu(np.array([-1.0, 2.0])), [np.exp(-1) - 1, 2.0])


def test_policies_refuse_another_gait_or_layout():
    policy = linear()
    policy.check(gait="trot", observation_names=NAMES)
    with pytest.raises(InputError, match="made for gait 'trot', not 'pace'"):
        policy.check(gait="pace", observation_names=NAMES)
    with pytest.raises(InputError, match="'Command X' instead of 'Speed'"):
        policy.check(gait="trot", observation_names=("Speed", *NAMES[1:]))
    with pytest.raises(InputError, match="49 entries instead of 51"):
        policy.check(gait="trot", observation_names=(*NAMES, "a", "b"))


def test_files_of_unknown_kind_or_with_parts_missing_are_refused(tmp_path):
    path = tmp_path / "policy.safetensors"
    linear().save(path)
    arrays, header = load_arrays(path)
    save_arrays(path, arrays, header | {"kind": "oracle"})
    with pytest.raises(InputError, match="unknown kind of policy, 'oracle'"):
        load_policy(path)
    save_arrays(path, {}, header)
    with pytest.raises(InputError, match="linear policy: lacks the array 'weights'"):
        load_policy(path)
    save_arrays(path, arrays, header | {"format": 99})
    with pytest.raises(InputError, match="not a policy of format 1"):
        load_policy(path)


def test_experts_must_be_neural_and_of_the_gait(tmp_path):
    path = tmp_path / "policy.safetensors"
    linear().save(path)
    with pytest.raises(InputError, match="an expert is neural"):
        load_expert("trot", path)
    neural().save(path)
    with pytest.raises(InputError, match="is an expert for gait 'trot', not 'walk'"):
        load_expert("walk", path)
    with pytest.raises(InputError, match="unknown gait 'amble'"):
        load_expert("amble")


def small_trees(**changes):
    arrays = {
        "features": np.zeros((12, 2, 3), dtype=np.int32),
        "thresholds": np.full((12, 2, 3), np.inf),
        "leaves": np.ones((12, 2, 4)),
        "intercepts": np.zeros(12),
        "importances": np.zeros((12, N)),
    }
    return BoostedTreesPolicy("trot", NAMES, **(arrays | changes))


def small_additive(**changes):
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


def test_arrays_that_no_policy_can_have_are_refused_in_python_as_well():
    zeros = np.zeros
    for make, told in (
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
        (lambda: NeuralPolicy("trot", NAMES, neural().estimator, neural().estimator), "actor.0.w"),
        (lambda: NeuralPolicy("trot", NAMES, neural().actor, neural().actor), r"must be \(8, 42\)"),
        (
            lambda: NeuralPolicy("trot", NAMES, Network((), ()), neural().estimator),
            "lacks the array",
        ),
        (lambda: SymbolicPolicy("trot", NAMES, symbolic().expressions[:2]), "12 joints"),
        (lambda: StatewiseSymbolicPolicy("trot", NAMES, symbolic().expressions), "2 states"),
    ):
        with pytest.raises(InputError, match=told):
            make()
    assert small_trees().depth == 2
    assert small_additive(
        pairs=zeros((0, 2), dtype=int),
        pair_joints=zeros(0, dtype=int),
        pair_tables=zeros((0, 2, 2)),
        pair_deviations=zeros((0, 2, 2)),
    )(zeros(N)).shape == (12,)


def test_names_that_no_policy_can_have_are_refused():
    weights, intercepts = np.zeros((12, N)), np.zeros(12)
    iterations = NAMES.index("RM Iters")
    for gait, names, told in (
        (5, NAMES, "the gait is of type int"),
        ("", NAMES, "the gait is ''"),
        ("trot", "x" * N, "names of observations"),
        ("trot", (), "names of observations"),
        ("trot", (5, *NAMES[1:]), "observation is of type int"),
        ("trot", (NAMES[1], *NAMES[1:]), "observes 'Command Yaw' twice"),
        ("trot", ("RM State 2", *NAMES[1:]), "in a row"),
        ("trot", ("Clock", *NAMES[1:]), "no observation is called 'Clock'; make the policy anew"),
    ):
        with pytest.raises(InputError, match=told):
            LinearPolicy(gait, names, weights, intercepts)
    without = (*NAMES[:iterations], "Clock", *NAMES[iterations + 1 :])
    with pytest.raises(InputError, match="does not observe 'RM Iters', which it needs"):
        OpenLoopPolicy("trot", without, open_loop().table)
    with pytest.raises(InputError, match="does not observe 'RM Iters', which it needs"):
        SymbolicPolicy("trot", without, symbolic().expressions)


def test_header_fields_of_another_kind_are_refused(tmp_path):
    path = tmp_path / "policy.safetensors"
    linear().save(path)
    arrays, header = load_arrays(path)
    for key, value, told in (
        ("format", True, "not a policy of format 1"),
        ("kind", ["linear"], "'kind' of its header is of type list; it must be text"),
        ("observation_names", "x" * N, "of type str; it must be a list of names"),
        ("values", None, "of type NoneType; it must be a mapping"),
    ):
        save_arrays(path, arrays, header | {key: value})
        with pytest.raises(InputError, match=told) as refused:
            load_policy(path)
        assert str(refused.value).startswith(f"{path}: ")
    save_arrays(path, arrays, header | {"made by": "hand"})
    assert load_policy(path).kind == "linear"


@pytest.mark.parametrize("real", [np.float16, np.float32])
@pytest.mark.parametrize("whole", [np.uint8, np.uint16, np.int64])
def test_small_types_of_numbers_are_taken(real, whole, tmp_path):
    for policy in (linear(), open_loop(), small_trees(), small_additive(), neural()):
        path = tmp_path / "policy.safetensors"
        policy.save(path)
        arrays, header = load_arrays(path)
        small = {
            name: array.astype(real if array.dtype.kind == "f" else whole)
            for name, array in arrays.items()
        }
        save_arrays(path, small, header)
        action = load_policy(path)(samples(5)[0])
        assert action.dtype == np.float64
        np.testing.assert_allclose(action, policy(samples(5)[0]), rtol=0, atol=0.1)


def test_joints_are_explained_by_name_or_index():
    observation = samples(1)[0][0]
    for policy in (linear(), statewise(), symbolic(), statewise_symbolic(), small_additive()):
        named, numbered = policy.explain(observation, "FL_calf"), policy.explain(observation, 2)
        assert named.terms == numbered.terms
        np.testing.assert_array_equal(named.values, numbered.values)
    for policy in (linear(), small_trees(), neural()):
        for bad in ("FL_knee", 12, -1, True):
            with pytest.raises(InputError, match="unknown joint"):
                policy.explain(observation, bad)


def test_products_of_many_sums_are_explained_in_one_term():
    product = " * ".join(f"(x{i} + {i}.5)" for i in range(22))
    formula = parse_expression(f"x0 + {product}", variable_names(N))
    policy = SymbolicPolicy("trot", NAMES, [formula] * robot.N_JOINTS)
    observations, _ = samples(5)
    parts = policy.explain(observations, "FL_calf")
    assert len(parts.terms) == 2
    np.testing.assert_allclose(parts.values.sum(axis=1), policy(observations)[:, 2])


def test_the_first_entry_that_is_not_finite_is_found():
    values = np.zeros((2, 12))
    assert first_not_finite(values) is None
    values[1, 3], values[1, 7] = np.inf, np.nan
    assert first_not_finite(values) == (1, 3)
    assert first_not_finite(values[1]) == (3,)


def test_an_expert_of_a_gait_that_has_other_states_now_is_refused(tmp_path):
    whole = (GAIT_DIRECTORY / "trot.yaml").read_text()
    text = whole.replace("states: [q0, q1]", "states: [q0, q1, q2]")
    text += "  - {from: q0, to: q2, when: FL & FR & RL & RR}\n"
    gait = parse_gait(text, name="trot")
    with pytest.raises(
        InputError, match=r"trot\.safetensors: was trained for a trot of other states"
    ):
        load_expert(gait, EXPERT_DIRECTORY / "trot.safetensors")
    assert load_expert(load_gait("trot")).gait == "trot"

"""Policies as ONNX graphs: they act as Python does, and say what a deployment stack must know."""

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from glassgait.models.errors import InputError
from glassgait.models.formulas.expression import UNARY, Expression, constant, variable
from glassgait.models.policies.controller import alone
from glassgait.models.policies.neural import NeuralPolicy
from glassgait.models.policies.policy import Policy
from glassgait.models.policies.symbolic import SymbolicPolicy
from glassgait.models.robots.library import load_robot
from glassgait.models.task.contact import LOW, UNCHANGED_STEPS
from glassgait.models.task.gait import gait_names, load_gait
from glassgait.models.task.observation import ObservationLayout

A1 = load_robot()


onnx = pytest.importorskip("onnx")
pytest.importorskip("onnxruntime")

from glassgait.models.export.graphs.policy_graph import write_graph  # noqa: E402
from glassgait.models.export.graphs.runtime import LoadedGraph  # noqa: E402

NAMES = ObservationLayout(2).names
N = len(NAMES)
KINDS = (
    "linear statewise_linear open_loop neural mirrored symbolic statewise_symbolic "
    "symbolic_with_readings trees "
    "rounded_trees shallow_trees additive additive_without_pairs"
)


def loaded(gait, policy, expert, real="double") -> LoadedGraph:
    model = write_graph(gait, alone(policy, expert), policy_name="mine", version="0", real=real)
    return LoadedGraph(model.SerializeToString())


def rows(gait, count=200, seed=0):
    """Proprioception of which all but the machine's state is drawn at random."""
    generator = np.random.default_rng(seed)
    layout = ObservationLayout(gait.n_states)
    own = generator.normal(size=(count, layout.n_proprioceptive))
    first = layout.names.index("RM State 0")
    states = np.eye(gait.n_states)[generator.integers(gait.n_states, size=count)]
    own[:, first : first + gait.n_states] = states
    return own


def in_python(policy, expert, own):
    estimate = expert.estimator(own)
    return policy(np.concatenate([own, estimate], axis=-1)), estimate


@pytest.mark.parametrize("kind", KINDS.split())
def test_a_graph_acts_as_python_does(
    kind,
    trot,
    generator,
    small_expert,
    make_policy,
    statewise,
    open_loop,
    symbolic,
    statewise_symbolic,
    random_trees,
    narrow_readings,
    random_additive,
    small_trees,
):
    policies = {
        "linear": lambda: make_policy(trot),
        "statewise_linear": lambda: statewise,
        "open_loop": lambda: open_loop,
        "neural": lambda: small_expert(trot, hidden=(8, 5, 4)),
        "mirrored": lambda: small_expert(trot, mirrored=True),
        "symbolic_with_readings": lambda: symbolic.with_readings(narrow_readings),
        "symbolic": lambda: symbolic,
        "statewise_symbolic": lambda: statewise_symbolic,
        "trees": lambda: random_trees(generator, rounded=False),
        "rounded_trees": lambda: random_trees(generator, rounded=True),
        # Whose roots ask nothing.
        "shallow_trees": lambda: small_trees(leaves=generator.normal(size=(12, 2, 4))),
        "additive": lambda: random_additive(generator, n_pairs=40),
        "additive_without_pairs": lambda: random_additive(generator, n_pairs=0),
    }
    policy, expert = policies[kind](), small_expert(trot, mirrored=kind == "mirrored")
    own = rows(trot)
    acted = loaded(trot, policy, expert)(own)
    action, estimate = in_python(policy, expert, own)
    np.testing.assert_allclose(acted.action, action, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(acted.estimate, estimate, rtol=1e-12, atol=1e-12)
    assert np.ptp(action, axis=0).max() > 0.0 or kind == "shallow_trees"


def test_one_row_is_as_good_as_many(trot, small_expert, make_policy):
    graph = loaded(trot, make_policy(trot), small_expert(trot))
    own = rows(trot, 3)
    together = graph(own)
    for row, action, estimate in zip(own, *together, strict=True):
        alone = graph(row)
        np.testing.assert_allclose(alone.action, action, atol=1e-13)
        np.testing.assert_allclose(alone.estimate, estimate, atol=1e-13)


def test_cuts_part_doubles_that_single_precision_does_not_distinguish(
    trot, small_expert, small_trees
):
    """A threshold between 0.1 and the next double: older trees of ONNX would send both left."""
    thresholds = np.full((12, 2, 3), np.inf)
    thresholds[..., 0] = 0.1
    leaves = np.tile([0.0, 0.0, 1.0, 1.0], (12, 2, 1))
    policy = small_trees(thresholds=thresholds, leaves=leaves)
    own = rows(trot, 2)
    own[:, 0] = 0.1, np.nextafter(0.1, 1.0)
    acted = loaded(trot, policy, small_expert(trot))(own)
    np.testing.assert_array_equal(acted.action[:, 0], [0.0, 2.0])


def test_a_cut_itself_belongs_to_the_bin_above(trot, small_expert, small_additive):
    tables = np.zeros((12, N, 4))
    tables[:, 0] = [1.0, 2.0, 3.0, 4.0]
    policy = small_additive(tables=tables)
    own = rows(trot, 3)
    own[:, 0] = np.nextafter(1.0, 0.0), 1.0, 2.0
    acted = loaded(trot, policy, small_expert(trot))(own)
    np.testing.assert_array_equal(acted.action[:, 1], [2.0, 3.0, 3.0])


# Drawn the same way always: digits lost to cancellation are no fault of either side.
@settings(max_examples=15, derandomize=True)
@given(data=st.data())
def test_formulas_of_any_operator_act_alike(data, random_formulas, estimator_alone):
    formulas = data.draw(st.lists(random_formulas(N, 8), min_size=12, max_size=12))
    policy = SymbolicPolicy("trot", NAMES, formulas)
    own = rows(load_gait("trot"), 20)
    acted = loaded(load_gait("trot"), policy, estimator_alone)(own)
    with np.errstate(all="ignore"):
        action, _ = in_python(policy, estimator_alone, own)
    finite = np.isfinite(action) & (np.abs(action) < 1e6)
    # sin of a great number asks for more digits than either has.
    tame = np.array([_tame(formula) for formula in policy.expressions])
    kept = finite & tame
    np.testing.assert_allclose(acted.action[kept], action[kept], rtol=1e-6, atol=1e-9)


@pytest.fixture(scope="session")
def estimator_alone(random_network):
    generator = np.random.default_rng(1)
    actor, estimator = random_network(generator, N, 12), random_network(generator, N - 7, 8, 7)
    return NeuralPolicy("trot", NAMES, actor, estimator)


def _tame(formula: Expression) -> bool:
    """Tells whether no number of a formula is so great that digits of others are lost by it."""
    if formula.operator == "constant":
        return abs(formula.value) < 1e3
    return formula.nesting < 3 and all(map(_tame, formula.operands))


@pytest.mark.parametrize("operator", UNARY)
def test_every_function_is_there(operator, trot, estimator_alone):
    inner = Expression("add", (constant(5.0), Expression("sin", (variable(2),))))
    formula = Expression(operator, (inner,))
    policy = SymbolicPolicy("trot", NAMES, [formula] * 12)
    own = rows(trot, 20)
    action, _ = in_python(policy, estimator_alone, own)
    acted = loaded(trot, policy, estimator_alone)(own)
    np.testing.assert_allclose(acted.action, action, rtol=1e-13, atol=1e-13)


def test_formulas_of_other_states_may_be_infinite(trot, small_expert, statewise_symbolic):
    """In either state the other state's formulas divide by 0."""
    names = statewise_symbolic.vocabulary.symbols
    one_hot = [variable(names.index(f"s{state}")) for state in range(2)]
    formulas = [[Expression("div", (constant(1.0), own))] * 12 for own in one_hot]
    policy = type(statewise_symbolic)("trot", NAMES, formulas)
    acted = loaded(trot, policy, small_expert(trot))(rows(trot, 20))
    expected = (1.0 - A1.default_stance) / A1.action_scale
    np.testing.assert_allclose(acted.action, np.tile(expected, (20, 1)), rtol=1e-14)


@pytest.mark.parametrize("name", gait_names())
def test_metadata_hold_what_a_robot_needs(name, make_policy, small_expert):
    gait = load_gait(name)
    metadata = loaded(gait, make_policy(gait), small_expert(gait)).metadata
    assert metadata["joint_names"].split(",")[:4] == ["FL_hip", "FL_thigh", "FL_calf", "FR_hip"]
    assert [float(own) for own in metadata["default_joint_pos"].split(",")] == [*A1.default_stance]
    for key, value in {"joint_stiffness": 40.0, "joint_damping": 1.0, "action_scale": 0.25}.items():
        assert [float(own) for own in metadata[key].split(",")] == [value] * 12
    for key in ("thigh_offset", "thigh_length", "calf_length", "foot_radius"):
        assert float(metadata[key]) == getattr(A1, key)
    assert tuple(float(own) for own in metadata["hip_offset"].split(",")) == A1.hip_offset
    terms = metadata["observation_names"].split(",")
    sizes = [int(own) for own in metadata["observation_terms_size"].split(",")]
    scales = [float(own) for own in metadata["observation_terms_scale"].split(",")]
    assert terms[:4] == ["command", "joint_pos", "joint_vel", "actions"]
    assert dict(zip(terms, sizes, strict=True))["rm_state"] == gait.n_states
    assert sum(sizes) == len(metadata["observation_entries"].split(",")) == 40 + gait.n_states
    assert scales == [1.0, 1.0, 0.05, 1.0, 1.0, 0.1, 0.1]
    assert float(metadata["control_period"]) == 0.02
    assert metadata["gait"] == name
    trust = json.loads(metadata["contact_trust"])
    assert trust == {"unchanged_steps": UNCHANGED_STEPS, "low": LOW}
    machine = json.loads(metadata["reward_machine"])
    assert machine["states"] == list(gait.states)
    assert len(machine["transitions"]) == len(gait.transitions)
    assert metadata["policy_digest"] == make_policy(gait).digest()


def test_single_precision_is_of_what_is_read_and_given(trot, small_expert, make_policy):
    policy, expert, own = make_policy(trot), small_expert(trot), rows(trot)
    graph = loaded(trot, policy, expert, real="float")
    assert graph.dtype == np.float32
    action, _ = in_python(policy, expert, own.astype(np.float32).astype(float))
    np.testing.assert_allclose(graph(own).action, action, rtol=6e-8)


def test_only_trees_ask_for_another_domain(trot, small_expert, make_policy, small_trees):
    def domains(policy):
        model = write_graph(trot, alone(policy, small_expert(trot)), policy_name="", version="")
        return {own.domain: own.version for own in model.opset_import}

    assert domains(make_policy(trot)) == {"": 17}
    assert domains(small_trees()) == {"": 17, "ai.onnx.ml": 5}


class Standing(Policy):
    """Stands still, and is of a kind that nobody knows."""

    kind = "standing"

    def __call__(self, observation):
        return np.zeros((*observation.shape[:-1], 12))


def test_what_there_is_no_graph_for_is_refused(trot, small_expert, make_policy):
    names = {"policy_name": "", "version": ""}
    with pytest.raises(InputError, match="pace"):
        write_graph(trot, alone(make_policy(load_gait("pace")), small_expert(trot)), **names)
    with pytest.raises(InputError, match="standing"):
        write_graph(trot, alone(Standing("trot", NAMES), small_expert(trot)), **names)


def test_a_gait_of_other_states_is_refused(trot, small_expert, make_policy):
    other = replace(trot, states=(*trot.states, "more"))
    with pytest.raises(InputError, match="differs in 'states'"):
        write_graph(other, alone(make_policy(trot), small_expert(trot)), policy_name="", version="")

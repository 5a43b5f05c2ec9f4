"""Fixtures for tests of policies: policies of every kind, random models and samples."""

from collections.abc import Callable
from functools import cache

import numpy as np
import pytest
from hypothesis import strategies as st

from glassgait.models.arrays import Array
from glassgait.models.estimation.odometry import Odometry
from glassgait.models.formulas.expression import BINARY, UNARY, Expression, constant, variable
from glassgait.models.formulas.grammar import parse_expression, variable_names
from glassgait.models.policies.additive import AdditivePolicy
from glassgait.models.policies.boosting import BoostedTreesPolicy
from glassgait.models.policies.linear import LinearPerStatePolicy, LinearPolicy
from glassgait.models.policies.neural import Network, NeuralPolicy
from glassgait.models.policies.symbolic import SymbolicPerStatePolicy, SymbolicPolicy
from glassgait.models.robots import quadruped
from glassgait.models.task.gait import Gait
from glassgait.models.task.observation import ObservationLayout
from glassgait.models.task.symmetry import mirrored_states

NAMES = ObservationLayout(2).names
N = len(NAMES)


@pytest.fixture(scope="session")
def samples() -> Callable[..., tuple[Array, Array]]:
    """Draws observations of a gait with two states, and actions that depend nonlinearly on them."""

    def draw(count: int = 400, seed: int = 0) -> tuple[Array, Array]:
        generator = np.random.default_rng(seed)
        observations = generator.normal(size=(count, N))
        one_hot = slice(NAMES.index("RM State 0"), NAMES.index("RM State 1") + 1)
        observations[:, one_hot] = np.eye(2)[generator.integers(2, size=count)]
        mixing = generator.normal(size=(N, quadruped.N_JOINTS))
        actions = np.tanh(observations @ mixing) + observations[:, :1] * observations[:, 2:14]
        return observations, actions

    return draw


@pytest.fixture(scope="session")
def random_formulas() -> Callable[..., st.SearchStrategy[Expression]]:
    """Draws formulas with all operators and `n_variables` variables; most are not canonical."""

    # Hypothesis takes longer to set up a strategy than to draw from it.
    @cache
    def draw(n_variables: int, max_leaves: int = 12) -> st.SearchStrategy[Expression]:
        numbers = st.floats(-1e30, 1e30) | st.integers(-9, 9).map(float)
        leaves = numbers.map(constant) | st.integers(0, n_variables - 1).map(variable)

        def extend(inner: st.SearchStrategy[Expression]) -> st.SearchStrategy[Expression]:
            unary = st.builds(Expression, st.sampled_from(UNARY), st.tuples(inner))
            pairs = st.tuples(inner, inner)
            return unary | st.builds(Expression, st.sampled_from(sorted(BINARY)), pairs)

        return st.recursive(leaves, extend, max_leaves=max_leaves)

    return draw


@pytest.fixture(scope="session")
def random_network() -> Callable[..., Network]:
    """Draws the weights of a network with layers of the given sizes."""

    def draw(generator: np.random.Generator, *sizes: int) -> Network:
        shapes = zip(sizes[1:], sizes[:-1], strict=True)
        # Files store single precision.
        weights = [generator.normal(size=own).astype(np.float32).astype(float) for own in shapes]
        return Network(tuple(weights), tuple(np.zeros(len(own)) for own in weights))

    return draw


@pytest.fixture
def neural(random_network: Callable[..., Network]) -> NeuralPolicy:
    generator = np.random.default_rng(1)
    actor = random_network(generator, N, 8, quadruped.N_JOINTS)
    return NeuralPolicy("trot", NAMES, actor, random_network(generator, N - 7, 8, 7))


@pytest.fixture
def linear() -> LinearPolicy:
    weights = np.random.default_rng(2).normal(size=(quadruped.N_JOINTS, N))
    return LinearPolicy("trot", NAMES, weights, np.ones(quadruped.N_JOINTS))


@pytest.fixture
def per_state() -> LinearPerStatePolicy:
    weights = np.random.default_rng(3).normal(size=(2, quadruped.N_JOINTS, N))
    return LinearPerStatePolicy("trot", NAMES, weights, np.ones((2, quadruped.N_JOINTS)))


@pytest.fixture
def symbolic() -> SymbolicPolicy:
    names = variable_names(N)
    texts = [
        f"({0.1 * j} * x{j} + sin(x{j + 1} * -2.5)) / 3 - tanh(x3)^2 + x1**3" for j in range(12)
    ]
    return SymbolicPolicy("trot", NAMES, [[parse_expression(text, names) for text in texts]])


@pytest.fixture
def symbolic_per_state() -> SymbolicPerStatePolicy:
    names = variable_names(N)
    texts = [[f"{s} + x{j} * x{j + s}" for j in range(12)] for s in (1, 2)]
    formulas = [[parse_expression(text, names) for text in own] for own in texts]
    return SymbolicPerStatePolicy("trot", NAMES, formulas)


@pytest.fixture
def small_expert(random_network: Callable[..., Network]) -> Callable[..., NeuralPolicy]:
    """Makes experts with few units and small actions."""

    def make(
        gait: Gait,
        *,
        mirrored: bool = False,
        hidden: tuple[int, ...] = (8,),
        imu: bool = False,
        odometry: Odometry | None = None,
    ) -> NeuralPolicy:
        generator, names = np.random.default_rng(1), ObservationLayout(gait.n_states, imu=imu).names
        n = len(names)
        # Actions are observed, so larger ones would grow from step to step.
        actor, estimator = (
            Network(tuple(0.1 * weight for weight in own.weights), own.biases)
            for own in (
                random_network(generator, n, *hidden, quadruped.N_JOINTS),
                random_network(generator, n - 7, *hidden, 7),
            )
        )
        states = mirrored_states(gait) if mirrored else None
        return NeuralPolicy(gait.name, names, actor, odometry or estimator, states)

    return make


@pytest.fixture
def random_trees() -> Callable[..., BoostedTreesPolicy]:
    """Draws six trees per joint, with some branches that end early."""

    def make(generator: np.random.Generator, *, rounded: bool) -> BoostedTreesPolicy:
        thresholds = generator.normal(size=(12, 6, 7))
        thresholds[..., 5:] = np.inf
        if rounded:
            thresholds = thresholds.astype(np.float32)
        return BoostedTreesPolicy(
            "trot",
            NAMES,
            features=generator.integers(N, size=(12, 6, 7)),
            thresholds=thresholds,
            leaves=generator.normal(size=(12, 6, 8)),
            intercepts=generator.normal(size=12),
            importances=np.zeros((12, N)),
        )

    return make


@pytest.fixture
def random_additive() -> Callable[..., AdditivePolicy]:
    """Draws functions of one observation, and of some pairs."""

    def make(generator: np.random.Generator, *, n_pairs: int) -> AdditivePolicy:
        cuts, pair_cuts = (np.sort(generator.normal(size=(N, k)), axis=1) for k in (9, 3))
        cuts[:, -2:] = np.inf
        return AdditivePolicy(
            "trot",
            NAMES,
            cuts=cuts,
            pair_cuts=pair_cuts,
            tables=generator.normal(size=(12, N, 10)),
            pairs=generator.integers(N, size=(n_pairs, 2)),
            pair_joints=generator.integers(12, size=n_pairs),
            pair_tables=generator.normal(size=(n_pairs, 4, 4)),
            deviations=np.zeros((12, N, 10)),
            pair_deviations=np.zeros((n_pairs, 4, 4)),
            intercepts=generator.normal(size=12),
        )

    return make

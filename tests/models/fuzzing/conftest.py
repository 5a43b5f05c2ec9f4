"""Sound policies of every kind to be forged, and what a file may do when it is loaded."""

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from glassgait.models.arrays import Array
from glassgait.models.errors import InputError
from glassgait.models.formulas.expression import MAX_TERMS
from glassgait.models.formulas.grammar import parse_expression, variable_names
from glassgait.models.policies.additive import AdditivePolicy
from glassgait.models.policies.boosting import BoostedTreesPolicy
from glassgait.models.policies.library import load_policy
from glassgait.models.policies.linear import LinearPolicy, StatewiseLinearPolicy
from glassgait.models.policies.neural import Network, NeuralPolicy
from glassgait.models.policies.policy import Policy
from glassgait.models.policies.symbolic import (
    FormulaPolicy,
    StatewiseSymbolicPolicy,
    SymbolicPolicy,
)
from glassgait.models.task.observation import ObservationLayout

NAMES = ObservationLayout(2).names
N = len(NAMES)

SECONDS = 10
"""Time that a file may take."""

MESSAGE_LENGTH = 500
"""Characters that a refusal may have."""


def trees(generator: np.random.Generator) -> Policy:
    thresholds = generator.normal(size=(12, 4, 7))
    thresholds[:, :, 3] = np.inf
    return BoostedTreesPolicy(
        "trot",
        NAMES,
        features=generator.integers(N, size=(12, 4, 7), dtype=np.int32),
        thresholds=thresholds,
        leaves=generator.normal(size=(12, 4, 8)),
        intercepts=generator.normal(size=12),
        importances=generator.uniform(size=(12, N)),
    )


def additive(generator: np.random.Generator) -> Policy:
    cuts = np.sort(generator.normal(size=(N, 6)))
    cuts[::2, 4:] = np.inf
    return AdditivePolicy(
        "trot",
        NAMES,
        cuts=cuts,
        pair_cuts=cuts[:, 1:4],
        tables=generator.normal(size=(12, N, 7)),
        pairs=generator.integers(N, size=(5, 2)),
        pair_joints=generator.integers(12, size=5),
        pair_tables=generator.normal(size=(5, 4, 4)),
        deviations=generator.uniform(size=(12, N, 7)),
        pair_deviations=generator.uniform(size=(5, 4, 4)),
        intercepts=generator.normal(size=12),
    )


def formulas(generator: np.random.Generator) -> list:
    texts = [f"0.5*x{j} + tanh(5.0*x40 - 2.0)*({j}.25*x3 - x{j + 1}) - 0.1" for j in range(12)]
    return [parse_expression(text, variable_names(N)) for text in texts]


@pytest.fixture(scope="session")
def sound_policies(random_network: Callable[..., Network]) -> dict[str, Policy]:
    """A policy of each kind, by the name of its kind."""

    def neural(generator: np.random.Generator) -> Policy:
        actor = random_network(generator, N, 8, 6, 12)
        return NeuralPolicy("trot", NAMES, actor, random_network(generator, N - 7, 8, 7))

    makers: dict[str, Callable[[np.random.Generator], Policy]] = {
        "neural": neural,
        "linear": lambda g: LinearPolicy("trot", NAMES, g.normal(size=(12, N)), g.normal(size=12)),
        "statewise_linear": lambda g: StatewiseLinearPolicy(
            "trot", NAMES, g.normal(size=(2, 12, N)), g.normal(size=(2, 12))
        ),
        "boosted_trees": trees,
        "additive": additive,
        "symbolic": lambda g: SymbolicPolicy("trot", NAMES, [formulas(g)]),
        "statewise_symbolic": lambda g: StatewiseSymbolicPolicy("trot", NAMES, [formulas(g)] * 2),
    }
    return {kind: make(np.random.default_rng(1)) for kind, make in makers.items()}


@contextmanager
def time_limit(seconds: int) -> Iterator[None]:
    def stop(*_: Any) -> None:
        raise TimeoutError(f"took more than {seconds} s")

    before = signal.signal(signal.SIGALRM, stop)
    signal.alarm(seconds)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


@pytest.fixture(scope="session")
def load_and_use(samples: Callable[..., tuple[Array, Array]]) -> Callable[[Path], None]:
    """Loads a policy, acts with it and splits its actions."""

    def run(path: Path) -> None:
        policy = load_policy(path)
        rows = samples(5, seed=3)[0][:, : len(policy.observation_names)]
        action = policy(rows)
        assert action.shape == (5, 12)
        assert action.dtype == np.float64
        assert policy(rows[0]).shape == (12,)
        assert isinstance(policy, FormulaPolicy) or np.isfinite(action).all()
        explains = policy.kind not in ("neural", "boosted_trees")
        for joint in (0, "FL_calf") if explains else ():
            parts = policy.explain(rows, joint)
            assert parts.values.shape == (5, len(parts.terms))
            assert len(parts.terms) <= 2 * (MAX_TERMS + N)

    return run


@pytest.fixture
def assert_refused_or_works(load_and_use: Callable, tmp_path: Path) -> Callable[..., None]:
    """Writes a file and loads it: it must be refused in one sentence of its own, or work."""

    def check(
        data: bytes,
        where: str,
        may_work: bool,
        may_be_refused: bool,
        suffix: str = ".safetensors",
    ) -> None:
        path = tmp_path / f"policy{suffix}"
        path.write_bytes(data)
        try:
            with time_limit(SECONDS):
                load_and_use(path)
        except InputError as error:
            refusal = str(error)
            assert may_be_refused, f"{where} was refused: {refusal}"
            assert len(refusal) < MESSAGE_LENGTH, where
            assert "\n" not in refusal, where
            assert refusal.startswith(str(path)), where
        except Exception as error:
            raise AssertionError(f"{where} ended in a {type(error).__name__}: {error}") from error
        else:
            assert may_work, f"{where} was taken"

    return check

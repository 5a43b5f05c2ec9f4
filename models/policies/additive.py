"""Explainable boosting machines, compiled to look-up tables for all joints at once."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from glassgait.models.arrays import Array
from glassgait.models.formulas.expression import variable
from glassgait.models.policies.policy import (
    INTERCEPT,
    ArraySpec,
    Contributions,
    FactoredTerm,
    Indices,
    Policy,
    Reals,
    contributions_of_action,
    rounded,
)
from glassgait.models.robots import quadruped
from glassgait.models.robots.robot import Robot
from glassgait.models.task.observation import symbols_of

if TYPE_CHECKING:
    from interpret.glassbox import ExplainableBoostingRegressor


class AdditivePolicy(Policy):
    """Each action is a constant plus functions of one or two observations (paper, Eq. EBM).

    All joints share the bins: fine ones for functions of one observation, coarse ones for functions
    of two. The bin of a value is the number of cuts that do not exceed it.
    """

    kind = "additive"
    array_specs: ClassVar[Mapping[str, ArraySpec]] = {
        "cuts": Reals("observations cuts", most=np.inf, ascending=True),
        "pair_cuts": Reals("observations pair_cuts", most=np.inf, ascending=True),
        "tables": Reals("joints observations cuts+1"),
        "pairs": Indices("pairs? 2", of="observations"),
        "pair_joints": Indices("pairs", of="joints"),
        "pair_tables": Reals("pairs pair_cuts+1 pair_cuts+1"),
        "deviations": Reals("joints observations cuts+1", least=0.0),
        "pair_deviations": Reals("pairs pair_cuts+1 pair_cuts+1", least=0.0),
        "intercepts": Reals("joints"),
    }
    cuts: Array  # fine cuts of each observation (n, c), ascending and padded with inf
    pair_cuts: Array
    """Coarse cuts of each observation that occurs in a pair (n, d), padded likewise."""
    tables: Array  # functions of one observation (12, n, c + 1)
    pairs: NDArray[np.integer]  # observations of each pair (p, 2)
    pair_joints: NDArray[np.integer]  # joint of each pair (p,)
    pair_tables: Array  # functions of two observations (p, d + 1, d + 1)
    deviations: Array
    """Standard deviation of `tables` between the bagged models; 0 for a single model."""
    pair_deviations: Array
    intercepts: Array

    def __init__(self, gait: str, observation_names: Sequence[str], **options: Any) -> None:
        # Arrays are passed by name only, since several have the same shape.
        super().__init__(gait, observation_names, **options)
        self._feature = np.arange(len(self.cuts))
        self._pair = np.arange(len(self.pairs))
        # Matrix that sums the pairs of each joint (p, 12).
        self._pairs_to_joints = np.eye(len(self.intercepts))[self.pair_joints]

    @classmethod
    def compile(
        cls,
        gait: str,
        observation_names: tuple[str, ...],
        models: "Sequence[ExplainableBoostingRegressor]",
        robot: Robot | None = None,
    ) -> Self:
        """Compiles one fitted interpret model per joint; all must have the same bins."""
        # Bins, shared by all joints.
        n = len(observation_names)
        fine = [_cuts_of(models, feature, 0) for feature in range(n)]
        coarse = [_cuts_of(models, feature, 1) for feature in range(n)]
        cuts, pair_cuts = _padded(fine), _padded(coarse)
        width, size = cuts.shape[1] + 1, pair_cuts.shape[1] + 1

        # Values and deviations of each function.
        tables = np.zeros((2, len(models), n, width))
        pairs, pair_joints, pair_tables = [], [], []
        for joint, model in enumerate(models):
            scores_and_deviations = zip(model.term_scores_, model.standard_deviations_, strict=True)
            for term, values in zip(model.term_features_, scores_and_deviations, strict=True):
                # The first bin is for missing values and the last for unseen ones.
                inner = np.array(values)[(slice(None), *[slice(1, -1)] * len(term))]
                if len(term) == 1:
                    tables[:, joint, term[0], : inner.shape[1]] = inner
                else:
                    table = np.zeros((2, size, size))
                    table[:, : inner.shape[1], : inner.shape[2]] = inner
                    pairs.append(term)
                    pair_joints.append(joint)
                    pair_tables.append(table)
        paired = np.array(pair_tables).reshape(-1, 2, size, size)
        return cls(
            gait,
            observation_names,
            robot=robot,
            cuts=cuts,
            pair_cuts=pair_cuts,
            tables=tables[0],
            pairs=np.array(pairs, dtype=np.int64).reshape(-1, 2),
            pair_joints=np.array(pair_joints, dtype=np.int64),
            pair_tables=paired[:, 0],
            deviations=tables[1],
            pair_deviations=paired[:, 1],
            intercepts=np.array([float(np.ravel(model.intercept_)[0]) for model in models]),
        )

    def act(self, observation: Array) -> Array:
        rows = observation.reshape(-1, observation.shape[-1])
        single, paired = self._look_up(rows)
        action = single.sum(axis=-1).T + self.intercepts + paired @ self._pairs_to_joints
        return action.reshape(*observation.shape[:-1], -1)

    def _look_up(self, rows: Array) -> tuple[Array, Array]:
        """Returns the values (12, m, n) and (m, p) of all functions at rows (m, n)."""
        single = self.tables[:, self._feature, _digitize(rows, self.cuts)]
        if not len(self.pairs):
            return single, np.zeros((len(rows), 0))
        coarse = _digitize(rows, self.pair_cuts)
        first, second = coarse[:, self.pairs[:, 0]], coarse[:, self.pairs[:, 1]]
        return single, self.pair_tables[self._pair, first, second]

    def compact(self) -> Self:
        # Deviations do not affect actions; observations outside all pairs need no coarse bins.
        paired = np.isin(self._feature, self.pairs)
        rows = zip(self.pair_cuts, paired, strict=True)
        pair_cuts = _padded([row[np.isfinite(row) & is_paired] for row, is_paired in rows])
        bins = slice(pair_cuts.shape[1] + 1)
        return self.with_arrays(
            pair_cuts=pair_cuts,
            tables=rounded(self.tables, np.float32),
            pair_tables=rounded(self.pair_tables[:, bins, bins], np.float32),
            deviations=rounded(self.deviations, np.float16),
            pair_deviations=rounded(self.pair_deviations[:, bins, bins], np.float16),
        )

    def factored_terms(self, joint: int) -> tuple[FactoredTerm, ...]:
        pairs = self.pairs[self.pair_joints == joint].tolist()
        arguments = [(index,) for index in range(len(self.observation_names))] + pairs
        robot = self.robot
        intercept = robot.default_stance[joint] + robot.action_scale * self.intercepts[joint]
        functions = (FactoredTerm((), tuple(map(variable, indices))) for indices in arguments)
        return (FactoredTerm((float(intercept),), ()), *functions)

    def importance(self, observations: Array) -> tuple[str, Array]:
        """Returns the mean size of each observation's functions; that of a pair is split in two."""
        single, pairs = self._look_up(observations)
        single = np.moveaxis(single, 0, 1)
        importances = np.abs(single - single.mean(axis=0)).mean(axis=0)
        sizes = np.abs(pairs - pairs.mean(axis=0)).mean(axis=0)
        for (first, second), joint, size in zip(self.pairs, self.pair_joints, sizes, strict=True):
            importances[joint, [first, second]] += 0.5 * size
        return "terms", importances

    def explain(self, observation: Array, joint: int | str) -> Contributions:
        joint = quadruped.joint_index(joint)
        rows = observation.reshape(-1, observation.shape[-1])
        single, paired = self._look_up(rows)
        constant = np.full((len(rows), 1), self.intercepts[joint])
        values = np.concatenate(
            [constant, single[joint], paired[:, self.pair_joints == joint]], axis=1
        )
        values = values.reshape(*observation.shape[:-1], -1)
        # Functions of one quantity come first, then functions of two.
        names, pairs = symbols_of(self.observation_names), self.pairs[self.pair_joints == joint]
        paired_names = (f"{names[first]} & {names[second]}" for first, second in pairs)
        terms = (INTERCEPT, *names, *paired_names)
        return contributions_of_action(self.robot, terms, values, joint)


def _digitize(rows: Array, cuts: Array) -> NDArray[np.int64]:
    if len(rows) == 1:
        # For one row, comparing with all cuts at once is faster than one search per observation.
        # NaN falls into the last bin, as below.
        return np.sum(~(rows[0][:, None] < cuts), axis=1)[None, :]
    columns = zip(cuts, rows.T, strict=True)
    bins = [np.searchsorted(edges, values, side="right") for edges, values in columns]
    return np.stack(bins, axis=1)


def _cuts_of(models: Sequence[Any], feature: int, level: int) -> Array:
    """Returns an observation's fine cuts (level 0), or its coarse cuts (1) if a pair uses it."""
    cuts = []
    for model in models:
        if level == 0 or any(len(term) > 1 and feature in term for term in model.term_features_):
            bins = model.bins_[feature]
            cuts.append(np.asarray(bins[min(level, len(bins) - 1)], dtype=float))
    if any(not np.array_equal(edges, cuts[0]) for edges in cuts):
        raise ValueError(f"additive: the models bin observation {feature} differently")
    return cuts[0] if cuts else np.zeros(0)


def _padded(cuts: Sequence[Array]) -> Array:
    width = max(1, *map(len, cuts))
    return np.array([np.pad(row, (0, width - len(row)), constant_values=np.inf) for row in cuts])

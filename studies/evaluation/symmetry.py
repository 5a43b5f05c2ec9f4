"""How alike a policy treats left and right: of its actions, and of what it looks at."""

from dataclasses import dataclass, replace
from itertools import product
from typing import Annotated, Any, ClassVar

import numpy as np
import pandas as pd
from annotated_types import Ge
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from sklearn.metrics import r2_score

from glassgait.diagrams.scenario import TRAINING
from glassgait.models.arrays import Array
from glassgait.models.policies.neural import NeuralPolicy
from glassgait.models.policies.policy import Policy
from glassgait.models.robots import quadruped
from glassgait.models.settings import Count
from glassgait.models.task.observation import entries_of
from glassgait.models.task.symmetry import (
    REFLECT_JOINTS,
    Reflection,
    mirrored_states,
    reflect_observation,
)
from glassgait.studies.common.cases import Case
from glassgait.studies.common.experiment import Experiment, Report
from glassgait.studies.common.figures import COLUMN_WIDTH, styled, subplots
from glassgait.studies.common.tables import json_records
from glassgait.studies.distillation.collection import collect_alone
from glassgait.studies.distillation.students.dataset import Dataset
from glassgait.studies.distillation.students.registry import policy_color, policy_title
from glassgait.studies.importance.measures import permutation_importance

LEFT_LEGS = ("FL", "RL")

SIDES = ("own", "other")
"""Where the legs are that are observed, seen from the joint that acts."""

NORMAL_QUANTILE = 1.96
"""Standard errors that half of a 95 % interval takes."""


def mirror_r2(
    policy: Policy,
    samples: Dataset,
    reflect: Reflection,
    generator: np.random.Generator,
    resamples: int,
) -> tuple[float, float, float]:
    """Measures how well a policy's actions are predicted by its actions in the mirror.

    Args:
        policy: The policy π.
        samples: Observations o that robots visited, each robot an episode; labels do not count.
        reflect: The mirror M of observations.
        generator: Source of randomness.
        resamples: Draws of as many robots, with replacement, that the interval is of.

    Returns:
        R² of M π(M o) against π(o), mean over the joints, and the ends of its 95 % interval.
    """
    own = policy(samples.observations)
    image = REFLECT_JOINTS(policy(reflect(samples.observations)))
    robots, robot_of_sample = np.unique(samples.episodes, return_inverse=True)

    def mean_r2(draws: Array) -> float:
        """Takes how often each robot was drawn (n_robots,)."""
        return float(r2_score(own, image, sample_weight=draws[robot_of_sample]))

    equal = np.full(len(robots), 1.0 / len(robots))
    drawn = generator.multinomial(len(robots), equal, size=resamples).astype(float)
    low, high = np.quantile([mean_r2(draws) for draws in drawn], (0.025, 0.975))
    return mean_r2(np.ones(len(robots))), float(low), float(high)


def drawn_importances(
    policy: Policy,
    samples: Dataset,
    generator: np.random.Generator,
    *,
    n_samples: int,
    repeats: int,
) -> Array:
    """Measures permutation importances for the policy's own actions, on robots drawn anew.

    How much they differ shows what chance does: which robots and instants were met, and how values
    were shuffled.

    Args:
        policy: The policy.
        samples: Observations that robots visited, each robot an episode; labels do not count.
        generator: Source of randomness.
        n_samples: Samples of a repeat.
        repeats: Draws of robots, with replacement, and of samples of theirs.

    Returns:
        Losses of R² (repeats, 12, n).
    """
    robots = np.unique(samples.episodes)
    own = replace(samples, actions=policy(samples.observations))
    losses = []
    for _ in range(repeats):
        drawn = generator.choice(robots, size=len(robots))
        theirs = np.concatenate([np.flatnonzero(own.episodes == one) for one in drawn])
        rows = generator.choice(theirs, size=n_samples)
        part = Dataset(own.observations[rows], own.actions[rows], own.episodes[rows])
        losses.append(permutation_importance(policy, part, generator, repeats=1)[0])
    return np.array(losses)


def left_right_table(
    importances: Array, names: tuple[str, ...], reflect: Reflection
) -> pd.DataFrame:
    """Sets the importance of the left legs' observations beside that of the right legs'.

    An observation i of a left leg for a joint j is paired with its image M(i) for the image M(j).

    Args:
        importances: What `drawn_importances` returned (repeats, 12, n).
        names: Names of the observations.
        reflect: The mirror of observations.

    Returns:
        A row for each joint type, kind of observation that legs have, and `side`, the legs being on
        the joints' `own` side or on the `other`: `left` and `right`, added up over the observations
        of two legs and averaged over two joints, with half their 95 % intervals, `left_ci` and
        `right_ci`; `left_share`, the left's share of both, NaN where both are 0; and `agree`,
        whether the intervals overlap.
    """
    images = importances[:, REFLECT_JOINTS.index][:, :, reflect.index]
    entries = entries_of(names)
    kinds = dict.fromkeys(entry.merged_name for entry in entries if entry.leg is not None)
    rows = []
    for joint, kind, side in product(quadruped.LEG_JOINTS, kinds, SIDES):
        joints = [
            name.endswith(joint) and (name[:2] in LEFT_LEGS) == (side == "own")
            for name in quadruped.JOINTS
        ]
        columns = [entry.merged_name == kind and entry.leg in LEFT_LEGS for entry in entries]
        left, right = (
            values[:, joints][:, :, columns].sum(axis=2).mean(axis=1)
            for values in (importances, images)
        )
        place = {"joint": joint, "observation": kind, "side": side}
        rows.append({**place, **_compared(left, right)})
    return pd.DataFrame(rows)


def _compared(left: Array, right: Array) -> dict[str, float | bool]:
    """Compares importances (repeats,) of both sides."""
    means = float(left.mean()), float(right.mean())
    halves = [NORMAL_QUANTILE * float(side.std(ddof=1)) for side in (left, right)]
    whole = sum(means)
    return {
        "left": means[0],
        "left_ci": halves[0],
        "right": means[1],
        "right_ci": halves[1],
        "left_share": means[0] / whole if whole > 0 else float("nan"),
        "agree": abs(means[0] - means[1]) <= sum(halves),
    }


MARKERS = dict(zip(quadruped.LEG_JOINTS, ("o", "^", "s"), strict=True))

LEAST = 1e-4
"""Importances below it are drawn on the edge."""


@styled
def symmetry_figure(table: pd.DataFrame, left_right: pd.DataFrame, title: str) -> Figure:
    """Draws left importance against right, a panel a policy; alike on both sides, on the diagonal.

    Pairs that both are 0 are left out.

    Args:
        table: A row a policy, as `measure_symmetry` returns it.
        left_right: What `left_right_table` returned for every policy.
        title: Title of the figure.
    """
    columns = min(3, len(table))
    rows = -(-len(table) // columns)
    figure, panels = subplots(
        rows,
        columns,
        figsize=(max(columns, 2) * 0.68 * COLUMN_WIDTH, 2.2 * rows + 0.5),
        squeeze=False,
        sharex=True,
        sharey=True,
    )
    greatest = float(np.nanmax(left_right[["left", "right"]].to_numpy(), initial=1.0))
    for panel in panels.flat[len(table) :]:
        panel.set_visible(False)
    for panel, row in zip(panels.flat, table.itertuples(index=False), strict=False):
        name = str(row.policy)
        _draw_pairs(panel, left_right[left_right["policy"] == name], policy_color(name))
        panel.set_title(f"{policy_title(name)}, R² = {row.r2:.2f}")
        panel.set(xscale="log", yscale="log")
        panel.set(xlim=(0.7 * LEAST, 2 * greatest), ylim=(0.7 * LEAST, 2 * greatest))
        panel.set_aspect("equal")
    for panel in panels[:, 0]:
        panel.set_ylabel("importance of right legs")
    for panel in panels.flat[max(0, len(table) - columns) : len(table)]:
        panel.set_xlabel("importance of left legs")
        panel.tick_params(labelbottom=True)
    figure.legend(handles=_legend(), loc="outside upper center", ncols=4, title=title)
    return figure


def _draw_pairs(panel: Axes, pairs: pd.DataFrame, color: str) -> None:
    edges = (0.1 * LEAST, 1e3)
    panel.plot(edges, edges, color="0.7", linewidth=0.8)
    pairs = pairs[pairs["left"] + pairs["right"] > 0]
    for joint, marker in MARKERS.items():
        for agree in (True, False):
            own = pairs[(pairs["joint"] == joint) & (pairs["agree"] == agree)]
            left, right = (np.maximum(own[side], LEAST) for side in ("left", "right"))
            panel.errorbar(
                left,
                right,
                xerr=np.minimum(own["left_ci"], 0.99 * left),
                yerr=np.minimum(own["right_ci"], 0.99 * right),
                fmt=marker,
                color=color,
                markersize=3.5,
                markerfacecolor=color if agree else "white",
                markeredgewidth=0.8,
                elinewidth=0.4,
            )


def _legend() -> list[Line2D]:
    style = {"color": "0.3", "linestyle": "none", "markersize": 3.5}
    handles = [
        Line2D([], [], marker=marker, label=joint, **style) for joint, marker in MARKERS.items()
    ]
    hollow = {**style, "markerfacecolor": "white"}
    return [*handles, Line2D([], [], marker="D", label="hollow: intervals apart", **hollow)]


RESAMPLES = 1000
"""Draws of robots that the interval of an R² is of."""


@dataclass(frozen=True)
class Symmetry(Experiment):
    """Measure whether an expert and its students treat left and right alike.

    Gaits whose machines favour a side are left out.

    Attributes:
        n_steps: Control steps of each robot that the expert is rolled out with.
        n_samples: Samples of a repeat of importances.
        repeats: Repeats of importances, each with robots drawn anew.
    """

    title: ClassVar[str] = "evaluate symmetry"
    mirrored: ClassVar[bool] = True
    by_expert: ClassVar[bool] = True
    scenario: ClassVar[tuple[str, ...]] = (TRAINING,)
    n_seeds: ClassVar[int] = 1

    n_robots: Annotated[Count, Ge(2)] = 26
    n_steps: Count = 250
    n_samples: Annotated[Count, Ge(2)] = 500
    repeats: Annotated[Count, Ge(2)] = 20

    def measure(self, case: Case) -> pd.DataFrame:
        """Measures a policy where its expert goes.

        Returns:
            A row: `r2` of its mirror image against itself, the ends `r2_low` and `r2_high` of its
            95 % interval, `left_share` of all importance of legs, of how many `pairs` left and
            right `agree`, and the rows of `left_right_table`.
        """
        policy, expert, seed = case.alone.policy, case.alone.expert, case.seed
        assert isinstance(expert, NeuralPolicy)
        samples = collect_alone(
            case.gait,
            expert,
            expert,
            n_robots=self.n_robots,
            n_steps=self.n_steps,
            seed=case.seed,
        )
        mirrored = mirrored_states(case.gait)
        assert mirrored is not None
        reflect = reflect_observation(expert.observation_names, mirrored)
        # Every policy meets the same draws.
        generators = (np.random.default_rng([seed, i]) for i in (1, 2))
        r2, low, high = mirror_r2(policy, samples, reflect, next(generators), RESAMPLES)
        importances = drawn_importances(
            policy, samples, next(generators), n_samples=self.n_samples, repeats=self.repeats
        )
        table = left_right_table(importances, policy.observation_names, reflect)
        left, right = table["left"].sum(), table["right"].sum()
        row: dict[str, Any] = {
            "r2": r2,
            "r2_low": low,
            "r2_high": high,
            "left_share": left / (left + right) if left + right > 0 else float("nan"),
            "agree": int(table["agree"].sum()),
            "pairs": len(table),
            "left_right": table.to_dict(orient="list"),
        }
        return pd.DataFrame([row])

    def report(self, table: pd.DataFrame) -> Report:
        """Reports how alike left and right are to each policy."""
        parts = [
            pd.DataFrame({"policy": row["policy"], **row["left_right"]})
            for row in table.to_dict(orient="records")
        ]
        left_right, gait = pd.concat(parts, ignore_index=True), str(table["gait"].iloc[0])
        policies = table.drop(columns=["gait", "scenario", "seed", "left_right"])
        return Report(
            tables={"symmetry": policies, "left_right": left_right},
            metrics={"symmetry": json_records(policies), "left_right": json_records(left_right)},
            figures={"symmetry": symmetry_figure(policies, left_right, gait.capitalize())},
            shown={f"{gait}: left and right": titled(policies)},
        )


def titled(table: pd.DataFrame) -> pd.DataFrame:
    """Returns the table of policies for reading."""
    intervals = zip(table["r2"], table["r2_low"], table["r2_high"], strict=True)
    agreeing = zip(table["agree"], table["pairs"], strict=True)
    return pd.DataFrame(
        {
            "policy": table["policy"].map(policy_title),
            "R² in the mirror": [
                f"{r2:.3f} ({low:.3f} to {high:.3f})" for r2, low, high in intervals
            ],
            "left share of importance": table["left_share"].round(3),
            "left and right agree": [f"{agree} of {pairs}" for agree, pairs in agreeing],
        }
    )

"""`glassgait evaluate symmetry`: whether policies treat left and right alike."""

from dataclasses import dataclass, replace
from typing import Annotated, Any, ClassVar

import numpy as np
import pandas as pd
from annotated_types import Ge

from glassgait.diagrams.scenario import TRAINING
from glassgait.models.errors import InputError
from glassgait.models.policies.neural import NeuralPolicy
from glassgait.models.settings import Count
from glassgait.models.task.gait import load_gait
from glassgait.models.task.symmetry import mirrored_states, reflect_observation
from glassgait.studies.common.cases import Case
from glassgait.studies.common.console import say
from glassgait.studies.common.experiment import Experiment, Report
from glassgait.studies.common.sweep import gaits_named
from glassgait.studies.common.tables import json_records
from glassgait.studies.distillation.collection import collect_alone
from glassgait.studies.distillation.students.registry import student_title
from glassgait.studies.evaluation.symmetry_figures import symmetry_figure
from glassgait.studies.evaluation.symmetry_measures import (
    drawn_importances,
    left_right_table,
    mirror_r2,
)

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
    scenario: ClassVar[tuple[str, ...]] = (TRAINING,)
    n_seeds: ClassVar[int] = 1

    n_robots: Annotated[Count, Ge(2)] = 26
    n_steps: Count = 250
    n_samples: Annotated[Count, Ge(2)] = 500
    repeats: Annotated[Count, Ge(2)] = 20

    def run(self) -> None:
        """Runs the study of those gaits that have a mirror image.

        Raises:
            InputError: if none has.
        """
        kept, named = [], gaits_named(self.gait)
        for name in named:
            if mirrored_states(load_gait(name)) is None:
                say(f"{name}: has no mirror image, since its machine favours a side; left out")
            else:
                kept.append(name)
        if not kept:
            raise InputError("--gait: no gait of these has a mirror image; name another")
        output = self.output
        if output is not None and len(named) > 1 == len(kept):
            output /= load_gait(kept[0]).name
        super(Symmetry, replace(self, gait=tuple(kept), output=output)).run()

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
            "policy": table["policy"].map(student_title),
            "R² in the mirror": [
                f"{r2:.3f} ({low:.3f} to {high:.3f})" for r2, low, high in intervals
            ],
            "left share of importance": table["left_share"].round(3),
            "left and right agree": [f"{agree} of {pairs}" for agree, pairs in agreeing],
        }
    )

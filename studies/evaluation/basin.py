"""`glassgait evaluate basin`: which pushes a policy survives, predicted, and counted afterwards."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

import numpy as np
import pandas as pd
from annotated_types import Ge

from glassgait.diagrams.scenario import TRAINING
from glassgait.models.arrays import Array
from glassgait.models.settings import Count
from glassgait.models.stride_map import jacobians
from glassgait.models.task.command import Command
from glassgait.studies.common.cases import Case
from glassgait.studies.common.experiment import Report
from glassgait.studies.common.tables import json_records
from glassgait.studies.distillation.students.registry import policy_title
from glassgait.studies.evaluation.basin_figure import basin_figure
from glassgait.studies.evaluation.push_experiment import Phases, PushExperiment, PushSpeed
from glassgait.studies.evaluation.push_sets import (
    PUSHED,
    SMALLEST,
    Circle,
    FittedConics,
    OrbitEllipses,
    Prediction,
    PushOutcomes,
    PushSet,
    calibrated,
)
from glassgait.studies.evaluation.pushing import PushList, push_each
from glassgait.studies.evaluation.stride_analysis import find_orbits
from glassgait.studies.evaluation.strides import StrideMap

N_STRIDES, STEP_SIZE = 60, 3e-3
"""Strides that an orbit has to settle, and the differences by which the map is differentiated
(units)."""


@dataclass(frozen=True)
class Basin(PushExperiment):
    """Predict which pushes a policy survives, and count on others how often that is true.

    Pushes are drawn evenly by direction, speed and phase of the stride. Those of one phase meet the
    same robot, of which intervals know nothing.

    Attributes:
        greatest_speed: The most that a push adds to the trunk's velocity (m/s).
        n_fit: Pushes that sets are fitted to.
        n_calibration: Other pushes, by which is decided how large a set may be.
        n_test: Other pushes still, on which is counted how many of a set's are survived.
    """

    title: ClassVar[str] = "evaluate basin"

    greatest_speed: PushSpeed = 3.0
    n_fit: Annotated[Count, Ge(50)] = 1000
    n_calibration: Annotated[Count, Ge(SMALLEST)] = 1000
    n_test: Annotated[Count, Ge(50)] = 1000
    n_phases: Phases = 64

    def measure(self, case: Case) -> pd.DataFrame:
        """Pushes the robots of one policy: a row of all pushes, and of its stride map."""
        counts = (self.n_fit, self.n_calibration, self.n_test)
        batches = [
            _outcomes_to_plain(self._push(case, count, np.random.default_rng([case.seed, i])))
            for i, count in enumerate(counts)
        ]
        return pd.DataFrame([{"batches": batches, "forms": self._forms(case)}])

    def report(self, table: pd.DataFrame) -> Report:
        """Reports how many of each set's pushes are survived."""
        records: list[Any] = table.to_dict(orient="records")
        found = {str(row["policy"]): _predictions(row) for row in records}
        gait = str(table["gait"].iloc[0])
        rows = [
            {"policy": policy_title(policy), **one.row()}
            for policy, predictions in found.items()
            for one in predictions
        ]
        summed = pd.DataFrame(rows)
        return Report(
            tables={
                "summary": summed,
                "pushes": _push_table(found),
                "conics": _weights_table(found),
            },
            metrics=json_records(summed),
            figures={
                "basin": basin_figure(found, f"{gait.capitalize()} at {self.command.speed:g} m/s")
            },
            shown={f"{gait}: pushes that are predicted to be survived": summed},
            lines=[line for row in records for line in self._remarks(row)],
        )

    def _remarks(self, row: Mapping[str, Any]) -> list[str]:
        """Says what is missing of a policy's pushes and sets."""
        title, remarks = policy_title(row["policy"]), []
        asked = self.n_fit + self.n_calibration + self.n_test
        came = sum(len(batch["survived"]) for batch in row["batches"])
        if came < asked:
            remarks.append(f"{title}: {asked - came} of {asked} robots fell before their push")
        if row["forms"] is None:
            stepwise = self.controllers[row["gait"]][row["policy"]].policy.capabilities.stepwise
            why = "has no derivatives" if stepwise else "has no fixed point that attracts"
            remarks.append(f"{title}: its stride map {why}")
        elif row["scenario"] != TRAINING:
            remarks.append(f"{title}: its stride map is that of flat ground, without noise")
        return remarks

    def _push(self, case: Case, count: int, generator: np.random.Generator) -> PushOutcomes:
        pushes = PushList(
            direction=generator.uniform(0.0, 2.0 * np.pi, count),
            speed=generator.uniform(0.0, self.greatest_speed, count),
            phase=generator.integers(self.n_phases, size=count),
        )
        pushed = push_each(
            case.gait,
            case.alone,
            self.commanded(case),
            pushes,
            self.n_phases,
            n_steps=self.n_steps,
            generator=generator,
        )
        ways = np.stack([np.cos(pushes.direction), np.sin(pushes.direction)], axis=1)
        velocity, phase = pushes.speed[:, None] * ways, pushes.phase / self.n_phases
        # A robot that fell before its phase was never pushed.
        came = pushed.came
        return PushOutcomes(velocity[came], phase[came], pushed.survived[came])

    def _forms(self, case: Case) -> list[Any] | None:
        """Returns the forms of `OrbitEllipses`; None where no fixed point attracts."""
        command = self.command
        strides = StrideMap(
            case.gait,
            case.alone,
            Command(np.array([[command.speed, command.yaw_rate]]), np.array([command.dwell * 1.0])),
        )
        if strides.is_stepwise:
            return None
        first = strides.first_points()
        fixed = find_orbits(strides, first, n_strides=N_STRIDES, differentiable=True).fixed
        if not np.isfinite(fixed).all():
            return None
        (jacobian,) = jacobians(strides, fixed, STEP_SIZE)
        if not np.isfinite(jacobian).all() or np.abs(np.linalg.eigvals(jacobian)).max() >= 1.0:
            return None
        (n_steps,) = strides.stride(fixed, np.zeros(1, dtype=np.int64)).n_steps
        ends = np.array([_end(strides, fixed[0], step) for step in range(n_steps)])
        return OrbitEllipses.of(jacobian, ends).forms.tolist() if np.isfinite(ends).all() else None


def _end(strides: StrideMap, fixed: Array, step: int) -> Array:
    """Returns what small pushes at a step become at the stride's end (d, 2; units per m/s)."""
    sides = np.arange(4) * np.pi / 2
    ahead, left, back, right = strides.pushed(fixed, step, sides, PUSHED)
    return np.stack([ahead - back, left - right], axis=1) / (2.0 * PUSHED)


def _predictions(row: Mapping[str, Any]) -> list[Prediction]:
    """Builds, calibrates and tests every set of one policy."""
    fit, calibration, test = map(_outcomes_from_plain, row["batches"])
    sets: list[PushSet] = [Circle()]
    if row["forms"] is not None:
        sets.append(OrbitEllipses(np.array(row["forms"])))
    sets.append(FittedConics.fit(fit))
    return [Prediction(own, calibrated(own, fit, calibration), test) for own in sets]


def _push_table(found: Mapping[str, Sequence[Prediction]]) -> pd.DataFrame:
    """Makes a row of each push that was tested."""
    parts = []
    for policy, predictions in found.items():
        test = predictions[0].test
        columns = {
            "policy": policy_title(policy),
            "forward (m/s)": test.velocity[:, 0],
            "left (m/s)": test.velocity[:, 1],
            "phase": test.phase,
            "survived": test.survived,
        }
        columns |= {f"predicted by {one.own.title}": one.margins >= 0.0 for one in predictions}
        parts.append(pd.DataFrame(columns))
    return pd.concat(parts, ignore_index=True)


def _weights_table(found: Mapping[str, Sequence[Prediction]]) -> pd.DataFrame:
    """Makes a row of each weight of the fitted conics: a push is in where their sum is above 0."""
    rows = []
    for policy, predictions in found.items():
        for one in predictions:
            if not isinstance(one.own, FittedConics):
                continue
            weights = one.own.weights.copy()
            weights[0, 0] -= one.threshold
            for term, own in zip(FittedConics.TERMS, weights, strict=True):
                waves = dict(zip(FittedConics.WAVES, own, strict=True))
                rows.append({"policy": policy_title(policy), "term": term, **waves})
    return pd.DataFrame(rows)


def _outcomes_to_plain(own: PushOutcomes) -> dict[str, list[Any]]:
    return {name: values.tolist() for name, values in vars(own).items()}


def _outcomes_from_plain(own: Mapping[str, Any]) -> PushOutcomes:
    velocity = np.array(own["velocity"], dtype=float).reshape(-1, 2)
    return PushOutcomes(velocity, np.array(own["phase"]), np.array(own["survived"], dtype=bool))

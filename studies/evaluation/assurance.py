"""`glassgait evaluate assurance`: a student acts in distribution, the expert elsewhere."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from functools import cached_property, partial
from typing import Annotated, Any, ClassVar

import pandas as pd
from annotated_types import Ge, Lt, MinLen

from glassgait.diagrams.scenario import TRAINING, Scenario, load_scenario
from glassgait.models.certificates.observation_box import ObservationBox
from glassgait.models.errors import InputError
from glassgait.models.policies.controller import AlternatingController, Controller, alone
from glassgait.models.settings import DISTINCT, FEW, Count, Seed, Share
from glassgait.models.task.termination import limits_of
from glassgait.studies.common.cases import Case, not_finite_lines, score
from glassgait.studies.common.console import say
from glassgait.studies.common.experiment import (
    PolicyNames,
    Report,
    RolloutExperiment,
    ScenarioNames,
)
from glassgait.studies.common.rollouts import SELECTION_SEEDS, RolloutConfig, refuse_to_select
from glassgait.studies.common.scores import summarize_against, wilson_interval
from glassgait.studies.common.tables import json_records
from glassgait.studies.distillation.students.registry import policy_title
from glassgait.studies.evaluation.assurance_calibration import (
    EXPERT,
    STUDENT,
    Calibration,
    calibrate,
    has_ensemble,
    period_of,
    share_called,
)
from glassgait.studies.evaluation.assurance_figures import draw_calls, draw_pushed, push_one

PUSHED = "push_1.0"
"""The world in which it is tried whether overruns predict falls."""

WORLDS = (TRAINING, PUSHED, "friction_0.5", "latency_20ms")


@dataclass(frozen=True)
class Assurance(RolloutExperiment):
    """Let a student act in distribution, and the expert elsewhere, and count falls.

    Attributes:
        policy: The student: its kind, or the path of its file.
        calls: Shares of steps in which the expert may be called in the training scenario; each
            gives limits, and a schedule with as many calls.
        quantile: Share of the observations in the training scenario that each end of a range
            leaves out.
        return_steps: Control steps inside after which the student acts again.
        disagreement: Watch, beside the region, how far the models of an additive student disagree.
        nominal_robots: Robots in the training scenario that the student leads, and as many that the
            expert leads, for the region and the limits.
        pushed_robots: Robots that the student leads under pushes, to see what predicts falls.
        calibration_seed: Seed of both; other than those of the rollouts.
    """

    title: ClassVar[str] = "evaluate assurance"
    of_students: ClassVar[bool] = True
    by_expert: ClassVar[bool] = True
    one: ClassVar[tuple[str, ...]] = ("policy",)
    # A schedule calls the expert as often as the monitor did with the robots of all seeds.
    pooled: ClassVar[bool] = True
    axes: ClassVar[Mapping[str, str]] = {"acting": "limits"}
    prepared: ClassVar[tuple[str, ...]] = ("calibration",)

    policy: PolicyNames = ("sparse_formula",)
    scenario: ScenarioNames = WORLDS
    calls: Annotated[tuple[Share, ...], MinLen(1), FEW, DISTINCT] = (0.02,)
    quantile: Annotated[float, Ge(0.0), Lt(0.5)] = 0.001
    return_steps: Count = 25
    disagreement: bool = False
    nominal_robots: Count = 26
    pushed_robots: Count = 130
    calibration_seed: Seed = SELECTION_SEEDS[0]

    def __post_init__(self) -> None:
        """
        Raises:
            InputError: if a value is out of range, or the limits would be judged by the very
                robots that they were chosen with.
        """
        super().__post_init__()
        refuse_to_select([self.calibration_seed], f"{self.title}: calibration_seed")
        if {self.calibration_seed, self.calibration_seed + 1} & {*self.seeds}:
            raise InputError(
                f"{self.title}: calibration_seed is {self.calibration_seed}, and rollouts have it "
                "or the next one; name another"
            )

    @property
    def limits(self) -> dict[str, float | None]:
        """What acts: the expert, the student, or both by the limits of a share of calls."""
        return {EXPERT: None, STUDENT: None} | {f"{calls:g}": calls for calls in self.calls}

    @property
    def alone(self) -> AlternatingController:
        """The student alone.

        Raises:
            InputError: if it observes other things than the expert, or must be an ensemble.
        """
        ((name, found),) = self.controllers[self.gaits[0].name].items()
        if found.student is None:
            raise InputError(
                f"--policy {name}: observes other things than the expert; name another student"
            )
        if self.disagreement and not has_ensemble(found.student):
            raise InputError(
                f"{self.title}: disagreement is set, but {name} of the {self.gaits[0].name} is no "
                "ensemble; name --policy ebm, or leave it out"
            )
        return found

    @cached_property
    def calibration(self) -> Calibration:
        """The region and the limits, and what they predict."""
        gait, student = self.gaits[0], self.alone
        say(
            f"{gait.name}: robots walk in the training scenario and under pushes, for the region "
            "and the limits"
        )
        training, pushes = (
            replace(own, limits=limits_of(self.falls, own.limits))
            for own in (Scenario(), load_scenario(PUSHED))
        )
        nominal = RolloutConfig(
            self.nominal_robots, self.n_steps, self.calibration_seed, 1, self.speed_range
        )
        pushed = replace(nominal, n_robots=self.pushed_robots, seed=self.calibration_seed + 1)

        def made() -> dict[str, Any]:
            return calibrate(
                gait,
                {EXPERT: alone(student.expert), STUDENT: student},
                (training, pushes),
                (nominal, pushed),
                calls=self.calls,
                quantile=self.quantile,
                return_steps=self.return_steps,
                disagreement=self.disagreement,
            ).to_plain()

        return Calibration.from_plain(self.once("calibration", made), student.policy)

    def measure(self, case: Case) -> pd.DataFrame:
        """Rolls the expert or the student out alone, or both, assured and by a schedule.

        Returns:
            Scores, a row a robot, with the `controller`.
        """
        student, calls = case.alone, case.values["acting"]
        if calls is None:
            if case.labels["acting"] == EXPERT:
                return self._scores(case, EXPERT, alone(student.expert))
            return self._scores(case, case.labels["policy"], student)
        assured = self._scores(case, f"assured_{calls:g}", self.calibration.assured(student, calls))
        schedule = replace(student, period=period_of(share_called(assured)))
        return pd.concat([assured, self._scores(case, f"schedule_{calls:g}", schedule)])

    def report(self, table: pd.DataFrame) -> Report:
        """Reports falls and shares of the expert, and what the calibration predicts."""
        (gait,), calibration, titles = self.gaits, self.calibration, self.scenario_titles
        table = table.drop(columns="policy").rename(columns={"controller": "policy"})
        scheduled = table["policy"].str.startswith("schedule_")
        table = pd.concat([table[~scheduled], table[scheduled]], ignore_index=True)
        found = assurance_table(table, titles)
        pushed = self.once("pushed_robot", lambda: push_one(gait, self.alone, calibration))
        return Report(
            tables={
                "worlds": readable_table(found),
                "fall_prediction": calibration.fall_prediction,
                "warnings": calibration.warnings,
                "rescues": calibration.rescues,
            },
            metrics=_metrics(found, calibration),
            figures={
                "calls": draw_calls(found, titles),
                "pushed_robot": draw_pushed(pushed, calibration),
            },
            shown={f"{gait.name}: falls, and shares of the expert": readable_table(found)},
            lines=not_finite_lines(table),
            files=self._boxes(),
        )

    def _scores(self, case: Case, name: str, controller: Controller) -> pd.DataFrame:
        """Rolls out and scores the robots of all seeds."""
        parts = []
        for seed in self.seeds:
            own = replace(case, controller=controller, seed=seed)
            parts.append(score(own.with_config(self.rollouts(own))))
        return pd.concat(parts, ignore_index=True).assign(controller=name)

    def _boxes(self) -> dict[str, Any]:
        """Returns what writes the region, a box for each state of the gait's machine."""
        (gait,), region, student = self.gaits, self.calibration.region, self.alone
        (name,) = self.controllers[gait.name]
        measured = (
            f"{self.nominal_robots} robots each of expert and {name} in the training scenario, "
            f"seed {self.calibration_seed}, machine state"
        )
        files = {}
        for i, state in enumerate(gait.states):
            box = ObservationBox(student.robot, region.names, region.lower[i], region.upper[i])
            files[f"region_{state}.yaml"] = partial(
                box.save, gait=gait, measured=f"{measured} {state}"
            )
        return files


def _metrics(table: pd.DataFrame, calibration: Calibration) -> dict[str, Any]:
    return {
        "worlds": json_records(table),
        "limits": {f"{calls:g}": asdict(own) for calls, own in calibration.hysteresis.items()},
        "fall_prediction": json_records(calibration.fall_prediction),
        "warnings": json_records(calibration.warnings),
        "rescues": json_records(calibration.rescues),
    }


TITLES = {
    "world": "scenario",
    "policy": "policy",
    "called": "steps of the expert",
    "robots": "robots",
    "falls": "falls",
    "fall_rate_low": "95 % from",
    "fall_rate_high": "95 % to",
    "points_more": "points more than the expert",
    "share": "share of the expert's return",
    "share_ci": "±",
}
"""What people call the columns of `assurance_table`."""


def acting_title(name: str) -> str:
    """Returns what people call a policy of the study."""
    kind, _, calls = name.partition("_")
    match kind:
        case "assured":
            return f"Assured, {100 * float(calls):g} % in training"
        case "schedule":
            return f"Schedule, as many as assured, {100 * float(calls):g} %"
        case _:
            return policy_title(name)


def assurance_table(scores: pd.DataFrame, titles: Mapping[str, str]) -> pd.DataFrame:
    """Sums up every policy in every world.

    Args:
        scores: Scores of robots, a row each, of every policy and scenario.
        titles: What people call each scenario.

    Returns:
        A row a policy and world: `called`, the share of steps that the expert acted in, falls with
        their 95 % interval by Wilson's score, `points_more` falls of a hundred than the expert
        there, the share of the expert's reward with its paired interval, and what `summarize`
        returns.
    """
    parts = []
    for name, title in titles.items():
        own = scores[scores["scenario"] == name]
        expert = own[own["policy"] == "expert"]
        part = summarize_against(own, ["policy"], expert)
        called = {policy: share_called(rows) for policy, rows in own.groupby("policy")}
        part.insert(1, "scenario", name)
        part.insert(2, "world", title)
        part["called"] = [called[policy] for policy in part["policy"]]
        part["points_more"] = 100.0 * (part["fall_rate"] - expert["fell"].mean())
        parts.append(part)
    table = pd.concat(parts, ignore_index=True)
    pairs = zip(table["falls"], table["robots"], strict=True)
    table[["fall_rate_low", "fall_rate_high"]] = [wilson_interval(*pair) for pair in pairs]
    return table


def readable_table(table: pd.DataFrame) -> pd.DataFrame:
    """Names the policies and columns of `assurance_table` as people do."""
    named = table.assign(policy=[acting_title(name) for name in table["policy"]])
    return named[list(TITLES)].rename(columns=TITLES)

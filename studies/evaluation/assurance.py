"""`glassgait evaluate assurance`: a student acts in distribution, the expert elsewhere."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
import pandas as pd
import tyro
from annotated_types import Ge, Lt, MinLen

from glassgait.diagrams.scenario import TRAINING, Scenario, load_scenario, load_scenarios
from glassgait.models.certificates.observation_box import ObservationBox
from glassgait.models.errors import InputError
from glassgait.models.policies.neural import NeuralPolicy
from glassgait.models.settings import DISTINCT, FEW, Count, Seed, Settings, Share
from glassgait.models.task.gait import load_gait
from glassgait.studies.common.cases import cases_in_worlds, digests_of
from glassgait.studies.common.console import console, say
from glassgait.studies.common.experiment import ScenarioNames
from glassgait.studies.common.figures import save_figure
from glassgait.studies.common.parallel.loop import parallel_backend
from glassgait.studies.common.policies import Policies, find_policies, policy_stem
from glassgait.studies.common.rollouts import (
    SELECTION_SEEDS,
    RolloutConfig,
    refuse_to_select,
)
from glassgait.studies.common.run_folder import open_run
from glassgait.studies.common.scores import summarize_against, wilson_interval
from glassgait.studies.common.sweep import WorkersConfig
from glassgait.studies.common.tables import json_records, print_table, write_metrics, write_table
from glassgait.studies.distillation.students.registry import policy_title
from glassgait.studies.evaluation.assurance_calibration import (
    Calibration,
    Pair,
    calibrate_once,
    has_ensemble,
    roll_out_all,
)
from glassgait.studies.evaluation.assurance_figures import draw_calls, draw_pushed, push_one

PUSHED = "push_1.0"
"""The world in which it is tried whether overruns predict falls."""

WORLDS = (TRAINING, PUSHED, "friction_0.5", "latency_20ms")


@dataclass(frozen=True)
class Assurance(Settings):
    """Let a student act in distribution, and the expert elsewhere, and count falls.

    Attributes:
        gait: Name of a gait, or path of a gait file.
        policy: The student: its kind, or the path of its file.
        scenario: The scenarios: names of those that ship, and paths of scenario files.
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
        rollouts: How robots are rolled out, at the speeds of distillation unless others are named.
        workers: Where rollouts run.
        robot: Name of a robot, or path of its robot.yaml; by default that of the policies.
        source: Folder of a run of train, distill or refine, whose policies are taken; by default
            those that ship, and of a gait that does not ship those of runs/distill/<gait> and
            runs/train/<gait>.
        resume: Continue the run that the folder holds.
        output: Folder of the results; runs/evaluate/assurance/<gait>/<student> by default.
    """

    title: ClassVar[str] = "evaluate assurance"

    gait: str = "trot"
    policy: str = "sparse_formula"
    scenario: ScenarioNames = WORLDS
    calls: Annotated[tuple[Share, ...], MinLen(1), FEW, DISTINCT] = (0.02,)
    quantile: Annotated[float, Ge(0.0), Lt(0.5)] = 0.001
    return_steps: Count = 25
    disagreement: bool = False
    nominal_robots: Count = 26
    pushed_robots: Count = 130
    calibration_seed: Seed = SELECTION_SEEDS[0]
    rollouts: Annotated[RolloutConfig, tyro.conf.arg(name="")] = field(
        default_factory=lambda: RolloutConfig(n_seeds=1)
    )
    workers: Annotated[WorkersConfig, tyro.conf.arg(name="")] = field(default_factory=WorkersConfig)
    robot: str | None = None
    source: Path | None = None
    resume: bool = False
    output: Path | None = None

    def __post_init__(self) -> None:
        """
        Raises:
            InputError: if a value is out of range, or the limits would be judged by the very
                robots that they were chosen with.
        """
        super().__post_init__()
        refuse_to_select([self.calibration_seed], f"{self.title}: calibration_seed")
        if {self.calibration_seed, self.calibration_seed + 1} & {*self.rollouts.seeds}:
            raise InputError(
                f"{self.title}: calibration_seed is {self.calibration_seed}, and rollouts have it "
                "or the next one; name another"
            )

    def run(self) -> None:
        """Runs the study."""
        scenarios = load_scenarios(self.scenario)
        policies = find_policies(load_gait(self.gait), self.source, self.robot)
        pair = self._pair(policies)
        folder = self.output or policies.output(self.title) / pair.name
        alone = pair.alone[pair.name]
        # What cannot be rolled out is refused here, before anything is made.
        cases = cases_in_worlds(pair.gait, {pair.name: alone}, scenarios, self.rollouts)
        inputs = digests_of(cases) | policies.inputs([(pair.name, alone)])
        run = {
            "study": self.title,
            "settings": self,
            "resume": self.resume,
            "inputs": inputs,
        }
        with open_run(folder, **run) as of, parallel_backend(self.workers.backend):
            calibration = self._calibrate(pair, folder, of)
            scores = roll_out_all(
                pair,
                calibration,
                scenarios,
                self.rollouts,
                folder / "rollouts",
                self.workers.processes,
            )
            titles = {name: scenario.title for name, scenario in scenarios.items()}
            table = assurance_table(scores, titles)
            write_table(readable_table(table), folder / "worlds")
            write_metrics(_metrics(table, calibration), folder / "metrics.json")
            save_figure(draw_calls(table, titles), folder / "calls")
            shown = push_one(pair, calibration, folder / "pushed_robot.json", of=of)
            save_figure(draw_pushed(shown, calibration), folder / "pushed_robot")
        print_table(f"{pair.gait.name}: falls, and shares of the expert", readable_table(table))
        console.print(f"written to {folder}")

    def _pair(self, policies: Policies) -> Pair:
        controller = policies.controller(self.policy)
        if controller.student is None:
            raise InputError(f"--policy {self.policy}: is neural; name a student")
        if self.disagreement and not has_ensemble(controller.student):
            raise InputError(
                f"{self.title}: disagreement is set, but {self.policy} of the "
                f"{policies.gait.name} is no ensemble; name --policy ebm, or leave it out"
            )
        expert = controller.expert
        assert isinstance(expert, NeuralPolicy)
        return Pair(policies.gait, expert, controller.student, policy_stem(self.policy))

    def _calibrate(self, pair: Pair, folder: Path, of: str) -> Calibration:
        say(
            f"{pair.gait.name}: robots walk in the training scenario and under pushes, for the "
            "region and the limits"
        )
        nominal = replace(
            self.rollouts, n_robots=self.nominal_robots, seed=self.calibration_seed, n_seeds=1
        )
        pushed = replace(nominal, n_robots=self.pushed_robots, seed=self.calibration_seed + 1)
        calibration = calibrate_once(
            pair,
            (Scenario(), load_scenario(PUSHED)),
            (nominal, pushed),
            folder / "calibration.json",
            of=of,
            calls=self.calls,
            quantile=self.quantile,
            return_steps=self.return_steps,
            disagreement=self.disagreement,
        )
        for stem, table in {
            "fall_prediction": calibration.fall_prediction,
            "warnings": calibration.warnings,
            "rescues": calibration.rescues,
        }.items():
            write_table(table, folder / stem)
        region = calibration.region
        for state, name in enumerate(pair.gait.states):
            box = ObservationBox(
                pair.expert.robot, region.names, region.lower[state], region.upper[state]
            )
            measured = (
                f"{nominal.n_robots} robots each of expert and {pair.name} in the training "
                f"scenario, seed {nominal.seed}"
            )
            box.save(folder / f"region_{name}.yaml", pair.gait, f"{measured}, machine state {name}")
        return calibration


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
        scores: What `roll_out_all` returned.
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
        called = {
            policy: np.average(rows["expert_share"], weights=rows["steps"])
            for policy, rows in own.groupby("policy")
        }
        part.insert(1, "scenario", name)
        part.insert(2, "world", title)
        part["called"] = [float(called[policy]) for policy in part["policy"]]
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

"""Choosing the region and the limits from what robots observe in distribution."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from glassgait.diagrams.scenario import Pushes, Scenario
from glassgait.models.arrays import Array
from glassgait.models.certificates.observation_box import (
    BOX_DIRECTORY,
    ObservationBox,
    commanded,
    operating_box,
)
from glassgait.models.policies.additive import AdditivePolicy
from glassgait.models.policies.controller import (
    AlternatingController,
    AssuredController,
    Controller,
)
from glassgait.models.policies.policy import Policy
from glassgait.models.robots.library import robot_folder
from glassgait.models.task.assurance import (
    EnsembleDisagreement,
    Hysteresis,
    Region,
    initial_monitor,
    step_monitor,
)
from glassgait.models.task.gait import Gait
from glassgait.models.task.observation import entries_of, machine_state_entries
from glassgait.studies.common.episode import episode
from glassgait.studies.common.observers import Observations, Snapshots
from glassgait.studies.common.rollouts import RolloutConfig

BoxKind = Literal["states", "whole", "operating"]
RegionKind = Literal[BoxKind, "disagreement", "states_and_disagreement"]

REGION_TITLES: dict[RegionKind, str] = {
    "states": "a box a machine state",
    "whole": "one box",
    "operating": "the operating box",
    "disagreement": "usual disagreement of the ensemble",
    "states_and_disagreement": "a box a machine state, and the ensemble",
}

ANYWHERE = 1e6
"""Ends of ranges that no observation leaves, where the disagreement alone is watched."""

RETURN_SHARE = 0.5
"""Share of the limit that counts as inside again."""

EXPERT, STUDENT = "expert", "student"
"""Names of both, each alone."""

HALVINGS = 30
"""Of the interval that a limit is sought in."""


@dataclass(frozen=True)
class Visits:
    """What n robots observed in T control steps.

    Attributes:
        observation: Observations before each step (T, n, N).
        fell: The step that each robot fell in (n); T where it did not.
        snapshots: All robots' states before each step; none of joined visits.
    """

    observation: Array
    fell: NDArray[np.int64]
    snapshots: Snapshots | None = None

    @property
    def alive(self) -> NDArray[np.bool_]:
        """Whether each robot was up before each step (T, n)."""
        return np.arange(len(self.observation))[:, None] <= self.fell

    @property
    def fallen(self) -> NDArray[np.int64]:
        """The robots that fell."""
        return np.flatnonzero(self.fell < len(self.observation))


def joined(parts: Sequence[Visits]) -> Visits:
    """Puts robots of several episodes of as many steps side by side."""
    observation = np.concatenate([own.observation for own in parts], axis=1)
    return Visits(observation, np.concatenate([own.fell for own in parts]))


def visit(gait: Gait, controller: Controller, scenario: Scenario, config: RolloutConfig) -> Visits:
    """Lets the robots of the first seed walk."""
    observations, snapshots = Observations(), Snapshots()
    ended = episode(
        gait,
        controller,
        config.commanding(scenario),
        n_robots=config.n_robots,
        n_steps=config.n_steps,
        seed=config.seed,
        observers=[observations, snapshots],
    )
    return Visits(observations.array, ended.fell, snapshots)


def has_ensemble(student: Policy) -> bool:
    """Returns whether a student is made of several models, which may disagree."""
    return isinstance(student, AdditivePolicy) and bool(student.deviations.any())


def make_regions(
    gait: Gait, student: Policy, visits: Visits, quantile: float
) -> dict[RegionKind, Region]:
    """Makes all regions there are; an operating box does not ship with every gait.

    Args:
        gait: The gait.
        student: The student, whose models disagree if it is an ensemble.
        visits: Where robots were in distribution.
        quantile: Share of observations that each end of a range leaves out.
    """
    folder = robot_folder(BOX_DIRECTORY, student.robot.name)
    kinds: tuple[BoxKind, ...] = ("states", "whole")
    if (folder / f"{gait.name}.yaml").exists():
        # One that was measured with other senses says nothing of this student.
        same = operating_box(gait, student.robot).names == student.observation_names
        kinds = (*kinds, "operating") if same else kinds
    regions: dict[RegionKind, Region] = {
        kind: make_region(gait, student, visits, quantile, kind) for kind in kinds
    }
    if isinstance(student, AdditivePolicy) and has_ensemble(student):
        states = regions["states"]
        corner = np.full_like(states.lower, ANYWHERE)
        disagreement = _usual_disagreement(student, states.names, visits, quantile)
        regions["disagreement"] = Region(states.names, -corner, corner, disagreement)
        regions["states_and_disagreement"] = replace(states, disagreement=disagreement)
    return regions


def _usual_disagreement(
    student: AdditivePolicy, names: tuple[str, ...], visits: Visits, quantile: float
) -> EnsembleDisagreement:
    seen = visits.observation[visits.alive]
    one_hot = seen[:, machine_state_entries(names)]
    state_of = np.argmax(one_hot, axis=-1)
    disagreement = student.disagreement(seen)
    usual = np.zeros((2, one_hot.shape[-1]))
    for state in np.unique(state_of):
        own = disagreement[state_of == state]
        usual[:, state] = np.quantile(own, [quantile, 1 - quantile])
    return EnsembleDisagreement(student.disagreement, usual)


def make_region(
    gait: Gait, student: Policy, visits: Visits, quantile: float, kind: BoxKind = "states"
) -> Region:
    """Bounds what robots observed, but for commands and counts, which keep their true ranges.

    Args:
        gait: The gait.
        student: The student, for its robot and what it observes.
        visits: Where robots were in distribution.
        quantile: Share of observations that each end of a range leaves out.
        kind: A box for each machine state, one for all, or the gait's operating box.
    """
    robot, names = student.robot, student.observation_names
    if kind == "operating":
        boxes = [operating_box(gait, robot).in_state(state) for state in range(gait.n_states)]
    else:
        seen = visits.observation[visits.alive]
        state_of = np.argmax(seen[:, machine_state_entries(names)], axis=-1)
        boxes = []
        for state in range(gait.n_states):
            own = seen[state_of == state] if kind == "states" else seen
            # Where no robot was, nothing is inside: a range without width holds nothing else.
            ends = np.quantile(own, [quantile, 1 - quantile], axis=0) if len(own) else seen[[0, 0]]
            boxes.append(commanded(ObservationBox(robot, names, *ends), gait).in_state(state))
    corners = np.array([[box.lower, box.upper] for box in boxes])
    return Region(names, corners[:, 0], corners[:, 1])


def choose_hysteresis(
    overrun: Array, alive: NDArray[np.bool_], calls: float, return_steps: int
) -> Hysteresis:
    """Finds the least limit at which the expert would be called in a share of steps at most.

    Args:
        overrun: Overruns of robots that walk in distribution (T, n).
        alive: Whether each was up (T, n).
        calls: The share.
        return_steps: Control steps inside after which the student acts again.
    """

    def hysteresis(limit: float) -> Hysteresis:
        return Hysteresis(limit, RETURN_SHARE * limit, return_steps)

    def too_often(limit: float) -> bool:
        return bool(guarded(overrun, hysteresis(limit))[alive].mean() > calls)

    finite = overrun[np.isfinite(overrun)]
    low, high = 0.0, float(finite.max(initial=0.0))
    if not too_often(low):
        return hysteresis(low)
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        low, high = (middle, high) if too_often(middle) else (low, middle)
    return hysteresis(high)


def guarded(overrun: Array, hysteresis: Hysteresis) -> NDArray[np.bool_]:
    """Returns when (T, n) the expert would be called, had its actions changed nothing."""
    state, called = initial_monitor(overrun.shape[1:]), []
    for own in overrun:
        state = step_monitor(state, own, hysteresis)
        called.append(state.expert_acts)
    return np.array(called)


LEADS = (1, 2, 4, 8, 12, 16, 24, 32)
"""Control steps before a fall at which the expert takes over."""

RESCUE_STEPS = 150
"""Control steps that a robot must then stay up."""


def warnings_of(visits: Visits, region: Region, hysteresis: Hysteresis) -> pd.DataFrame:
    """Measures for how long before each fall the expert would have been called.

    Returns:
        A row a fall: `robot`, `step`, `warning` in control steps without a gap up to the fall, and
        `first`, the group of the observation that was farthest outside when that began.
    """
    overruns = region.overruns(visits.observation)
    called = guarded(overruns.max(axis=-1), hysteresis)
    groups = [*(entry.group for entry in entries_of(region.names)), "disagreement"]
    rows = []
    for robot in visits.fallen:
        step = visits.fell[robot]
        quiet = np.flatnonzero(~called[: step + 1, robot])
        begun = int(quiet[-1]) + 1 if len(quiet) else 0
        first = groups[overruns[begun, robot].argmax()] if begun <= step else "none"
        rows.append((int(robot), int(step), int(step) + 1 - begun, first))
    return pd.DataFrame(rows, columns=["robot", "step", "warning", "first"])


def prediction_row(
    nominal: Visits, pushed: Visits, region: Region, hysteresis: Hysteresis
) -> dict[str, Any]:
    """Sums up how a region predicts falls under pushes."""
    found = warnings_of(pushed, region, hysteresis)
    shares = [
        float(guarded(region.overrun(own.observation), hysteresis)[own.alive].mean())
        for own in (nominal, pushed)
    ]
    return {
        "limit": hysteresis.limit,
        "calls_in_distribution": shares[0],
        "calls_under_pushes": shares[1],
        "falls": len(found),
        "predicted": int((found["warning"] > 0).sum()),
        "predicted_8": int((found["warning"] >= 8).sum()),
        "median_warning": float(found["warning"].median()),
    }


def rescues(
    gait: Gait, controller: Controller, scenario: Scenario, visits: Visits, seed: int
) -> pd.DataFrame:
    """Takes every fall back by some steps and lets another controller go on, without more pushes.

    Args:
        gait: The gait.
        controller: The other controller.
        scenario: The world that robots fell in.
        visits: Where robots were until they fell.
        seed: Seed of the noise.

    Returns:
        A row a lead: `lead` in control steps, the `falls` that were so late in the episode, and of
        these the `rescued`, which stay up for `RESCUE_STEPS`.
    """
    assert visits.snapshots is not None
    calm = replace(scenario, pushes=Pushes(speed=0.0))
    rows = []
    for lead in LEADS:
        robots = visits.fallen[visits.fell[visits.fallen] + 1 >= lead]
        n, rescued = len(robots), 0
        if n:
            ended = episode(
                gait,
                controller,
                calm,
                n_robots=n,
                n_steps=RESCUE_STEPS,
                seed=seed,
                start=visits.snapshots.at(robots, visits.fell[robots] + 1 - lead),
            )
            rescued = int(np.sum(ended.fell == RESCUE_STEPS))
        rows.append({"lead": lead, "falls": n, "rescued": rescued})
    return pd.DataFrame(rows)


@dataclass(frozen=True)
class Calibration:
    """What was chosen in distribution, and what it predicts.

    Attributes:
        region: Where the student may act.
        hysteresis: Limits, by the share of steps in distribution that the expert is called in.
        fall_prediction: How each kind of region predicts falls under pushes, a row a kind and
            share.
        warnings: A row a fall under pushes.
        rescues: How late a fall can be averted, a row a lead.
    """

    region: Region
    hysteresis: dict[float, Hysteresis]
    fall_prediction: pd.DataFrame
    warnings: pd.DataFrame
    rescues: pd.DataFrame

    def assured(self, alone: AlternatingController, calls: float) -> AssuredController:
        """Returns a student under assurance, whose expert may be called in so many steps."""
        assert alone.student is not None
        return AssuredController(alone.expert, alone.student, self.region, self.hysteresis[calls])

    def to_plain(self) -> dict[str, Any]:
        """Returns it as values that JSON can hold."""
        disagreement = self.region.disagreement
        tables = (self.fall_prediction, self.warnings, self.rescues)
        return {
            "corners": [self.region.lower.tolist(), self.region.upper.tolist()],
            "usual_disagreement": disagreement.usual.tolist() if disagreement else None,
            "hysteresis": [
                [calls, own.limit, own.return_limit, own.return_steps]
                for calls, own in self.hysteresis.items()
            ],
            "tables": [table.to_dict(orient="list") for table in tables],
        }

    @staticmethod
    def from_plain(values: dict[str, Any], student: Policy) -> "Calibration":
        """Rebuilds what `to_plain` took apart, of the student that it was made with."""
        lower, upper = np.array(values["corners"])
        disagreement = None
        if isinstance(student, AdditivePolicy) and values["usual_disagreement"] is not None:
            disagreement = EnsembleDisagreement(
                student.disagreement, np.array(values["usual_disagreement"])
            )
        region = Region(student.observation_names, lower, upper, disagreement)
        limits = {calls: Hysteresis(*own) for calls, *own in values["hysteresis"]}
        tables = [pd.DataFrame(table) for table in values["tables"]]
        return Calibration(region, limits, *tables)


def calibrate(
    gait: Gait,
    controllers: Mapping[str, AlternatingController],
    worlds: tuple[Scenario, Scenario],
    configs: tuple[RolloutConfig, RolloutConfig],
    *,
    calls: tuple[float, ...],
    quantile: float,
    return_steps: int,
    disagreement: bool,
) -> Calibration:
    """Chooses region and limits by what is visited in distribution, and tries what they predict.

    Args:
        gait: The gait.
        controllers: The expert and the student, each alone.
        worlds: The training scenario, and the world of the pushes.
        configs: How robots are rolled out in each; the last seed is also that of rescues' noise.
        calls: Shares of steps in distribution in which the expert may be called.
        quantile: Share of observations that each end of a range leaves out.
        return_steps: Control steps inside after which the student acts again.
        disagreement: Whether the student's models must agree as they do in distribution, too.
    """
    student = controllers[STUDENT]
    # Where the expert walks in distribution the student may take over again: without those visits
    # the expert, once called, would hardly ever hand back.
    nominal = joined([visit(gait, own, worlds[0], configs[0]) for own in controllers.values()])
    pushed = visit(gait, student, worlds[1], configs[1])
    regions = make_regions(gait, student.policy, nominal, quantile)
    watched: RegionKind = "states_and_disagreement" if disagreement else "states"
    chosen: dict[float, Hysteresis] = {}
    rows = []
    for kind, own in regions.items():
        overrun = own.overrun(nominal.observation)
        for share in calls:
            hysteresis = choose_hysteresis(overrun, nominal.alive, share, return_steps)
            row = {"region": REGION_TITLES[kind], "calls": share}
            rows.append(row | prediction_row(nominal, pushed, own, hysteresis))
            if kind == watched:
                chosen[share] = hysteresis
    region = regions[watched]
    averted, alone = (
        rescues(gait, own, worlds[1], pushed, configs[1].seed) for own in controllers.values()
    )
    averted = averted.assign(alone=alone["rescued"])
    warnings = warnings_of(pushed, region, chosen[max(calls)])
    return Calibration(region, chosen, pd.DataFrame(rows), warnings, averted)


def period_of(called: float) -> int:
    """Returns the period of a schedule that calls the expert as often, or a little more often."""
    return math.floor(1.0 / called) if called > 0.0 else 0


def share_called(scores: pd.DataFrame) -> float:
    """Returns the share of all robots' steps, so that robots that fell early count for less."""
    return float(np.average(scores["expert_share"], weights=scores["steps"]))

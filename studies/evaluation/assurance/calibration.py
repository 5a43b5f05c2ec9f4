"""Choosing the region and the limits from what robots observe in distribution."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from glassgait.diagrams.scenario import Scenario
from glassgait.models.arrays import Array
from glassgait.models.certificates.observation_box import (
    BOX_DIRECTORY,
    ObservationBox,
    commanded,
    operating_box,
)
from glassgait.models.policies.additive import AdditivePolicy
from glassgait.models.policies.controller import Controller
from glassgait.models.policies.policy import Policy
from glassgait.models.robots.robot import Robot, robot_folder
from glassgait.models.task.assurance import (
    EnsembleDisagreement,
    Hysteresis,
    Region,
    initial_monitor,
    step_monitor,
)
from glassgait.models.task.gait import Gait
from glassgait.models.task.observation import ObservationLayout, machine_state_entries
from glassgait.studies.common.episode import episode
from glassgait.studies.common.observers import Observations, Snapshots
from glassgait.studies.common.rollouts.config import RolloutConfig

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
    """Lets the robots of the first seed walk, at the speeds of distillation."""
    observations, snapshots = Observations(), Snapshots()
    ended = episode(
        gait,
        controller,
        config.at_distilled_speeds(gait, scenario).commanding(scenario),
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
    ships = (folder / f"{gait.name}.yaml").exists()
    kinds: tuple[BoxKind, ...] = ("states", "whole", "operating") if ships else ("states", "whole")
    regions: dict[RegionKind, Region] = {
        kind: make_region(gait, student.robot, visits, quantile, kind) for kind in kinds
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
    gait: Gait, robot: Robot, visits: Visits, quantile: float, kind: BoxKind = "states"
) -> Region:
    """Bounds what robots observed, but for commands and counts, which keep their true ranges.

    Args:
        gait: The gait.
        robot: The robot.
        visits: Where robots were in distribution.
        quantile: Share of observations that each end of a range leaves out.
        kind: A box for each machine state, one for all, or the gait's operating box.
    """
    names = ObservationLayout(gait.n_states).names
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

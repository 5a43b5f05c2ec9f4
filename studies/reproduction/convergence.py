"""`glassgait reproduce convergence`: which contact solvers and time steps agree."""

from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
import pandas as pd
import tyro
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.analysis import Simulator

from glassgait.diagrams.rollout import use_error_control
from glassgait.diagrams.scenario import Scenario
from glassgait.diagrams.station import ContactSolver, MakeStation, StationConfig, actuated_joints
from glassgait.models.arrays import Array
from glassgait.models.policies.controller import alone
from glassgait.models.robots import kinematics, quadruped
from glassgait.models.robots.robot import Robot
from glassgait.models.task import CONTROL_PERIOD
from glassgait.studies.common.cases import Case, digests_of, rollout_cases, run_rollouts
from glassgait.studies.common.console import console, say
from glassgait.studies.common.experiment import Report
from glassgait.studies.common.figures import COLUMN_WIDTH, styled, subplots
from glassgait.studies.common.policies import OneGait
from glassgait.studies.common.rollouts import RolloutConfig
from glassgait.studies.common.run_folder import open_run

DRAKES_RELAXATION_TIME = 0.2
"""What two bodies without a relaxation time of their own add up to in SAP (s)."""


@dataclass(frozen=True)
class Variant:
    """One way of simulating contact.

    Attributes:
        family: The solver, as figures call it.
        resolution: Time step (s), or accuracy of the error-controlled integrator.
        scenario: The world.
    """

    family: str
    resolution: float
    scenario: Scenario


SAP = "SAP"
SAP_DEFAULT = "SAP, Drake's relaxation"
CENIC = "CENIC"

STEPS = (0.02, 0.01, 0.005, 0.002, 0.001)


def _variants() -> Iterator[Variant]:
    """Returns every solver at every time step (s), then CENIC at every accuracy."""
    usual = StationConfig.relaxation_time
    solvers: tuple[tuple[str, ContactSolver, tuple[float, ...], float], ...] = (
        (SAP, "sap", STEPS, usual),
        (SAP_DEFAULT, "sap", STEPS, DRAKES_RELAXATION_TIME),
        ("similar", "similar", STEPS, usual),
        ("lagged", "lagged", (*STEPS, 0.0005), usual),
    )
    for family, solver, steps, relaxation_time in solvers:
        for step in steps:
            station = StationConfig(step, solver, relaxation_time=relaxation_time)
            yield Variant(family, step, Scenario(f"{family} {1000 * step:g} ms", station))
    for accuracy in (1e-2, 1e-3, 1e-4, 1e-5):
        station = StationConfig(time_step=0.0)
        scenario = Scenario(f"{CENIC} {accuracy:g}", station, accuracy, max_robots=1)
        yield Variant(CENIC, accuracy, scenario)


VARIANTS = tuple(_variants())


DROP_HEIGHT = 0.03
"""Height of the feet above the ground at the start (m)."""

DURATION = 1.0
"""Simulated time (s)."""

SAMPLE_PERIOD = 0.01
"""Time between two samples (s)."""


@dataclass(frozen=True)
class Drop:
    """What the robot did.

    Attributes:
        stance: Distance between left and right feet in the end, mean of both pairs (m).
        height: Height of the trunk in the end (m).
        penetration: Greatest depth of a foot in the ground (m).
    """

    stance: float
    height: float
    penetration: float


def drop_robot(robot: Robot, scenario: Scenario) -> Drop:
    """Drops a robot in its default stance, its joints held there."""
    station = MakeStation(robot, scenario.station)
    plant = station.GetSubsystemByName("plant")
    assert isinstance(plant, MultibodyPlant)
    simulator = Simulator(station)
    context = simulator.get_mutable_context()
    targets = [
        robot.default_stance[quadruped.JOINTS.index(name)] for name in actuated_joints(plant)
    ]
    desired = np.concatenate([targets, np.zeros(quadruped.N_JOINTS)])
    station.GetInputPort("desired_state").FixValue(context, desired)
    # Drake names arrays by scalar, which NumPy's own types do not match.
    state: Any = kinematics.standing_state(robot)
    state[quadruped.POSITION][2] += DROP_HEIGHT
    plant.SetPositionsAndVelocities(plant.GetMyMutableContextFromRoot(context), state)
    if scenario.accuracy is not None:
        use_error_control(simulator, scenario.accuracy)
    simulator.Initialize()
    port = station.GetOutputPort("state")
    states = []
    for time in np.arange(1, round(DURATION / SAMPLE_PERIOD) + 1) * SAMPLE_PERIOD:
        simulator.AdvanceTo(time)
        states.append(np.array(port.Eval(context)))
    return _drop_of(robot, np.array(states))


def _drop_of(robot: Robot, states: Array) -> Drop:
    feet = kinematics.foot_positions(robot, states[-1, quadruped.JOINT_POSITION])
    return Drop(
        stance=float(np.mean(feet[[0, 2], 1] - feet[[1, 3], 1])),
        height=float(states[-1, quadruped.POSITION][2]),
        penetration=float(max(0.0, -kinematics.foot_heights(robot, states).min())),
    )


_STYLES = {
    SAP: {"color": "#0072B2", "marker": "o"},
    SAP_DEFAULT: {"color": "#56B4E9", "marker": "s", "linestyle": "--"},
    "similar": {"color": "#009E73", "marker": "^"},
    "lagged": {"color": "#D55E00", "marker": "v"},
    CENIC: {"color": "black", "marker": "x"},
}

_LINE = {"markersize": 4, "linewidth": 1.0}

_LABELS = {
    "stance": "stance after\na drop (m)",
    "height": "trunk after\na drop (m)",
    "survived": "survived of a\nrollout (s)",
    "going_speed_error": "speed error,\ncommanded to go (m/s)",
    "yaw_rate_error": "yaw-rate error\n(rad/s)",
}


@styled
def convergence_figure(results: pd.DataFrame) -> Figure:
    """Draws each measure against the time step, and against CENIC's accuracy beside it.

    Args:
        results: Columns `family`, `resolution` and the measures.
    """
    size = (2 * COLUMN_WIDTH, 1.2 * len(_LABELS) + 0.6)
    figure, axes = subplots(
        len(_LABELS), 2, figsize=size, width_ratios=(3, 1.2), sharex="col", sharey="row"
    )
    for (measure, label), (left, right) in zip(_LABELS.items(), axes, strict=True):
        for family, style in _STYLES.items():
            mine = results[results["family"] == family].sort_values("resolution")
            if family == CENIC:
                right.plot(mine["resolution"], mine[measure], label=family, **_LINE, **style)
            else:
                left.plot(1000 * mine["resolution"], mine[measure], label=family, **_LINE, **style)
        left.set_ylabel(label)
    _label_resolutions(*axes[-1])
    figure.align_ylabels()
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper left", ncols=len(labels))
    return figure


def _label_resolutions(step: Axes, accuracy: Axes) -> None:
    ticks = [0.5, 1, 2, 5, 10, 20]
    step.set(xlabel="time step (ms)", xscale="log")
    step.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    step.minorticks_off()
    accuracy.set(xlabel="accuracy of CENIC", xscale="log")


@dataclass(frozen=True)
class Convergence(OneGait):
    """Drop the robot and roll an expert out with every contact solver and time step.

    Attributes:
        rollouts: How robots are rolled out.
        resume: Continue the run that the folder holds.
        output: Folder of the results; runs/reproduce/convergence/<gait> by default.
    """

    title: ClassVar[str] = "reproduce convergence"

    rollouts: Annotated[RolloutConfig, tyro.conf.arg(name="")] = field(
        default_factory=RolloutConfig
    )
    resume: bool = False
    output: Path | None = None

    def run(self) -> None:
        """Runs the study."""
        found = self.policies()
        gait = found.gait
        folder, policy = self.output or found.output(self.title), alone(found.expert)
        cases = [
            case
            for variant in reversed(VARIANTS)
            for case in rollout_cases(
                {"variant": variant.scenario.title},
                gait,
                policy,
                variant.scenario,
                self.rollouts,
            )
        ]
        with open_run(
            folder,
            study=self.title,
            settings=self,
            inputs=digests_of(cases),
            resume=self.resume,
        ):
            results = _measure(policy.robot, cases, folder)
            report = Report(
                tables={"convergence": results},
                metrics=results.to_dict(orient="records"),
                figures={"convergence": convergence_figure(results)},
                shown={f"{gait.name}: contact solvers and time steps": results},
            )
            report.write(folder)
        report.show()
        console.print(f"written to {folder}")


def _measure(robot: Robot, cases: list[Case], folder: Path) -> pd.DataFrame:
    say("dropping the robot")
    drops = pd.DataFrame(
        [
            {
                "variant": variant.scenario.title,
                "family": variant.family,
                "resolution": variant.resolution,
                **asdict(drop_robot(robot, variant.scenario)),
            }
            for variant in VARIANTS
        ]
    )
    say("rolling out")
    return drops.merge(_means(run_rollouts(cases, folder / "rollouts")), on="variant")


def _means(scores: pd.DataFrame) -> pd.DataFrame:
    scores = scores.assign(survived=scores["steps"] * CONTROL_PERIOD)
    means = scores.groupby("variant", sort=False).agg(
        robots=("fell", "size"),
        falls=("fell", "sum"),
        survived=("survived", "mean"),
        going_speed_error=("going_speed_error", "mean"),
        yaw_rate_error=("yaw_rate_error", "mean"),
        rhythm=("rhythm", "mean"),
    )
    return means.reset_index()

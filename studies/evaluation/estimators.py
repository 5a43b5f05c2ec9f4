"""`glassgait evaluate estimators`: how wrong odometry and a learned network are, side by side."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pandas as pd

from glassgait.models.arrays import Array
from glassgait.models.robots import quadruped
from glassgait.models.robots.robot import Robot
from glassgait.models.settings import Count, Share
from glassgait.models.task import EPISODE_STEPS
from glassgait.models.task.ground import Ground
from glassgait.models.task.imu import measure_imu
from glassgait.models.task.observation import BASE_VELOCITY_SCALE, body_state
from glassgait.models.task.odometry import Odometry
from glassgait.models.task.randomization import Randomization
from glassgait.studies.common.cases import Case
from glassgait.studies.common.episode import ControlStep, Observer, episode
from glassgait.studies.common.experiment import Experiment, PolicyNames, Report, ScenarioNames
from glassgait.studies.common.policies import EXPERT
from glassgait.studies.common.tables import json_records
from glassgait.studies.distillation.students.registry import policy_title

LEARNED, ODOMETRY = "learned network", "odometry"
ERRORS = ["velocity x (m/s)", "velocity y (m/s)", "velocity z (m/s)", "foot heights (cm)"]
"""What is estimated: the trunk's velocity in its own frame, and heights above the ground."""


@dataclass(frozen=True)
class Estimators(Experiment):
    """Compare what odometry and the expert's own estimator say with the truth.

    Odometry watches the same rollouts: it has an IMU of its own, and does not act. Of an expert
    that observes by odometry only that is reported, with the rollouts that it leads to.

    Attributes:
        n_steps: Control steps of a rollout.
        gain: Gain of the odometry that watches.
    """

    title: ClassVar[str] = "evaluate estimators"
    together: ClassVar[bool] = True
    discrete: ClassVar[bool] = True

    policy: PolicyNames = (EXPERT,)
    scenario: ScenarioNames = ("training", "push_1.0", "friction_0.5", "slope_10deg", "mujoco")
    n_seeds: Count = 1
    n_steps: Count = EPISODE_STEPS
    gain: Share = Odometry().gain

    def measure(self, case: Case) -> pd.DataFrame:
        """Rolls robots out.

        Returns:
            A row an estimator: `estimator`, `steps` of robots that had not fallen, and the mean
            square errors over them.
        """
        compared = _Compared(case, Odometry(self.gain))
        episode(
            case.gait,
            case.controller,
            case.scenario,
            n_robots=self.n_robots,
            n_steps=self.n_steps,
            seed=case.seed,
            observers=[compared],
        )
        return compared.rows()

    def report(self, table: pd.DataFrame) -> Report:
        """Reports root mean square errors by gait, scenario and estimator."""
        found = errors_table(table, self.scenario_titles)
        title = "Root mean square errors of estimates"
        return Report(
            tables={"cases": table, "errors": found},
            metrics=json_records(found),
            shown={title: found.assign(policy=found["policy"].map(policy_title))},
        )


class _Compared(Observer):
    """Compares estimates with the truth after every control step."""

    def __init__(self, case: Case, odometry: Odometry) -> None:
        controller = case.controller
        self._robot: Robot = controller.robot
        self._ground = Ground([case.scenario.station.terrain])
        self._own = ODOMETRY if isinstance(controller.estimator, Odometry) else LEARNED
        self._beside = None
        if self._own == LEARNED:
            self._beside = _Watching(case, odometry)
        self._squares: dict[str, list[Array]] = {LEARNED: [], ODOMETRY: []}

    def observe(self, step: ControlStep) -> None:
        """Compares the estimates of robots that have not fallen."""
        standing = ~step.fallen
        truth = body_state(self._robot, step.after.plant, self._ground)
        estimates = {self._own: step.after.estimate}
        if self._beside is not None:
            estimates[ODOMETRY] = self._beside.estimate(step)
        for name, estimate in estimates.items():
            self._squares[name].append(np.square(estimate - truth)[standing])

    def rows(self) -> pd.DataFrame:
        """Returns a row an estimator."""
        rows = []
        for name, squares in self._squares.items():
            if not squares:
                continue
            every = np.concatenate(squares)
            mean = every.mean(axis=0) if len(every) else np.full(every.shape[1], np.nan)
            velocity = mean[:3] / BASE_VELOCITY_SCALE**2
            height = 100.0**2 * mean[3:].mean()
            errors = dict(zip(ERRORS, [*velocity, height], strict=True))
            rows.append({"estimator": name, "steps": len(every)} | errors)
        return pd.DataFrame(rows)


class _Watching:
    """Odometry that watches robots which observe by something else."""

    def __init__(self, case: Case, odometry: Odometry) -> None:
        scenario = case.scenario
        self._robot, self._odometry = case.controller.robot, odometry
        self._gravity = scenario.station.terrain.gravity
        self._errors: Randomization = scenario.randomization()
        # Of its own: the robots' draws stay as they are.
        self._generator = np.random.default_rng([case.seed, 1])
        self._state = None
        self._bias: Array = np.zeros(0)
        self._readings: list[Array] = []

    def estimate(self, step: ControlStep) -> Array:
        """Goes on by a control step, and returns the body state (n, 7)."""
        after, n = step.after, len(step.after.plant)
        if self._state is None:
            position, _ = step.before.measured_joints()
            self._state = self._odometry.begin(self._robot, position)
            self._bias = self._errors.biases(n, self._generator)[:, quadruped.N_JOINTS :]
        position, velocity = after.measured_joints()
        reading = measure_imu(
            after.plant, step.before.plant[:, quadruped.LINEAR_VELOCITY], self._gravity
        )
        reading += self._errors.imu_noise(n, self._generator) + self._bias
        late = self._errors.imu.delay
        self._readings = [*self._readings[-late:], reading] if late else [reading]
        self._state = self._odometry.advance(
            self._robot,
            self._state,
            joint_position=position,
            joint_velocity=velocity,
            imu=self._readings[0],
            touching=after.sensed,
        )
        return self._odometry.body_state(self._robot, self._state, position)


def errors_table(rows: pd.DataFrame, titles: Mapping[str, str]) -> pd.DataFrame:
    """Takes the roots of mean squares over seeds.

    Args:
        rows: What `measure` returned of all cases.
        titles: Titles of the scenarios by name.
    """
    errors = []
    by = ["gait", "policy", "scenario", "estimator"]
    for keys, group in rows.groupby(by, sort=False):
        mean = np.average(group[ERRORS], axis=0, weights=group["steps"])
        errors.append([*keys, *np.sqrt(mean).round(3)])
    table = pd.DataFrame(errors, columns=[*by, *ERRORS])
    return table.assign(scenario=table["scenario"].map(titles))

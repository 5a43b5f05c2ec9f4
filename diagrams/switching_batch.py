"""The batch simulator for robots that change their gait while they walk."""

import numpy as np

from glassgait.diagrams.batch import BatchSimulator
from glassgait.diagrams.physics import Physics
from glassgait.diagrams.scenario import Scenario
from glassgait.diagrams.task_config import TaskConfig
from glassgait.diagrams.task_state import BoolArray, TaskState
from glassgait.models.policies.controller import Controller, Estimator
from glassgait.models.policies.policy import Policy
from glassgait.models.task.command import Command
from glassgait.models.task.contact import FootSense
from glassgait.models.task.gait_switch import GaitSwitch
from glassgait.models.task.mode_machine import ModeMachine
from glassgait.models.task.reward_machine import IntArray, MachineStep


class SwitchingSimulator(BatchSimulator):
    """Plays the task of several gaits with many robots, each in the gait that it is asked for.

    Episodes begin in the first gait.

    Attributes:
        requested: Numbers of the gaits that are to run (n,); the first, until others are requested.
    """

    def __init__(
        self,
        switch: GaitSwitch,
        scenario: Scenario,
        physics: Physics,
        *,
        n_robots: int,
        generator: np.random.Generator,
        estimator: Estimator | None,
        policy: Controller | Policy | None = None,
        day: ModeMachine | None = None,
    ) -> None:
        """
        Args:
            switch: The gaits.
            scenario: The world.
            physics: The stepper.
            n_robots: Number of robots.
            generator: Source of all randomness.
            estimator: What estimates the body state, as `BatchSimulator` takes it.
            policy: The controller, as `TaskConfig.of_scenario` takes it.
            day: The machine of a day, as `BatchSimulator` takes it.

        Raises:
            InputError: if commands come from sliders, or a gait is not made for them.
        """
        self.switch = switch
        self.requested: IntArray = np.zeros(n_robots, dtype=np.int64)
        super().__init__(
            TaskConfig.of_scenario(switch.gait, scenario, policy),
            physics,
            n_robots=n_robots,
            generator=generator,
            estimator=estimator,
            day=day,
        )

    @property
    def running(self) -> IntArray:
        """Numbers of the gaits that run (n,)."""
        return self.switch.gait_of(self.state.machine.state)

    def _step_machine(
        self, s: TaskState, feet: FootSense, contact: BoolArray, command: Command
    ) -> MachineStep:
        return self.switch.step(
            s.machine,
            requested=self.requested,
            foot_contact=contact,
            foot_height=self._sensed_height(feet, s.estimate),
            commanded_dwell=command.dwell,
        )

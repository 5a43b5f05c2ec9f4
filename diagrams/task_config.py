"""The task that the batch simulator plays."""

from dataclasses import field
from typing import Annotated, ClassVar

from annotated_types import Ge

from glassgait.diagrams.commands import DrawnCommands, FixedCommand, SliderCommand
from glassgait.diagrams.scenario import Scenario
from glassgait.models.errors import InputError
from glassgait.models.policies.controller import Controller, expert_of, refuse_other_machine
from glassgait.models.policies.policy import Policy
from glassgait.models.robots.library import load_robot
from glassgait.models.robots.robot import OWN_LAW, JointLaw, Robot
from glassgait.models.settings import Settings, checked
from glassgait.models.task import EPISODE_STEPS
from glassgait.models.task.gait import Gait
from glassgait.models.task.randomization import Randomization
from glassgait.models.task.reward import RewardWeights
from glassgait.models.task.termination import TerminationLimits

NO_SLIDERS = "command is of sliders, which only a robot in Meshcat has; give a speed"


@checked
class TaskConfig(Settings):
    """The task that the batch simulator plays.

    Attributes:
        gait: The gait.
        randomization: Differences between robots and episodes.
        weights: Weights of the reward.
        limits: Bounds of the termination.
        episode_steps: Control steps of an episode.
        command: The source of commands.
        joint_law: How joints follow targets.
        robot: The robot.
        observes_imu: Whether gravity's direction and the angular velocity are observed.
    """

    title: ClassVar[str] = "task"

    gait: Gait
    randomization: Randomization = field(default_factory=Randomization)
    weights: RewardWeights = field(default_factory=RewardWeights)
    limits: TerminationLimits = field(default_factory=TerminationLimits)
    episode_steps: Annotated[int, Ge(1)] = EPISODE_STEPS
    command: FixedCommand | DrawnCommands = field(default_factory=DrawnCommands)
    joint_law: JointLaw = OWN_LAW
    robot: Robot = field(default_factory=load_robot)
    observes_imu: bool = False

    @classmethod
    def of_scenario(
        cls,
        gait: Gait,
        scenario: Scenario,
        policy: Controller | Policy | None = None,
        *,
        episode_steps: int = EPISODE_STEPS,
    ) -> "TaskConfig":
        """Returns the task of a gait in a scenario, with a policy's joints and observation.

        Raises:
            InputError: if commands come from sliders, or the gait is not made for them, or the
                policy holds another machine.
        """
        command = scenario.command
        if isinstance(command, SliderCommand):
            raise InputError(f"{scenario.refused_as()}: {NO_SLIDERS}")
        command.check(gait)
        refuse_other_machine(policy, gait)
        return cls(
            gait,
            scenario.randomization(),
            weights=scenario.weights,
            limits=scenario.limits,
            episode_steps=episode_steps,
            command=command,
            joint_law=scenario.joint_law(policy),
            robot=scenario.robot_of(policy),
            observes_imu=policy is not None and expert_of(policy).layout.imu,
        )

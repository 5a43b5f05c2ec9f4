"""Many robots in the batch simulator, as a gymnasium vector environment."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from glassgait.diagrams.batch import BatchSimulator, BatchStep
from glassgait.diagrams.batch_physics import BatchPhysics
from glassgait.diagrams.gym.arguments import (
    check_actions,
    check_num_envs,
    find_autoreset_mode,
    find_reset_mask,
    find_senses,
    gait_given,
)
from glassgait.diagrams.gym.rendering import RENDER_FPS, RENDER_MODES, Renderer
from glassgait.diagrams.gym.spaces import action_space, observation_space
from glassgait.diagrams.station import StationConfig
from glassgait.diagrams.task_config import TaskConfig
from glassgait.diagrams.task_state import BoolArray
from glassgait.models.arrays import Array
from glassgait.models.robots import quadruped
from glassgait.models.robots.library import load_robot
from glassgait.models.robots.robot import DEFAULT_ROBOT
from glassgait.models.task import EPISODE_STEPS
from glassgait.models.task.gait import Gait
from glassgait.models.task.randomization import Randomization
from glassgait.models.task.termination import FAILURES


class LocomotionVectorEnv(VectorEnv[Array, Array, NDArray[Any]]):
    """Many robots in the batch simulator, each as `LocomotionEnv` is.

    Observations are (n, 47 + n_states), 6 more where an IMU is observed, actions (n, 12), rewards
    and ends (n,). `info` has what that of `LocomotionEnv` has, robots along the first axis, with
    gymnasium's masks. A group of robots shares its friction, which a reset of all robots draws
    anew.

    An episode starts anew by itself, as gymnasium's autoreset modes have it: by default in the step
    after its last, which then ignores the robot's action and pays nothing.
    """

    metadata = {  # noqa: RUF012
        "render_modes": [*RENDER_MODES],
        "render_fps": RENDER_FPS,
        "autoreset_mode": AutoresetMode.NEXT_STEP,
    }

    def __init__(
        self,
        num_envs: int = 1,
        gait: Gait | str | Path = "trot",
        *,
        robot: str | Path = DEFAULT_ROBOT,
        stations: Sequence[StationConfig] | None = None,
        randomization: Randomization | None = None,
        senses: str = "true",
        max_episode_steps: int = EPISODE_STEPS,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        render_mode: str | None = None,
    ) -> None:
        """
        Args:
            num_envs: Number of robots.
            gait: The gait, its name or its file.
            robot: Name of a robot that ships, or path of one's own `robot.yaml`.
            stations: Physics of each group of robots, which also has a friction of its own; by
                default all robots form one group.
            randomization: What differs between robots and episodes.
            senses: "true" to observe the true velocity and heights of the feet, "odometry" for what
                odometry estimates, "imu" for that, gravity's direction and the angular velocity.
            max_episode_steps: Control steps after which an episode is truncated.
            autoreset_mode: When an episode that ended starts anew: "NextStep", "SameStep" (the last
                observation is in `info["final_obs"]`), or "Disabled" (by `reset` with a
                `reset_mask` among its options). Most of gymnasium's wrappers want the first.
            render_mode: "rgb_array" for a picture (360, 640, 3) of each robot; needs EGL.

        Raises:
            InputError: if an argument is out of range, there is no such gait or mode, or EGL cannot
                render here.
        """
        self.num_envs = check_num_envs(num_envs)
        gait = gait_given(gait)
        self.render_mode = render_mode
        self._renderer = Renderer(load_robot(robot), render_mode)
        self._mode = find_autoreset_mode(autoreset_mode)
        self.metadata = {**self.metadata, "autoreset_mode": self._mode}
        self.single_action_space = action_space()
        own = find_senses(senses)
        self.single_observation_space = observation_space(gait, imu=own.observes_imu)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self._simulator = BatchSimulator(
            TaskConfig(
                gait,
                randomization or Randomization(),
                episode_steps=max_episode_steps,
                robot=load_robot(robot),
                observes_imu=own.observes_imu,
            ),
            BatchPhysics(load_robot(robot), *(stations or [StationConfig()])),
            n_robots=num_envs,
            generator=self.np_random,
            estimator=own.estimator,
        )
        self._ended: BoolArray | None = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        """Starts an episode for every robot, or for those that `options["reset_mask"]` (n,) names.

        Raises:
            InputError: if the mask is none.
            ResetNeeded: if only some robots are reset before all of them ever were.
        """
        mask = find_reset_mask(options, self.num_envs)
        super().reset(seed=seed)
        self._simulator.generator = self.np_random
        if mask.all():
            self._simulator.resample_friction()
            self._ended = np.zeros(self.num_envs, dtype=bool)
        ended = self._check_reset("reset of some robots")
        self._simulator.reset(np.flatnonzero(mask))
        self._ended = ended & ~mask
        failures = np.zeros((self.num_envs, len(FAILURES)), dtype=bool)
        return self._simulator.observe(), self._info(failures, np.zeros(self.num_envs), mask)

    def step(
        self, actions: Array
    ) -> tuple[Array, Array, NDArray[Any], NDArray[Any], dict[str, Any]]:
        """Holds actions (n, 12) for one control step.

        Raises:
            InputError: if the actions are of another shape, or not all finite numbers.
            ResetNeeded: before the first reset, or if robots whose episode ended were to be reset
                and were not.
        """
        actions = check_actions(actions, (self.num_envs, quadruped.N_JOINTS))
        begun = self._check_reset("step")
        if self._mode == AutoresetMode.DISABLED and begun.any():
            raise ResetNeeded(
                f"step: the episodes of robots {np.flatnonzero(begun).tolist()} ended; call "
                'reset(options={"reset_mask": terminated | truncated}) first'
            )
        # The physics leaves a robot without a finite action as it is, and the task pays it
        # nothing.
        outcome = self._simulator.step(np.where(begun[:, None], np.nan, actions))
        terminated, truncated = outcome.terminated & ~begun, outcome.truncated & ~begun
        self._ended = terminated | truncated
        finals: dict[str, Any] = {}
        if self._mode == AutoresetMode.SAME_STEP and self._ended.any():
            begun, self._ended = self._ended, np.zeros(self.num_envs, dtype=bool)
            finals = self._finals(begun, outcome)
        self._simulator.reset(np.flatnonzero(begun))
        info = self._info(
            outcome.failures & ~begun[:, None],
            np.where(begun, 0.0, outcome.plain_reward),
            np.ones(self.num_envs, dtype=bool),
        )
        observations = self._simulator.observe()
        return observations, outcome.reward, terminated, truncated, info | finals

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:  # type: ignore[override]
        """Takes a picture (360, 640, 3) of each robot; None without a render mode.

        Raises:
            ResetNeeded: before the first reset.
        """
        self._check_reset("render")
        return self._renderer.take(self._simulator.state.plant)

    def close_extras(self, **kwargs: Any) -> None:
        """Lets go of the camera."""
        self._renderer.close()

    def _check_reset(self, asked: str) -> BoolArray:
        if self._ended is None:
            raise ResetNeeded(f"{asked}: no episode has begun; call reset() first")
        return self._ended

    def _finals(self, ended: BoolArray, outcome: BatchStep) -> dict[str, Any]:
        """Reports the last step of episodes, before the next ones begin."""
        final_obs = np.full(self.num_envs, None, dtype=object)
        for i, observation in enumerate(self._simulator.observe()):
            if ended[i]:
                final_obs[i] = observation
        final_info = self._info(outcome.failures, outcome.plain_reward, ended)
        finals = {"final_obs": final_obs, "final_info": final_info}
        return finals | {f"_{name}": ended.copy() for name in finals}

    def _info(self, failures: BoolArray, plain_reward: Array, mask: BoolArray) -> dict[str, Any]:
        """Puts what is known of the robots in `mask` (n,) as gymnasium's vectors have it."""
        names = np.full(self.num_envs, None, dtype=object)
        for i, shown in enumerate(failures):
            names[i] = tuple(np.array(FAILURES)[shown].tolist()) if shown.any() else ()
        info = {
            "failures": names,
            "plain_reward": plain_reward,
            "command": self._simulator.state.command.velocity.copy(),
        }
        return info | {f"_{name}": mask.copy() for name in info}

"""Gymnasium environments of the task: one robot, or many in batch.

Importing this module registers `glassgait/Locomotion-v0`::

    import gymnasium
    import glassgait.diagrams.gym

    gymnasium.register_envs(glassgait.diagrams.gym)  # does nothing; silences linters
    env = gymnasium.make("glassgait/Locomotion-v0", gait="trot")
    envs = gymnasium.make_vec("glassgait/Locomotion-v0", num_envs=16, gait="trot")

`gymnasium.make("glassgait.diagrams.gym:glassgait/Locomotion-v0")` needs no import.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import gymnasium
import numpy as np
from gymnasium.spaces import Box
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from glassgait.diagrams.batch import BatchSimulator
from glassgait.diagrams.physics import make_physics
from glassgait.diagrams.station import StationConfig
from glassgait.diagrams.task import TaskConfig
from glassgait.models.arrays import Array
from glassgait.models.control import BoolArray
from glassgait.models.estimation.odometry import Odometry
from glassgait.models.policies.library import find_gait
from glassgait.models.robots import quadruped
from glassgait.models.robots.library import load_robot
from glassgait.models.robots.robot import DEFAULT_ROBOT
from glassgait.models.task import EPISODE_STEPS
from glassgait.models.task.gait import Gait
from glassgait.models.task.observation import ObservationLayout
from glassgait.models.task.randomization import Randomization
from glassgait.models.task.termination import FAILURES

ENVIRONMENT_ID: Final = "glassgait/Locomotion-v0"

ACTION_BOUND: Final = 8.0
"""Bound of the action space, 2 rad from the default stance. Shipped experts' actions are from -4.9
to 5.2. An episode ends if the squared change of the action in one step exceeds 60."""


class LocomotionVectorEnv(VectorEnv[Array, Array, NDArray[Any]]):
    """Many robots in the batch simulator.

    Observations (n, 53 + n_states) are those of the shipped experts; see `ObservationLayout`.
    Actions (n, 12) are scaled offsets of the joint targets, as those of policies. Rewards and end
    flags are (n,). `info` has the names of `failures`, the `plain_reward` without the reward
    machine's factor and the `command` (2; m/s, rad/s) of each robot.

    Each episode draws a state, commands and noise. A group of robots shares its friction, which a
    reset draws again. Pushes occur between control steps: the next observation shows them, the
    reward does not. Failures of the task terminate an episode. The step after an episode's end
    starts the next one, ignores the robot's action and gives no reward (`AutoresetMode.NEXT_STEP`).
    """

    metadata = {"autoreset_mode": AutoresetMode.NEXT_STEP}  # noqa: RUF012

    def __init__(
        self,
        num_envs: int = 1,
        gait: Gait | str | Path = "trot",
        *,
        robot: str | Path = DEFAULT_ROBOT,
        stations: Sequence[StationConfig] | None = None,
        randomization: Randomization | None = None,
        max_episode_steps: int = EPISODE_STEPS,
    ) -> None:
        """Takes names or files of gait and robot, and one station per group of robots."""
        gait = gait if isinstance(gait, Gait) else find_gait(gait)

        # The spaces.
        self.num_envs = num_envs
        size = ObservationLayout(gait.n_states, imu=True).size
        self.single_observation_space = Box(-np.inf, np.inf, (size,), np.float64)
        actions = (quadruped.N_JOINTS,)
        self.single_action_space = Box(-ACTION_BOUND, ACTION_BOUND, actions, np.float64)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)

        # The task. A reset replaces its generator.
        self._simulator = BatchSimulator(
            TaskConfig(
                gait,
                randomization or Randomization(),
                episode_steps=max_episode_steps,
                robot=load_robot(robot),
                observes_imu=True,
            ),
            make_physics(load_robot(robot), *(stations or [StationConfig()])),
            n_robots=num_envs,
            generator=self.np_random,
            estimator=Odometry(),
        )
        self._ended = np.zeros(num_envs, dtype=bool)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        """Starts an episode of every robot."""
        super().reset(seed=seed)
        self._simulator.generator = self.np_random
        self._simulator.resample_friction()
        self._simulator.reset()
        self._ended = np.zeros(self.num_envs, dtype=bool)
        failures = np.zeros((self.num_envs, len(FAILURES)), dtype=bool)
        return self._simulator.observe(), self._info(failures, np.zeros(self.num_envs))

    def step(
        self, actions: Array
    ) -> tuple[Array, Array, NDArray[Any], NDArray[Any], dict[str, Any]]:
        """Holds actions (n, 12) for one control step."""
        restarts = self._ended
        outcome = self._simulator.step(np.where(restarts[:, None], np.nan, actions))
        terminated, truncated = outcome.terminated & ~restarts, outcome.truncated & ~restarts
        self._ended = terminated | truncated
        self._simulator.reset(np.flatnonzero(restarts))
        reward, plain_reward = (
            np.where(restarts, 0.0, values) for values in (outcome.reward, outcome.plain_reward)
        )
        info = self._info(outcome.failures & ~restarts[:, None], plain_reward)
        return self._simulator.observe(), reward, terminated, truncated, info

    def _info(self, failures: BoolArray, plain_reward: Array) -> dict[str, Any]:
        # Vector environments add to each entry a mask of the robots that have it.
        names = np.empty(self.num_envs, dtype=object)
        names[:] = [tuple(np.array(FAILURES)[row].tolist()) for row in failures]
        info = {
            "failures": names,
            "plain_reward": plain_reward,
            "command": self._simulator.state.command.velocity.copy(),
        }
        return info | {f"_{name}": np.ones(self.num_envs, dtype=bool) for name in info}


class LocomotionEnv(gymnasium.Env[Array, Array]):
    """One robot of `LocomotionVectorEnv`; `gymnasium.make` limits an episode to 20 s."""

    # Not inherited, since Drake's `DrakeGymEnv` changes the shared default.
    metadata = {"render_modes": []}  # noqa: RUF012

    def __init__(
        self,
        gait: Gait | str | Path = "trot",
        *,
        station: StationConfig | None = None,
        **settings: Any,
    ) -> None:
        """Takes `robot` and `randomization` as `LocomotionVectorEnv` does."""
        # Only a `TimeLimit` may truncate an episode.
        self._envs = LocomotionVectorEnv(
            1, gait, stations=[station or StationConfig()], max_episode_steps=2**31, **settings
        )
        self.action_space = self._envs.single_action_space
        self.observation_space = self._envs.single_observation_space

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        super().reset(seed=seed)
        observations, info = self._envs.reset(seed=seed)
        return observations[0], _first(info)

    def step(self, action: Array) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """Holds an action (12,) for one control step."""
        observations, rewards, terminated, _, info = self._envs.step(np.asarray(action)[None])
        return observations[0], float(rewards[0]), bool(terminated[0]), False, _first(info)


def _first(info: dict[str, Any]) -> dict[str, Any]:
    return {name: values[0] for name, values in info.items() if not name.startswith("_")}


gymnasium.register(
    ENVIRONMENT_ID,
    entry_point=f"{__name__}:LocomotionEnv",
    vector_entry_point=f"{__name__}:LocomotionVectorEnv",
    max_episode_steps=EPISODE_STEPS,
)

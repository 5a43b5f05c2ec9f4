"""Gymnasium's two faces of the task: one robot in the systems diagram, and many in batch."""

from collections.abc import Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from glassgait.diagrams.batch import BatchSimulator
from glassgait.diagrams.batch_physics import BatchPhysics
from glassgait.diagrams.locomotion import MakeLocomotion
from glassgait.diagrams.plant_state import push
from glassgait.diagrams.rollout import make_simulator
from glassgait.diagrams.scenario import Scenario
from glassgait.diagrams.station import StationConfig, set_friction
from glassgait.diagrams.task_config import TaskConfig
from glassgait.models.a1 import robot
from glassgait.models.a1.robot import Array
from glassgait.models.task import CONTROL_PERIOD, EPISODE_STEPS
from glassgait.models.task.gait import Gait
from glassgait.models.task.observation import ObservationLayout
from glassgait.models.task.randomization import Randomization
from glassgait.models.task.termination import FAILURES

ACTION_BOUND = 10.0
"""Bound of the action spaces; ten is 2.5 rad of joint target, past every joint's range."""


def action_space() -> gym.spaces.Box:
    """Returns the space of actions (12,)."""
    return gym.spaces.Box(-ACTION_BOUND, ACTION_BOUND, (robot.N_JOINTS,), np.float64)


def observation_space(gait: Gait) -> gym.spaces.Box:
    """Returns the space of observations (47 + n_states,)."""
    size = ObservationLayout(gait.n_states).size
    return gym.spaces.Box(-np.inf, np.inf, (size,), np.float64)


class LocomotionEnv(gym.Env[Array, Array]):
    """One robot in the systems diagram.

    The body state is observed by its true values. An episode is terminated by the task's failures,
    which `info["failures"]` names, and truncated after 20 s.

    As in `LocomotionVectorEnv`, each episode draws a state, a friction, commands and noise, and
    pushes come between two control steps: the next observation shows them, the reward does not.

    `pydrake.gym.DrakeGymEnv` would serve, were it not that it adds up time step by step: once the
    sum passes a control instant by a rounding error, the diagram latches the action before.
    """

    metadata = {"render_modes": []}  # noqa: RUF012 - gymnasium declares it so

    def __init__(
        self,
        gait: Gait,
        station: StationConfig | None = None,
        randomization: Randomization | None = None,
    ) -> None:
        """
        Args:
            gait: The gait.
            station: Physics; its friction is drawn anew for each episode.
            randomization: What differs between episodes.
        """
        self.action_space = action_space()
        self.observation_space = observation_space(gait)
        self._randomization = randomization or Randomization()
        self._gait = gait
        self._config = Scenario(
            station=station or StationConfig(),
            sensor_noise=self._randomization.observation_noise,
        )
        self._steps = 0
        # A diagram that is built again for every episode would leak; this one is used for all.
        self._diagram = MakeLocomotion(gait, self._config)
        self._ports = {
            name: self._diagram.GetOutputPort(name)
            for name in ("observations", "reward", "plain_reward", "failures", "command")
        }

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        """Starts an episode."""
        super().reset(seed=seed)
        generator = self.np_random
        self._steps = 0
        self._simulator = make_simulator(
            self._diagram,
            state=self._randomization.initial_states(1, generator)[0],
            seed=int(generator.integers(2**31)),
        )
        self._context = self._simulator.get_mutable_context()
        self._set_friction(generator.uniform(*self._randomization.friction))
        return self._eval("observations"), self._info()

    def step(self, action: Array) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """Holds an action (12) for one control step."""
        self._diagram.GetInputPort("actions").FixValue(self._context, action)
        self._steps += 1
        self._simulator.AdvanceTo(self._steps * CONTROL_PERIOD)
        info = self._info()
        truncated = self._steps >= EPISODE_STEPS
        reward = float(self._eval("reward")[0])
        if self._randomization.push_speed > 0:
            push(self._diagram, self._context, self._randomization.pushes(1, self.np_random)[0])
        return self._eval("observations"), reward, bool(info["failures"]), truncated, info

    def _set_friction(self, friction: float) -> None:
        plant = self._diagram.GetSubsystemByName("plant")
        scene_graph = self._diagram.GetSubsystemByName("scene_graph")
        context = scene_graph.GetMyMutableContextFromRoot(self._context)
        set_friction(plant, scene_graph, friction, context)

    def _eval(self, port: str) -> Array:
        return self._ports[port].Eval(self._context).copy()

    def _info(self) -> dict[str, Any]:
        shown = self._eval("failures") > 0.5
        return {
            "failures": tuple(np.array(FAILURES)[shown].tolist()),
            "plain_reward": float(self._eval("plain_reward")[0]),
            "command": self._eval("command"),
        }


class LocomotionVectorEnv(VectorEnv[Array, Array, NDArray[Any]]):
    """Many robots in the batch simulator.

    Autoreset mode: same step. The observation after an episode's last step is the first of the
    next; the last one is in `info["final_obs"]`. The body state is observed by its true values.
    """

    metadata = {"autoreset_mode": AutoresetMode.SAME_STEP}  # noqa: RUF012 - as gymnasium's

    def __init__(
        self,
        gait: Gait,
        num_envs: int,
        stations: Sequence[StationConfig] | None = None,
        randomization: Randomization | None = None,
    ) -> None:
        """
        Args:
            gait: The gait.
            num_envs: Number of robots.
            stations: Physics of each group of robots, which also has a friction of its own; by
                default all robots form one group.
            randomization: What differs between robots and episodes.
        """
        self.num_envs = num_envs
        self.single_action_space = action_space()
        self.single_observation_space = observation_space(gait)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self._simulator = BatchSimulator(
            TaskConfig(gait, randomization or Randomization()),
            BatchPhysics(*(stations or [StationConfig()])),
            n_robots=num_envs,
            generator=self.np_random,
        )

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        """Starts an episode for every robot."""
        super().reset(seed=seed)
        self._simulator.generator = self.np_random
        self._simulator.resample_friction()
        self._simulator.reset()
        return self._simulator.observe(), {}

    def step(
        self, actions: Array
    ) -> tuple[Array, Array, NDArray[Any], NDArray[Any], dict[str, Any]]:
        """Holds actions (n, 12) for one control step."""
        outcome = self._simulator.step(actions)
        ended = outcome.terminated | outcome.truncated
        info: dict[str, Any] = {
            "plain_reward": outcome.plain_reward,
            "failures": outcome.failures,
        }
        if ended.any():
            final = self._simulator.observe()
            info["final_obs"] = np.array(
                [row if end else None for row, end in zip(final, ended, strict=True)], dtype=object
            )
            info["_final_obs"] = ended
            self._simulator.reset(np.flatnonzero(ended))
        observation = self._simulator.observe()
        return observation, outcome.reward, outcome.terminated, outcome.truncated, info

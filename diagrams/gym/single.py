"""One robot in the systems diagram, as a gymnasium environment."""

from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.error import ResetNeeded
from numpy.typing import NDArray
from pydrake.systems.analysis import Simulator

from glassgait.diagrams.gym.arguments import check_actions, find_senses, gait_given
from glassgait.diagrams.gym.rendering import RENDER_FPS, RENDER_MODES, Renderer
from glassgait.diagrams.gym.spaces import action_space, observation_space
from glassgait.diagrams.locomotion import MakeLocomotion
from glassgait.diagrams.plant_state import push, recenter
from glassgait.diagrams.rollout import make_simulator
from glassgait.diagrams.scenario import Scenario
from glassgait.diagrams.station import StationConfig, set_friction
from glassgait.models.arrays import Array
from glassgait.models.robots import quadruped
from glassgait.models.robots.library import load_robot
from glassgait.models.robots.robot import DEFAULT_ROBOT
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.gait import Gait
from glassgait.models.task.randomization import Randomization
from glassgait.models.task.termination import FAILURES


class LocomotionEnv(gym.Env[Array, Array]):
    """One robot in the systems diagram.

    Observations (47 + n_states,), 6 more where an IMU is observed, follow `ObservationLayout`; the
    body state is observed by its true values or by odometry. Actions (12,) are scaled offsets of
    the joint targets, as the policies' are. `info` has the `failures` by name, the `plain_reward`
    without the machine's factor, and the `command` (2; m/s, rad/s).

    An episode is terminated by the task's failures. Its end after 20 s is gymnasium's `TimeLimit`,
    which `gymnasium.make` adds.

    As in `LocomotionVectorEnv`, each episode draws a state, a friction, commands and noise, and
    pushes come between two control steps: the next observation shows them, the reward does not.

    `pydrake.gym.DrakeGymEnv` would serve, were it not that it adds up time step by step: once the
    sum passes a control instant by a rounding error, the diagram latches the action before.
    """

    metadata = {"render_modes": [*RENDER_MODES], "render_fps": RENDER_FPS}  # noqa: RUF012

    def __init__(
        self,
        gait: Gait | str | Path = "trot",
        *,
        robot: str | Path = DEFAULT_ROBOT,
        station: StationConfig | None = None,
        randomization: Randomization | None = None,
        senses: str = "true",
        render_mode: str | None = None,
    ) -> None:
        """
        Args:
            gait: The gait, its name or its file.
            robot: Name of a robot that ships, or path of one's own `robot.yaml`.
            station: Physics; its friction is drawn anew for each episode.
            randomization: What differs between episodes, but for the latency and the share of
                stuck sensors.
            senses: "true" to observe the true velocity and heights of the feet, "odometry" for what
                odometry estimates, "imu" for that, gravity's direction and the angular velocity.
            render_mode: "rgb_array" for pictures (360, 640, 3); needs EGL.

        Raises:
            InputError: if there is no such gait, senses or render mode, or EGL cannot render here.
        """
        gait = gait_given(gait)
        self.render_mode = render_mode
        self._robot = load_robot(robot)
        self._renderer = Renderer(self._robot, render_mode)
        self.action_space = action_space()
        own = find_senses(senses)
        self.observation_space = observation_space(gait, imu=own.observes_imu)
        self._randomization = randomization or Randomization()
        scenario = Scenario(
            robot=str(robot),
            station=station or StationConfig(),
            sensor_noise=self._randomization.observation_noise,
            encoder_bias=self._randomization.encoder_bias,
            imu=self._randomization.imu,
            contact_flips=self._randomization.contact_flips,
            stuck_open=self._randomization.stuck_open,
            stuck_closed=self._randomization.stuck_closed,
        )
        self._station, self._ground = scenario.station, scenario.station.ground
        self._steps = 0
        # A diagram that is built again for every episode would leak; this one is used for all.
        self._diagram = MakeLocomotion(gait, scenario, senses=own)
        self._simulator: Simulator | None = None
        self._ports = {
            name: self._diagram.GetOutputPort(name)
            for name in ("observations", "reward", "plain_reward", "failures", "command", "state")
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
            state=self._randomization.initial_states(self._robot, 1, generator, self._ground)[0],
            seed=int(generator.integers(2**31)),
        )
        self._set_friction(generator.uniform(*self._randomization.friction))
        return self._eval("observations"), self._info()

    def step(self, action: Array) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """Holds an action (12,) for one control step.

        Raises:
            InputError: if the action is of another shape, or not of finite numbers.
            ResetNeeded: before the first reset.
        """
        action = check_actions(action, (quadruped.N_JOINTS,))
        simulator = self._standing("step")
        context = simulator.get_mutable_context()
        self._diagram.GetInputPort("actions").FixValue(context, action)
        self._steps += 1
        recenter(self._diagram, context)
        simulator.AdvanceTo(self._steps * CONTROL_PERIOD)
        info = self._info()
        reward = float(self._eval("reward")[0])
        if self._randomization.push_speed > 0:
            push(self._diagram, context, self._randomization.pushes(1, self.np_random)[0])
        return self._eval("observations"), reward, bool(info["failures"]), False, info

    def render(self) -> NDArray[np.uint8] | None:  # type: ignore[override]
        """Takes a picture (360, 640, 3) of the robot; None without a render mode.

        Raises:
            ResetNeeded: before the first reset.
        """
        self._standing("render")
        pictures = self._renderer.take(self._eval("state")[None])
        return None if pictures is None else pictures[0]

    def close(self) -> None:
        """Lets go of the camera."""
        self._renderer.close()

    def _standing(self, asked: str) -> Simulator:
        if self._simulator is None:
            raise ResetNeeded(f"{asked}: no episode has begun; call reset() first")
        return self._simulator

    def _set_friction(self, friction: float) -> None:
        plant = self._diagram.GetSubsystemByName("plant")
        scene_graph = self._diagram.GetSubsystemByName("scene_graph")
        root = self._standing("reset").get_mutable_context()
        context = scene_graph.GetMyMutableContextFromRoot(root)
        set_friction(plant, scene_graph, friction, context, terrain=self._station.terrain)

    def _eval(self, port: str) -> Array:
        return self._ports[port].Eval(self._standing(port).get_context()).copy()

    def _info(self) -> dict[str, Any]:
        shown = self._eval("failures") > 0.5
        return {
            "failures": tuple(np.array(FAILURES)[shown].tolist()),
            "plain_reward": float(self._eval("plain_reward")[0]),
            "command": self._eval("command"),
        }

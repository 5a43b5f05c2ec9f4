"""Rollouts of the locomotion diagram, recorded at every control step."""

from collections import deque
from collections.abc import Callable, Iterator, Mapping
from itertools import count
from typing import TYPE_CHECKING

import numpy as np
from pydrake.common import RandomGenerator
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, Diagram

from glassgait.diagrams.station import WORLD_STATE
from glassgait.models.arrays import Array
from glassgait.models.errors import InputError, shown
from glassgait.models.robots import kinematics, quadruped
from glassgait.models.task import CONTROL_PERIOD
from glassgait.systems.reward import FallMonitor
from glassgait.systems.sensors import WorldState

if TYPE_CHECKING:
    import pandas as pd

RECORDED_PORTS = (
    *("action", "observation", "reward", "plain_reward", "reward_terms", "rm_state"),
    *("rm_iterations", "served_dwell", "foot_contact", "foot_height", "failures"),
    *("command", "commanded_dwell", "state"),
)

KEPT_STEPS = 3000
"""Number of latest control steps that a recording without an end keeps (one minute)."""

FALL_MONITOR = "fall_monitor"

_INSTANT_TOLERANCE = 1e-9  # allows for the rounding of sums of control periods (s)


class Rollout(dict[str, Array]):
    """Outputs by name (n + 1, size) and `time` (n + 1; s), at control instants before updates."""

    def __init__(self, time: Array, outputs: Mapping[str, Array]) -> None:
        super().__init__(outputs)
        self.time = time

    def __missing__(self, name: str) -> Array:
        raise KeyError(f"{name!r} is not recorded; recorded are {', '.join(self)}")

    def __repr__(self) -> str:
        return f"Rollout of {len(self.time) - 1} control steps, with {', '.join(self)}"

    def to_frame(self) -> "pd.DataFrame":
        """Returns a data frame with one row per control instant and one column per number."""
        # Imported here, since few programs need it.
        import pandas as pd  # noqa: PLC0415

        columns = {
            name if values.shape[1] == 1 else f"{name}_{i}": column
            for name, values in self.items()
            for i, column in enumerate(values.T)
        }
        return pd.DataFrame({"time": self.time, **columns})

    @property
    def failed(self) -> bool:
        """True if the rollout ended in a failure."""
        return bool(self["failures"][-1].any())


def make_simulator(diagram: Diagram, *, seed: int = 0, state: Array | None = None) -> Simulator:
    """Makes a simulator of a diagram with one robot, ready to advance.

    Args:
        diagram: The robot's diagram or a larger root diagram that contains it.
        seed: Seed of commands and sensor errors; the robot's state is not drawn.
        state: Plant state x (37); by default standing at rest.
    """
    simulator = Simulator(diagram)
    begin_anew(simulator, seed=seed, state=state)
    return simulator


def begin_anew(simulator: Simulator, *, seed: int = 0, state: Array | None = None) -> None:
    """Resets a simulator to time 0, as `make_simulator` returns it; fixed inputs stay fixed."""
    diagram, context = simulator.get_system(), simulator.get_mutable_context()
    context.SetTime(0.0)
    diagram.SetDefaultContext(context)
    diagram.SetRandomContext(context, RandomGenerator(seed))
    set_plant_state(diagram, context, state)
    simulator.Initialize()


def record(
    simulator: Simulator,
    n_steps: int | None,
    *,
    stop_on_failure: bool = True,
    stopped: Callable[[], bool] = lambda: False,
) -> Rollout:
    """Advances the simulator by control steps and records every output.

    Args:
        n_steps: Number of control steps. With None, a failure or `stopped` ends the recording,
            which keeps the last `KEPT_STEPS`.
        stopped: Called after every step; True ends the recording. A monitor that ends
            `AdvanceTo` ends it as well.
    """
    # Check that the simulator is at a control instant.
    if n_steps is not None and n_steps < 0:
        raise InputError(f"record: n_steps is {shown(n_steps)}; it must be 0 or more")
    diagram, root = simulator.get_system(), simulator.get_mutable_context()
    locomotion = find_locomotion(diagram)
    context, time = locomotion.GetMyContextFromRoot(root), root.get_time()
    first = round(time / CONTROL_PERIOD)
    # After the instant, even by a rounding error, its updates are done.
    if not 0.0 <= first * CONTROL_PERIOD - time < _INSTANT_TOLERANCE:
        raise InputError(f"record: the simulator is at {time:g} s; advance it to a control instant")

    # Allocate the recording. Not every diagram has every port.
    names = filter(locomotion.HasOutputPort, RECORDED_PORTS)
    ports = {name: locomotion.GetOutputPort(name) for name in names}
    maxlen = None if n_steps is not None else KEPT_STEPS + 1
    recorded: dict[str, deque[Array]] = {name: deque(maxlen=maxlen) for name in ports}
    times: deque[float] = deque(maxlen=maxlen)

    # Advance and record. On ground that repeats, the robot must be moved back into the period.
    repeats = locomotion.HasSubsystemNamed(WORLD_STATE)
    for step in count() if n_steps is None else range(n_steps + 1):
        # AdvanceTo handles the updates due at its start, but not those due at its end. Even a call
        # with the current time would therefore change the state.
        if step > 0:
            instant = (first + step) * CONTROL_PERIOD
            if repeats:
                recenter(diagram, root)
            if simulator.AdvanceTo(instant).return_time() < instant:
                break
        times.append(root.get_time())
        for name, port in ports.items():
            recorded[name].append(port.Eval(context).copy())
        if stopped() or (stop_on_failure and recorded["failures"][-1].any()):
            break
    return Rollout(np.array(times), {name: np.array(values) for name, values in recorded.items()})


def find_locomotion(diagram: Diagram) -> Diagram:
    """Finds the only diagram from `MakeLocomotion`: the given one or one inside it."""
    diagrams = list(_locomotions(diagram))
    if len(diagrams) != 1:
        raise InputError(
            f"diagram {diagram.get_name()!r} contains {len(diagrams)} diagrams from "
            "MakeLocomotion; pass a diagram that contains exactly one"
        )
    return diagrams[0]


def _locomotions(diagram: Diagram) -> Iterator[Diagram]:
    # Search for the fall monitor, since a larger diagram may rename the robot's diagram.
    if diagram.HasSubsystemNamed(FALL_MONITOR):
        yield diagram
    for system in diagram.GetSystems():
        if isinstance(system, Diagram):
            yield from _locomotions(system)


def set_plant_state(diagram: Diagram, context: Context, state: Array | None = None) -> None:
    """Sets a robot's unwrapped plant state x (37), by default standing at rest."""
    robot = _Robot(diagram, context)
    if state is None:
        standing = kinematics.standing_state(robot.monitor.robot)
        state = robot.monitor.ground.stand(robot.monitor.robot, standing)
    _check_numbers("state", state, robot.plant.num_multibody_states())
    if robot.world is not None:
        away = robot.monitor.ground.periods(state)
        robot.world.set_away(robot.world.GetMyMutableContextFromRoot(context), away)
        state = kinematics.moved_by(state, -away)
    robot.plant.SetPositionsAndVelocities(robot.plant_context, state)


def recenter(diagram: Diagram, context: Context) -> None:
    """Moves a robot that left the middle period of its ground back by whole periods.

    The diagram's outputs do not change. The root context must be at a control instant.
    """
    robot = _Robot(diagram, context)
    if robot.world is None:
        return
    state = robot.plant.GetPositionsAndVelocities(robot.plant_context)
    away = robot.monitor.ground.periods(state)
    if np.isfinite(away).all() and away.any():
        moved = kinematics.moved_by(state, -away)
        robot.plant.SetPositionsAndVelocities(robot.plant_context, moved)
        world = robot.world.GetMyMutableContextFromRoot(context)
        robot.world.set_away(world, robot.world.away(world) + away)


def push(diagram: Diagram, context: Context, velocity: Array) -> None:
    """Adds a velocity (3; m/s, world frame) to a robot's trunk in the root context."""
    _check_numbers("velocity", velocity, 3)
    robot = _Robot(diagram, context)
    state = robot.plant.GetPositionsAndVelocities(robot.plant_context)
    state[quadruped.LINEAR_VELOCITY] += velocity
    robot.plant.SetPositionsAndVelocities(robot.plant_context, state)


def _check_numbers(name: str, values: Array, size: int) -> None:
    # Drake would end the process.
    if np.shape(values) != (size,) or not np.isfinite(values).all():
        raise InputError(f"{name} is {shown(values)}; give {size} finite numbers")


class _Robot:
    def __init__(self, diagram: Diagram, context: Context) -> None:
        locomotion = find_locomotion(diagram)
        self.plant: MultibodyPlant = locomotion.GetSubsystemByName("plant")  # type: ignore[assignment]
        self.plant_context = self.plant.GetMyMutableContextFromRoot(context)
        # The monitor holds the robot and its ground.
        self.monitor: FallMonitor = locomotion.GetSubsystemByName(FALL_MONITOR)  # type: ignore[assignment]
        self.world: WorldState | None = None
        if locomotion.HasSubsystemNamed(WORLD_STATE):
            self.world = locomotion.GetSubsystemByName(WORLD_STATE)  # type: ignore[assignment]

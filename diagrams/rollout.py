"""Rollouts of the locomotion diagram, recorded at every control step."""

from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import count

import numpy as np
from pydrake.common import RandomGenerator
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator, SimulatorConfig
from pydrake.systems.framework import Context, Diagram, EventStatus, System

from glassgait.diagrams.station import WORLD_STATE
from glassgait.models.arrays import Array
from glassgait.models.errors import InputError, shown
from glassgait.models.robots import kinematics, quadruped
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.termination import FAILURES
from glassgait.systems.reward import FallMonitor
from glassgait.systems.sensors import WorldState

RECORDED_PORTS = (
    "actions",
    "observations",
    "reward",
    "plain_reward",
    "reward_terms",
    "rm_state",
    "rm_iterations",
    "served_dwell",
    "foot_contact",
    "foot_height",
    "failures",
    "command",
    "commanded_dwell",
    "state",
)

KEPT_STEPS = 3000
"""Control steps that a recording without an end keeps (one minute), the latest ones."""

FALL_MONITOR = "fall_monitor"
"""Name of the fall monitor, which knows the robot and its ground."""

_INSTANT_TOLERANCE = 1e-9
"""Rounding error of times that are sums of control periods (s)."""


@dataclass(frozen=True)
class Rollout:
    """Values of the diagram's outputs at n + 1 control instants, before each instant's updates.

    Attributes:
        time: The instants (n + 1; s).
        values: Outputs by port name, each (n + 1, size).
    """

    time: Array
    values: dict[str, Array]

    def __getitem__(self, port: str) -> Array:
        return self.values[port]

    @property
    def failed(self) -> bool:
        """Whether the rollout ended in a failure."""
        return bool(self["failures"][-1].any())


def make_simulator(
    diagram: Diagram,
    *,
    state: Array | None = None,
    seed: int = 0,
    accuracy: float | None = None,
    realtime_rate: float = 0.0,
) -> Simulator:
    """Makes a simulator that is ready to advance.

    Args:
        diagram: What `MakeLocomotion` built, or a larger diagram that holds it.
        state: The plant's initial state x (37); standing at rest by default.
        seed: Seed of all that the diagram draws at random but the robot's state.
        accuracy: Accuracy of the error-controlled contact integrator, for a continuous plant.
        realtime_rate: Greatest speed in wall time; 0 is as fast as can be.

    Raises:
        InputError: if the diagram is a part of a larger one, or does not hold exactly one robot.
    """
    path = diagram.GetSystemPathname()
    if path.count("::") > 1:
        raise InputError(f"simulator: {path!r} is part of a larger diagram; give the outermost one")
    context = diagram.CreateDefaultContext()
    _begin(diagram, context, state, seed)
    simulator = Simulator(diagram, context)
    if accuracy is not None:
        use_error_control(simulator, accuracy)
    simulator.set_target_realtime_rate(realtime_rate)
    simulator.Initialize()
    return simulator


def begin_anew(simulator: Simulator, *, state: Array | None = None, seed: int = 0) -> None:
    """Puts a simulator back to time 0, as `make_simulator` makes it; fixed inputs stay fixed.

    Args:
        simulator: A simulator that `make_simulator` made.
        state: As `make_simulator`'s.
        seed: As `make_simulator`'s.
    """
    diagram, context = simulator.get_system(), simulator.get_mutable_context()
    assert isinstance(diagram, Diagram)
    context.SetTime(0.0)
    diagram.SetDefaultContext(context)
    _begin(diagram, context, state, seed)
    simulator.Initialize()


def use_error_control(simulator: Simulator, accuracy: float) -> None:
    """Advances a continuous plant by the error-controlled contact integrator.

    Raises:
        InputError: if the plant is not in the simulator's outermost diagram.
    """
    if not simulator.get_system().HasSubsystemNamed("plant"):
        raise InputError(
            "simulator: Drake's error-controlled contact integrator needs the plant in the "
            "outermost diagram; simulate the robot's diagram by itself, or a discrete plant"
        )
    config = SimulatorConfig(integration_scheme="cenic", accuracy=accuracy, use_error_control=True)
    ApplySimulatorConfig(config, simulator)


def stop_at_falls(simulator: Simulator) -> None:
    """Ends `Simulator.AdvanceTo` at the first control instant that shows a failure.

    The status that `AdvanceTo` then returns has the reason `kReachedTerminationCondition` and names
    the failure. The simulator's monitor is replaced.

    Args:
        simulator: A simulator of what `MakeLocomotion` built, or of a larger diagram that holds it.

    Raises:
        InputError: if the simulator's diagram does not hold exactly one robot.
    """
    locomotion = find_locomotion(simulator.get_system())
    port = locomotion.GetOutputPort("failures")

    def monitor(root_context: Context) -> EventStatus:
        # The monitor is called after every step of the plant, also between two control instants.
        if _control_step(root_context) is None:
            return EventStatus.DidNothing()
        shown = port.Eval(locomotion.GetMyContextFromRoot(root_context)) > 0.5
        if not shown.any():
            return EventStatus.DidNothing()
        names = ", ".join(np.array(FAILURES)[shown])
        return EventStatus.ReachedTermination(locomotion, f"the robot shows {names}")

    simulator.set_monitor(monitor)


def record(
    simulator: Simulator,
    n_steps: int | None,
    *,
    stop_on_failure: bool = True,
    stopped: Callable[[], bool] = lambda: False,
) -> Rollout:
    """Advances by control steps and records every output, from where the simulator is.

    Args:
        simulator: A simulator of what `MakeLocomotion` built, or of a larger diagram that holds it,
            at a control instant.
        n_steps: Control steps to take; None for no end but a failure or `stopped`, and then the
            last `KEPT_STEPS` of them are kept.
        stop_on_failure: Whether to end at the first failure.
        stopped: Asked after every step whether to end now. A monitor that ends the simulator's
            advance between two control instants ends the recording as well.

    Raises:
        InputError: if n_steps is negative, the simulator is between two control instants, or its
            diagram does not hold exactly one robot.
    """
    if n_steps is not None and n_steps < 0:
        raise InputError(f"record: n_steps is {shown(n_steps)}; it must be 0 or more")
    locomotion, context = find_locomotion(simulator.get_system()), simulator.get_mutable_context()
    own = locomotion.GetMyMutableContextFromRoot(context)
    first = _control_step(context)
    if first is None:
        raise InputError(
            f"record: the simulator is at {context.get_time():g} s; advance it to a multiple of "
            f"{CONTROL_PERIOD} s"
        )
    ports = {
        name: locomotion.GetOutputPort(name)
        for name in RECORDED_PORTS
        if locomotion.HasOutputPort(name)
    }
    kept = None if n_steps is not None else KEPT_STEPS + 1
    recorded: dict[str, deque[Array]] = {name: deque(maxlen=kept) for name in ports}
    times: deque[float] = deque(maxlen=kept)
    repeats = locomotion.HasSubsystemNamed(WORLD_STATE)
    for step in count() if n_steps is None else range(n_steps + 1):
        # AdvanceTo handles updates that are due where it starts and leaves those where it ends, so
        # even a call with the time it already has would act.
        if step > 0:
            instant = (first + step) * CONTROL_PERIOD
            if repeats:
                recenter(locomotion, own)
            if simulator.AdvanceTo(instant).return_time() < instant:
                break
        times.append(context.get_time())
        for name, port in ports.items():
            recorded[name].append(port.Eval(own).copy())
        if stopped() or (stop_on_failure and recorded["failures"][-1].any()):
            break
    return Rollout(np.array(times), {name: np.array(values) for name, values in recorded.items()})


def _begin(diagram: Diagram, context: Context, state: Array | None, seed: int) -> None:
    """Draws what is drawn at random, and puts the robot into a state."""
    diagram.SetRandomContext(context, RandomGenerator(seed))
    set_plant_state(diagram, context, state)


def _control_step(context: Context) -> int | None:
    """Returns the control step whose updates are due now, or None between two control instants."""
    time = context.get_time()
    step = round(time / CONTROL_PERIOD)
    # Past the instant, even by a rounding error, its updates are done.
    return step if 0.0 <= step * CONTROL_PERIOD - time < _INSTANT_TOLERANCE else None


def find_locomotion(diagram: Diagram) -> Diagram:
    """Finds what `MakeLocomotion` built: the diagram itself, or a part of it at any depth.

    Raises:
        InputError: if there is none, or more than one.
    """
    found = list(_locomotions(diagram))
    if len(found) != 1:
        raise InputError(
            f"locomotion: diagram {diagram.get_name()!r} holds {len(found)} of what MakeLocomotion "
            "builds; give one that holds exactly one"
        )
    return found[0]


def set_plant_state(diagram: Diagram, context: Context, state: Array | None = None) -> None:
    """Puts the robot into a state.

    Args:
        diagram: What `MakeLocomotion` built, or a larger diagram that holds it.
        context: Its own context, or the root context that its context is part of; to be changed.
        state: The plant's state x (37), wherever in the world; standing at rest by default.

    Raises:
        InputError: if the context is of another diagram.
    """
    plant, plant_context = _find_plant(diagram, context)
    monitor = _find_monitor(diagram)
    if state is None:
        state = monitor.ground.stand(monitor.robot, kinematics.standing_state(monitor.robot))
    world = _find_world_state(diagram, context)
    if world is not None:
        away = monitor.ground.periods(state)
        world[0].set_away(world[1], away)
        state = kinematics.moved_by(state, -away)
    plant.SetPositionsAndVelocities(plant_context, state)


def recenter(diagram: Diagram, context: Context) -> None:
    """Moves a robot that has left the middle period of its ground back by whole periods.

    What the diagram's outputs show stays as it is. On a plane nothing happens.

    Args:
        diagram: What `MakeLocomotion` built, or a larger diagram that holds it.
        context: Its own context, or the root context that its context is part of; to be changed,
            at a control instant.

    Raises:
        InputError: if the context is of another diagram.
    """
    world = _find_world_state(diagram, context)
    if world is None:
        return
    system, own = world
    plant, plant_context = _find_plant(diagram, context)
    monitor = _find_monitor(diagram)
    state = plant.GetPositionsAndVelocities(plant_context)
    away = monitor.ground.periods(state)
    if np.isfinite(away).all() and away.any():
        plant.SetPositionsAndVelocities(plant_context, kinematics.moved_by(state, -away))
        system.set_away(own, system.away(own) + away)


def push(diagram: Diagram, context: Context, velocity: Array) -> None:
    """Adds to the velocity of the robot's trunk.

    Args:
        diagram: What `MakeLocomotion` built, or a larger diagram that holds it.
        context: Its own context, or the root context that its context is part of; to be changed.
        velocity: What is added (3; m/s, world frame).

    Raises:
        InputError: if the context is of another diagram.
    """
    plant, plant_context = _find_plant(diagram, context)
    state = plant.GetPositionsAndVelocities(plant_context)
    state[quadruped.LINEAR_VELOCITY] += velocity
    plant.SetPositionsAndVelocities(plant_context, state)


def _find_plant(diagram: Diagram, context: Context) -> tuple[MultibodyPlant, Context]:
    """Finds the robot's plant and its part of the diagram's own context, or of the root's."""
    plant = find_locomotion(diagram).GetSubsystemByName("plant")
    assert isinstance(plant, MultibodyPlant)
    return plant, _own_context(diagram, context, plant)


def _find_monitor(diagram: Diagram) -> FallMonitor:
    """Finds what knows the robot and its ground."""
    monitor = find_locomotion(diagram).GetSubsystemByName(FALL_MONITOR)
    assert isinstance(monitor, FallMonitor)
    return monitor


def _find_world_state(diagram: Diagram, context: Context) -> tuple[WorldState, Context] | None:
    """Finds what knows how far the robot has been moved back, on ground that repeats."""
    locomotion = find_locomotion(diagram)
    if not locomotion.HasSubsystemNamed(WORLD_STATE):
        return None
    world = locomotion.GetSubsystemByName(WORLD_STATE)
    assert isinstance(world, WorldState)
    return world, _own_context(diagram, context, world)


def _own_context(diagram: Diagram, context: Context, system: System) -> Context:
    """Returns a system's part of the diagram's own context, or of the root's."""
    try:
        diagram.ValidateContext(context)
        return diagram.GetMutableSubsystemContext(system, context)
    except RuntimeError:
        pass
    try:
        return system.GetMyMutableContextFromRoot(context)
    except RuntimeError as error:
        raise InputError(
            f"locomotion: the context is not of diagram {diagram.get_name()!r}; give its own "
            "context, or the root's"
        ) from error


def _locomotions(diagram: Diagram) -> Iterator[Diagram]:
    # A larger diagram may give it another name; its fall monitor is always there.
    if diagram.HasSubsystemNamed(FALL_MONITOR) and isinstance(
        diagram.GetSubsystemByName(FALL_MONITOR), FallMonitor
    ):
        yield diagram
    for system in diagram.GetSystems():
        if isinstance(system, Diagram):
            yield from _locomotions(system)

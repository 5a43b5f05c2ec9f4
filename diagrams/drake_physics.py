"""Batch physics with Drake: steps hundreds of stations in C++ threads."""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise

import numpy as np
from pydrake.common import Parallelism
from pydrake.systems.analysis import BatchEvalUniquePeriodicDiscreteUpdate, Simulator
from pydrake.systems.framework import Context, Diagram, DiagramBuilder

from glassgait.diagrams.engine import Engine, Held, IntArray
from glassgait.diagrams.station import AddStation, StationConfig, actuated_joints, set_friction
from glassgait.models.arrays import Array
from glassgait.models.robots import quadruped
from glassgait.models.robots.robot import Robot

FEW_ROBOTS = 2
"""Greatest number of robots that a Python loop advances faster than Drake's batch."""


class DrakeEngine(Engine):
    """Steps the states of many robots in parallel; each group has its station."""

    def __init__(
        self, robot: Robot, stations: Sequence[StationConfig], n_threads: int | None
    ) -> None:
        super().__init__(stations)
        self._groups = [_Group(robot, station) for station in stations]
        n_threads = n_threads or Parallelism.Max().num_threads()
        # Drake releases the interpreter's lock, so groups run concurrently, each on its share of
        # the threads. One group after another would leave threads idle at the end of each.
        n_workers = min(len(stations), n_threads)
        self._workers = ThreadPoolExecutor(n_workers)
        self._parallelism = Parallelism(n_threads // n_workers) if n_threads > 1 else None
        # Start the slowest groups first, so that no thread waits for them at the end.
        self._order = sorted(range(len(stations)), key=lambda i: stations[i].time_step)

    def set_friction(self, friction: Array) -> None:
        for group, value in zip(self._groups, friction, strict=True):
            group.set_friction(float(value))

    def advance(self, states: Array, held: Held, members: list[IntArray]) -> tuple[Array, None]:
        after = np.full_like(states, np.nan)

        def step(i: int) -> None:
            robots = members[i]
            after[robots] = self._groups[i].step(states[robots], held.of(robots), self._parallelism)

        for _ in self._workers.map(step, self._order):
            pass
        return after, None


class _Group:
    """Robots that share a station and its friction."""

    def __init__(self, robot: Robot, station: StationConfig) -> None:
        self._n_steps = station.plant_steps()
        builder = DiagramBuilder()
        self._plant, self._scene_graph, instance = AddStation(builder, robot, station)
        builder.ExportInput(self._plant.get_desired_state_input_port(instance), "desired_state")
        self._terrain = station.terrain
        self._diagram = builder.Build()
        self._context = self._diagram.CreateDefaultContext()

        # Drake's batch copies the context at every call. With many boxes a copy takes longer than
        # hundreds of steps, so other ground than a plane uses one simulator.
        self._clock = _Clock(self._diagram, self._context, station.time_step)
        self._in_batch = station.terrain.is_plane

        # The input is in the order of the actuators.
        port = self._diagram.GetInputPort("desired_state")
        self._desired = port.FixValue(self._context, np.zeros(2 * quadruped.N_JOINTS))
        self._actuator_order = [
            quadruped.JOINTS.index(name) for name in actuated_joints(self._plant)
        ]

    def set_friction(self, friction: float) -> None:
        context = self._scene_graph.GetMyMutableContextFromRoot(self._context)
        set_friction(self._plant, self._scene_graph, friction, context, terrain=self._terrain)

    def step(self, states: Array, held: Held, parallelism: Parallelism | None) -> Array:
        """Advances robots by a control period, in Drake's threads or, with None, in this one."""
        if len(states) == 0:
            return states
        # Split the period at the steps where a robot's targets change.
        waits, moved = held.waits(self._n_steps), states
        changes = np.unique([0, *waits, self._n_steps]).tolist()
        try:
            for start, stop in pairwise(changes):
                targets = np.where(waits[:, None] > start, held.late, held.targets)
                moved = self._advance(moved, targets, stop - start, parallelism)
            return moved
        except RuntimeError:
            # Drake does not name the robot that it cannot advance, so bisect.
            if len(states) == 1:
                return np.full_like(states, np.nan)
            middle = len(states) // 2
            halves = slice(None, middle), slice(middle, None)
            return np.concatenate(
                [self.step(states[half], held.of(half), parallelism) for half in halves]
            )

    def _advance(
        self, states: Array, targets: Array, n_steps: int, parallelism: Parallelism | None
    ) -> Array:
        desired = np.zeros((len(states), 2 * quadruped.N_JOINTS))
        desired[:, : quadruped.N_JOINTS] = targets[:, self._actuator_order]
        if not self._in_batch or parallelism is None or len(states) <= FEW_ROBOTS:
            pairs = zip(states, desired, strict=True)
            return np.array([self._advance_one(state, target, n_steps) for state, target in pairs])
        return BatchEvalUniquePeriodicDiscreteUpdate(
            self._diagram,
            self._context,
            # A flat array, since newer Drake takes a row of length one for a column.
            times=np.zeros(len(states)),
            states=states.T,
            inputs=desired.T,
            num_time_steps=n_steps,
            parallelize=parallelism,
        ).T

    def _advance_one(self, state: Array, desired: Array, n_steps: int) -> Array:
        self._desired.GetMutableData().get_mutable_value().SetFromVector(desired)
        self._clock.advance(state, n_steps)
        return np.array(self._context.get_discrete_state_vector().value())


class _Clock:
    """Advances a context from any state by a number of plant steps."""

    def __init__(self, diagram: Diagram, context: Context, time_step: float) -> None:
        self._diagram, self._context, self._time_step = diagram, context, time_step
        self._initial_state = np.array(context.get_discrete_state_vector().value())
        self._start()

    def advance(self, state: Array, n_steps: int) -> None:
        """Advances a state x (37); raises a RuntimeError if the contact solver fails."""
        self._context.SetDiscreteState(state)
        self._steps += n_steps
        try:
            # Stop between two updates, so that rounding of times neither adds nor skips one.
            self._simulator.AdvanceTo((self._steps - 0.5) * self._time_step, interruptible=False)
        except RuntimeError:
            # Remove the failed state from the simulator.
            self._start()
            raise

    def _start(self) -> None:
        self._steps = 0
        self._context.SetTime(0.0)
        self._context.SetDiscreteState(self._initial_state)
        self._simulator = Simulator(self._diagram, self._context)
        self._simulator.Initialize()

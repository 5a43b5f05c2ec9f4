"""Batch physics: hundreds of stations stepped in C++ threads, without Python in the loop."""

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
"""Robots for which Drake's batch takes longer to copy a context than they take in Python's loop."""


class DrakeEngine(Engine):
    """Steps the states of many stations in parallel; each group has its station."""

    def __init__(
        self, robot: Robot, stations: Sequence[StationConfig], n_threads: int | None
    ) -> None:
        super().__init__(stations)
        self._groups = [_Group(robot, station) for station in stations]
        n_threads = n_threads or Parallelism.Max().num_threads()
        # Drake releases the interpreter's lock, so groups run side by side, each on its share of
        # the threads: with a group after another, threads would wait at the end of each.
        n_workers = min(len(stations), n_threads)
        self._workers = ThreadPoolExecutor(n_workers)
        self._parallelism = Parallelism(n_threads // n_workers) if n_threads > 1 else None
        # The slowest group starts first, or the others would be waiting for it in the end.
        self._order = sorted(range(len(stations)), key=lambda i: stations[i].time_step)

    def set_friction(self, friction: Array) -> None:
        for group, value in zip(self._groups, friction, strict=True):
            group.set_friction(float(value))

    def advance(self, states: Array, held: Held, members: list[IntArray]) -> tuple[Array, None]:
        after = np.full_like(states, np.nan)

        def step(i: int) -> None:
            mine = members[i]
            after[mine] = self._groups[i].step(states[mine], held.of(mine), self._parallelism)

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

        # Drake's batch copies the context at every call, which of many boxes takes longer than
        # hundreds of steps; a simulator keeps it.
        self._clock = _Clock(self._diagram, self._context, station.time_step)
        self._in_batch = station.terrain.is_plane

        # The input, in the order of the actuators.
        port = self._diagram.GetInputPort("desired_state")
        self._desired = port.FixValue(self._context, np.zeros(2 * quadruped.N_JOINTS))
        self._actuator_order = [
            quadruped.JOINTS.index(name) for name in actuated_joints(self._plant)
        ]

    def set_friction(self, friction: float) -> None:
        context = self._scene_graph.GetMyMutableContextFromRoot(self._context)
        set_friction(self._plant, self._scene_graph, friction, context, terrain=self._terrain)

    def step(self, states: Array, held: Held, parallelism: Parallelism | None) -> Array:
        """Advances robots by a control period, in Drake's threads or, for None, in Python's."""
        if len(states) == 0:
            return states
        # From one robot's change of targets to the next's, all targets stay.
        waits, moved = held.waits(self._n_steps), states
        changes = np.unique([0, *waits, self._n_steps]).tolist()
        try:
            for start, stop in pairwise(changes):
                targets = np.where(waits[:, None] > start, held.late, held.targets)
                moved = self._advance(moved, targets, stop - start, parallelism)
            return moved
        except RuntimeError:
            # Drake does not say which robot it cannot advance: halve until one is left.
            if len(states) == 1:
                return np.full_like(states, np.nan)
            half = len(states) // 2
            parts = slice(None, half), slice(half, None)
            return np.concatenate(
                [self.step(states[part], held.of(part), parallelism) for part in parts]
            )

    def _advance(
        self, states: Array, targets: Array, n_steps: int, parallelism: Parallelism | None
    ) -> Array:
        desired = np.zeros((len(states), 2 * quadruped.N_JOINTS))
        desired[:, : quadruped.N_JOINTS] = targets[:, self._actuator_order]
        if not self._in_batch or parallelism is None or len(states) <= FEW_ROBOTS:
            pairs = zip(states, desired, strict=True)
            return np.array([self._advance_one(state, wanted, n_steps) for state, wanted in pairs])
        return BatchEvalUniquePeriodicDiscreteUpdate(
            self._diagram,
            self._context,
            # Flat: newer Drake takes a row of one for a column.
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
    """Advances a context by steps of its plant, from any state and at any time."""

    def __init__(self, diagram: Diagram, context: Context, time_step: float) -> None:
        self._diagram, self._context, self._time_step = diagram, context, time_step
        self._sound = np.array(context.get_discrete_state_vector().value())
        self._start()

    def advance(self, state: Array, n_steps: int) -> None:
        """Advances a state x (37); a RuntimeError says that the contact solver cannot."""
        self._context.SetDiscreteState(state)
        self._steps += n_steps
        try:
            # Between two updates, so that rounding of times neither adds one nor leaves one out.
            self._simulator.AdvanceTo((self._steps - 0.5) * self._time_step, interruptible=False)
        except RuntimeError:
            # The state that failed must not stay in the simulator.
            self._start()
            raise

    def _start(self) -> None:
        self._steps = 0
        self._context.SetTime(0.0)
        self._context.SetDiscreteState(self._sound)
        self._simulator = Simulator(self._diagram, self._context)
        self._simulator.Initialize()

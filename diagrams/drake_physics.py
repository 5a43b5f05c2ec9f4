"""Batch physics with Drake: steps hundreds of stations in threads."""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from pydrake.common import Parallelism
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Diagram, DiagramBuilder

from glassgait.diagrams.engine import Engine, Held, IntArray
from glassgait.diagrams.station import AddStation, StationConfig, actuated_joints, set_friction
from glassgait.models.arrays import Array
from glassgait.models.robots import quadruped
from glassgait.models.robots.robot import Robot


class DrakeEngine(Engine):
    """Steps the states of many robots in parallel; each group has its station."""

    def __init__(
        self, robot: Robot, stations: Sequence[StationConfig], n_threads: int | None
    ) -> None:
        super().__init__(stations)
        n_threads = n_threads or Parallelism.Max().num_threads()
        # Drake releases the interpreter's lock, so loops run concurrently. Groups share threads.
        self._workers = ThreadPoolExecutor(n_threads)
        n_loops = max(1, n_threads // len(stations))
        self._groups = [_Group(robot, station, n_loops) for station in stations]
        # Start the slowest groups first, so that no thread waits for them at the end.
        self._order = sorted(range(len(stations)), key=lambda i: stations[i].time_step)

    def set_friction(self, friction: Array) -> None:
        for group, value in zip(self._groups, friction, strict=True):
            group.set_friction(float(value))

    def advance(self, states: Array, held: Held, members: list[IntArray]) -> tuple[Array, None]:
        after = np.full_like(states, np.nan)

        def step(loop: _Loop, robots: IntArray) -> None:
            after[robots] = loop.step(states[robots], held.of(robots))

        running = []
        for i in self._order:
            loops = self._groups[i].loops
            parts = zip(loops, np.array_split(members[i], len(loops)), strict=True)
            running += [self._workers.submit(step, *part) for part in parts]
        for future in running:
            future.result()
        return after, None


class _Group:
    """Robots that share a station and its friction."""

    def __init__(self, robot: Robot, station: StationConfig, n_loops: int) -> None:
        builder = DiagramBuilder()
        self._plant, self._scene_graph, instance = AddStation(builder, robot, station)
        builder.ExportInput(self._plant.get_desired_state_input_port(instance), "desired_state")
        self._terrain = station.terrain
        diagram, joints = builder.Build(), actuated_joints(self._plant)
        self.loops = [_Loop(diagram, joints, station) for _ in range(n_loops)]

    def set_friction(self, friction: float) -> None:
        for loop in self.loops:
            context = self._scene_graph.GetMyMutableContextFromRoot(loop.context)
            set_friction(self._plant, self._scene_graph, friction, context, terrain=self._terrain)


class _Loop:
    """Advances one robot after another in a context."""

    def __init__(self, diagram: Diagram, joints: list[str], station: StationConfig) -> None:
        self._diagram, self._time_step = diagram, station.time_step
        self._n_steps = station.plant_steps()
        self.context = diagram.CreateDefaultContext()
        self._initial_state = np.array(self.context.get_discrete_state_vector().value())
        # The input is in the order of the actuators.
        self._order = [quadruped.JOINTS.index(joint) for joint in joints]
        port = diagram.GetInputPort("desired_state")
        self._desired = port.FixValue(self.context, np.zeros(2 * quadruped.N_JOINTS))
        self._start()

    def step(self, states: Array, held: Held) -> Array:
        """Advances states x (n, 37) by a control period; returns NaN where Drake fails."""
        after, waits = np.full_like(states, np.nan), held.waits(self._n_steps).tolist()
        for i, (state, targets, late, wait) in enumerate(
            zip(states, held.targets, held.late, waits, strict=True)
        ):
            try:
                moved = self._advance(state, late, wait)
                after[i] = self._advance(moved, targets, self._n_steps - wait)
            except RuntimeError:
                # The contact solver failed. Remove the failed state from the simulator.
                self._start()
        return after

    def _advance(self, state: Array, targets: Array, n_steps: int) -> Array:
        """Returns the state x (37) after a number of plant steps."""
        if n_steps == 0:
            return state
        desired = np.concatenate([targets[self._order], np.zeros(quadruped.N_JOINTS)])
        self._desired.GetMutableData().get_mutable_value().SetFromVector(desired)
        self.context.SetDiscreteState(state)
        self._steps += n_steps
        # Stop between two updates, so that rounding of times neither adds nor skips one.
        self._simulator.AdvanceTo((self._steps - 0.5) * self._time_step, interruptible=False)
        return np.array(self.context.get_discrete_state_vector().value())

    def _start(self) -> None:
        self._steps = 0
        self.context.SetTime(0.0)
        self.context.SetDiscreteState(self._initial_state)
        self._simulator = Simulator(self._diagram, self.context)
        self._simulator.Initialize()

"""Commands: drawn at random, from sliders in Meshcat, or from a planner."""

from functools import lru_cache, partial

import numpy as np
from pydrake.geometry import Meshcat
from pydrake.systems.framework import BasicVector, Context, InputPort, LeafSystem, State

from glassgait.models.errors import InputError, shown
from glassgait.models.task import COMMAND_STEPS, CONTROL_PERIOD
from glassgait.models.task.command import Command, gamepad_velocity, limit_command, sample_commands
from glassgait.models.task.gait import Gait
from glassgait.models.task.randomization import seed_of

# Short, since Meshcat cuts long names.
SPEED_SLIDER = "speed (m/s)"
YAW_RATE_SLIDER = "yaw rate (rad/s)"
DWELL_SLIDER = "dwell (steps)"

OUTPUTS = {"command": 2, "commanded_dwell": 1}


class RandomCommand(LeafSystem):
    """Draws a new command every 10 s.

    .. pydrake_system::

        name: RandomCommand
        input_ports: [seed]
        output_ports: [command, commanded_dwell]

    Inputs: seed (1), any number.
    Outputs: command (2; m/s, rad/s), forward speed and yaw rate, trunk frame. commanded_dwell (1,
    control steps). Each command is a function of the seed and of the 10 s that time is in.
    """

    def __init__(self, gait: Gait, speed_range: tuple[float, float] | None = None) -> None:
        """Draws forward speeds of a range (m/s), by default the gait's."""
        super().__init__()
        # Seeding a generator takes longer than anything else here, and the draw holds for 10 s.
        self._drawn = lru_cache(maxsize=8)(partial(_draw, gait, speed_range))
        self._seed_port = self.DeclareVectorInputPort("seed", 1)
        tickets = {self.time_ticket(), self.all_input_ports_ticket()}
        for index, (name, size) in enumerate(OUTPUTS.items()):
            calc = partial(self._calc, index)
            self.DeclareVectorOutputPort(
                name=name, size=size, calc=calc, prerequisites_of_calc=tickets
            )

    def _calc(self, index: int, context: Context, output: BasicVector) -> None:
        step = round(context.get_time() / CONTROL_PERIOD)
        drawn = self._drawn(seed_of(self._seed_port.Eval(context)), step // COMMAND_STEPS)
        output.SetFromVector(np.ravel(drawn[index]))


def _draw(gait: Gait, speed_range: tuple[float, float] | None, seed: int, interval: int) -> Command:
    generator = np.random.default_rng([seed, interval])
    return sample_commands(gait, 1, generator, speed_range)


class MeshcatCommand(LeafSystem):
    """Reads the command from sliders, or from a gamepad, once every control step.

    .. pydrake_system::

        name: MeshcatCommand
        output_ports: [command, commanded_dwell]

    Outputs: command (2; m/s, rad/s), forward speed and yaw rate, trunk frame. commanded_dwell (1,
    control steps).
    A browser reports a gamepad once one of its buttons was pressed in Meshcat's window. From then
    on its sticks command in place of the sliders of speed and yaw rate, and nothing once its
    browser is gone.
    State: the command and the commanded dwell, latched every 20 ms (unrestricted update).
    """

    def __init__(self, gait: Gait, meshcat: Meshcat) -> None:
        super().__init__()
        self._meshcat, self._gait = meshcat, gait

        # Until the first update, the command is where the sliders begin.
        velocity, dwell = [0.5 * gait.max_speed, 0.0], float(sum(gait.dwell) // 2)
        self._command = self.DeclareDiscreteState(velocity)
        self._dwell = self.DeclareDiscreteState([dwell])
        self.DeclareStateOutputPort("command", self._command)
        self.DeclareStateOutputPort("commanded_dwell", self._dwell)
        self.DeclarePeriodicUnrestrictedUpdateEvent(
            period_sec=CONTROL_PERIOD, offset_sec=0.0, update=self._latch
        )

        # Keys move the sliders too.
        speed, turn = gait.max_speed, gait.max_yaw_rate
        meshcat.AddSlider(SPEED_SLIDER, -speed, speed, 0.05, velocity[0], "KeyS", "KeyW")
        meshcat.AddSlider(YAW_RATE_SLIDER, -turn, turn, 0.05, velocity[1], "KeyD", "KeyA")
        meshcat.AddSlider(DWELL_SLIDER, *gait.dwell, 1, dwell)

    def _latch(self, context: Context, state: State) -> None:
        sliders = (SPEED_SLIDER, YAW_RATE_SLIDER, DWELL_SLIDER)
        *velocity, dwell = (self._meshcat.GetSliderValue(name) for name in sliders)
        gamepad = self._meshcat.GetGamepad()
        if gamepad.index is not None:
            # Meshcat keeps the last report of a browser that is gone.
            is_there = self._meshcat.GetNumActiveConnections() > 0
            velocity = gamepad_velocity(self._gait, gamepad.axes if is_there else ())
        state.get_mutable_discrete_state(self._command).SetFromVector(velocity)
        state.get_mutable_discrete_state(self._dwell).SetFromVector([dwell])


class GivenCommand(LeafSystem):
    """Gives the command of a planner where it is connected, and else the drawn one.

    .. pydrake_system::

        name: GivenCommand
        input_ports: [command, commanded_dwell, drawn_command, drawn_dwell]
        output_ports: [command, commanded_dwell]

    Inputs: command (2; m/s, rad/s), forward speed and yaw rate, trunk frame; commanded_dwell (1,
    control steps); each may stay unconnected. drawn_command (2), drawn_dwell (1), which pass
    unchanged in their place.
    Outputs: command (2), commanded_dwell (1), the nearest to what is given that the gait is made
    for. They depend on the inputs of the same kind only: a planner may choose the speed by the
    machine's state, which depends on the dwell.
    An input that is connected and not finite raises an InputError.
    """

    def __init__(self, gait: Gait) -> None:
        super().__init__()
        self._gait = gait
        given = [self.DeclareVectorInputPort(name, size) for name, size in OUTPUTS.items()]
        drawn = [
            self.DeclareVectorInputPort("drawn_command", 2),
            self.DeclareVectorInputPort("drawn_dwell", 1),
        ]
        for index, (name, size) in enumerate(OUTPUTS.items()):
            self.DeclareVectorOutputPort(
                name=name,
                size=size,
                calc=partial(self._calc, index, given[index], drawn[index]),
                prerequisites_of_calc={given[index].ticket(), drawn[index].ticket()},
            )

    def _calc(
        self, index: int, given: InputPort, drawn: InputPort, context: Context, output: BasicVector
    ) -> None:
        if not given.HasValue(context):
            output.SetFromVector(drawn.Eval(context))
            return
        value = np.asarray(given.Eval(context), dtype=float)
        if not np.isfinite(value).all():
            raise InputError(
                f"input port {given.get_name()!r}: is given {shown(value.tolist())}; give finite "
                "numbers"
            )
        # The other part of the command does not matter.
        command = [np.zeros(2), np.array(float(self._gait.dwell[0]))]
        command[index] = value
        output.SetFromVector(limit_command(self._gait, Command(*command))[index])

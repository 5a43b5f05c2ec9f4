"""Commands: drawn at random, from sliders in Meshcat, or from a planner."""

from functools import lru_cache, partial

import numpy as np
from pydrake.geometry import Meshcat
from pydrake.systems.framework import BasicVector, Context, InputPort, LeafSystem, State

from glassgait.models.errors import InputError, shown
from glassgait.models.task import COMMAND_STEPS, CONTROL_PERIOD
from glassgait.models.task.command import Command, limit_command, sample_commands
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
    control steps). Each command is a function of the seed and of the current 10 s interval.
    """

    def __init__(self, gait: Gait, speed_range: tuple[float, float] | None = None) -> None:
        """Sets the range of forward speeds (m/s), by default the gait's."""
        super().__init__()
        # Cached, since seeding a generator is slow and a command holds for 10 s.
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
    """Reads the command from sliders at every control step.

    .. pydrake_system::

        name: MeshcatCommand
        output_ports: [command, commanded_dwell]

    Outputs: command (2; m/s, rad/s), forward speed and yaw rate, trunk frame. commanded_dwell (1,
    control steps).
    State: the command and the commanded dwell, latched every 20 ms (unrestricted update).
    """

    def __init__(self, gait: Gait, meshcat: Meshcat) -> None:
        super().__init__()
        self._meshcat = meshcat

        # Before the first update, the command equals the sliders' initial values.
        velocity, dwell = [0.5 * gait.max_speed, 0.0], float(sum(gait.dwell) // 2)
        self._command = self.DeclareDiscreteState(velocity)
        self._dwell = self.DeclareDiscreteState([dwell])
        self.DeclareStateOutputPort("command", self._command)
        self.DeclareStateOutputPort("commanded_dwell", self._dwell)
        self.DeclarePeriodicUnrestrictedUpdateEvent(
            period_sec=CONTROL_PERIOD, offset_sec=0.0, update=self._latch
        )

        speed, turn = gait.max_speed, gait.max_yaw_rate
        meshcat.AddSlider(SPEED_SLIDER, -speed, speed, 0.05, velocity[0], "KeyS", "KeyW")
        meshcat.AddSlider(YAW_RATE_SLIDER, -turn, turn, 0.05, velocity[1], "KeyD", "KeyA")
        meshcat.AddSlider(DWELL_SLIDER, *gait.dwell, 1, dwell)

    def _latch(self, context: Context, state: State) -> None:
        sliders = (SPEED_SLIDER, YAW_RATE_SLIDER, DWELL_SLIDER)
        *velocity, dwell = (self._meshcat.GetSliderValue(name) for name in sliders)
        state.get_mutable_discrete_state(self._command).SetFromVector(velocity)
        state.get_mutable_discrete_state(self._dwell).SetFromVector([dwell])


class GivenCommand(LeafSystem):
    """Outputs a planner's command if one is connected, and the drawn command otherwise.

    .. pydrake_system::

        name: GivenCommand
        input_ports: [command, commanded_dwell, drawn_command, drawn_dwell]
        output_ports: [command, commanded_dwell]

    Inputs: command (2; m/s, rad/s), forward speed and yaw rate, trunk frame; commanded_dwell (1,
    control steps); each may stay unconnected. drawn_command (2) and drawn_dwell (1) pass unchanged
    if the input is unconnected.
    Outputs: command (2), commanded_dwell (1), the planner's values limited to the gait's ranges.
    The command depends on command inputs only, and the dwell on dwell inputs, so that a planner can
    choose the speed from the reward machine's state, which depends on the dwell.
    A connected input that is not finite raises an InputError.
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
                f"input port {given.get_name()!r}: is given {shown(value.tolist())}; give numbers"
            )
        # `limit_command` limits velocity and dwell separately; the other value is a placeholder.
        command = [np.zeros(2), np.array(float(self._gait.dwell[0]))]
        command[index] = value
        output.SetFromVector(limit_command(self._gait, Command(*command))[index])

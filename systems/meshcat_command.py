"""Commands from sliders in Meshcat, or from a gamepad there."""

from pydrake.geometry import Meshcat
from pydrake.systems.framework import BasicVector, Context, LeafSystem, OutputPort, State

from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.command import gamepad_velocity
from glassgait.models.task.gait import Gait

# Short, since Meshcat cuts long names.
SPEED_SLIDER = "speed (m/s)"
YAW_RATE_SLIDER = "yaw rate (rad/s)"
DWELL_SLIDER = "dwell (steps)"


class MeshcatCommand(LeafSystem):
    """Reads the command from sliders, or from a gamepad, once every control step.

    .. pydrake_system::

        name: MeshcatCommand
        output_ports:
        - command
        - commanded_dwell

    Outputs: command (2; m/s, rad/s), forward speed and yaw rate, trunk frame.
    commanded_dwell (1, control steps).
    A browser reports a gamepad once one of its buttons was pressed in Meshcat's window. From then
    on its sticks command in place of the sliders of speed and yaw rate: the left one forward, the
    right one to turn, and nothing in the middle, nor once its browser is gone.
    State: what is commanded (3), latched every 20 ms (unrestricted update). Feedthrough: none.
    """

    def __init__(self, gait: Gait, meshcat: Meshcat) -> None:
        """
        Args:
            gait: The gait, whose ranges the sliders have.
            meshcat: Where they show.
        """
        super().__init__()
        self._meshcat, self._gait = meshcat, gait
        start = [0.5 * gait.max_speed, 0.0, float(sum(gait.dwell) // 2)]
        self._values = self.DeclareDiscreteState(start)
        speed, turn = gait.max_speed, gait.max_yaw_rate
        meshcat.AddSlider(SPEED_SLIDER, -speed, speed, 0.05, start[0], "KeyS", "KeyW")
        meshcat.AddSlider(YAW_RATE_SLIDER, -turn, turn, 0.05, start[1], "KeyD", "KeyA")
        meshcat.AddSlider(DWELL_SLIDER, *gait.dwell, 1, start[2])
        self._command_port = self.DeclareVectorOutputPort(
            name="command",
            size=2,
            calc=lambda context, output: output.SetFromVector(self._stored(context)[:2]),
            prerequisites_of_calc={self.xd_ticket()},
        )
        self._commanded_dwell_port = self.DeclareVectorOutputPort(
            name="commanded_dwell",
            size=1,
            calc=self._calc_commanded_dwell,
            prerequisites_of_calc={self.xd_ticket()},
        )
        self.DeclarePeriodicUnrestrictedUpdateEvent(
            period_sec=CONTROL_PERIOD, offset_sec=0.0, update=self._latch
        )

    def get_command_output_port(self) -> OutputPort:
        """Gives forward speed and yaw rate."""
        return self._command_port

    def get_commanded_dwell_output_port(self) -> OutputPort:
        """Gives the commanded iterations in a state."""
        return self._commanded_dwell_port

    def _stored(self, context: Context):
        return context.get_discrete_state(self._values).value()

    def _calc_commanded_dwell(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._stored(context)[2:])

    def _latch(self, context: Context, state: State) -> None:
        sliders = (SPEED_SLIDER, YAW_RATE_SLIDER, DWELL_SLIDER)
        values = [self._meshcat.GetSliderValue(name) for name in sliders]
        gamepad = self._meshcat.GetGamepad()
        if gamepad.index is not None:
            # Meshcat keeps the last report of a browser that is gone.
            is_there = self._meshcat.GetNumActiveConnections() > 0
            axes = gamepad.axes if is_there else ()
            values[:2] = gamepad_velocity(self._gait, axes).tolist()
        state.get_mutable_discrete_state(self._values).SetFromVector(values)

"""Requests of gaits from buttons in Meshcat."""

from collections.abc import Sequence

from pydrake.geometry import Meshcat
from pydrake.systems.framework import Context, LeafSystem, OutputPort, State

from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.gait import Gait

MOST_KEYS = 9
"""Gaits that have a key beside their button, from 1 on."""


class MeshcatGaitRequest(LeafSystem):
    """Requests the gait whose button was clicked last, looked at once every control step.

    .. pydrake_system::

        name: MeshcatGaitRequest
        output_ports:
        - requested_gait

    Outputs: requested_gait (1), the number of the gait; 0 until a button is clicked.
    State: that number, latched every 20 ms (unrestricted update), which takes the clicks back: a
    context that begins anew begins with the first gait. Feedthrough: none.
    """

    def __init__(self, gaits: Sequence[Gait], meshcat: Meshcat) -> None:
        """
        Args:
            gaits: The gaits; the keys 1, 2, … do as their buttons do.
            meshcat: Where the buttons show.
        """
        super().__init__()
        self._meshcat = meshcat
        self._buttons = [
            (gait_button(gait), f"Digit{i + 1}" if i < MOST_KEYS else "")
            for i, gait in enumerate(gaits)
        ]
        for button in self._buttons:
            meshcat.AddButton(*button)
        self._requested = self.DeclareDiscreteState(1)
        self._requested_gait_port = self.DeclareStateOutputPort("requested_gait", self._requested)
        self.DeclarePeriodicUnrestrictedUpdateEvent(
            period_sec=CONTROL_PERIOD, offset_sec=0.0, update=self._latch
        )

    def get_requested_gait_output_port(self) -> OutputPort:
        """Gives the number of the gait that is to run."""
        return self._requested_gait_port

    def _latch(self, context: Context, state: State) -> None:
        for number, button in enumerate(self._buttons):
            if self._meshcat.GetButtonClicks(button[0]) > 0:
                # Adding a button that is there sets its clicks to zero.
                self._meshcat.AddButton(*button)
                state.get_mutable_discrete_state(self._requested).SetFromVector([float(number)])


def gait_button(gait: Gait) -> str:
    """Returns what the button of a gait is called."""
    return gait.name.replace("_", "-")

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
    State: that number, latched every 20 ms (unrestricted update), which uses the clicks up: a
    context that begins anew begins with the first gait. Feedthrough: none.

    The button of the requested gait carries a star. Meshcat cannot rename a button, and shows one
    that is added again below all others, so that all of them are replaced at once: they stay where
    they are as long as no other control is added after this system.
    """

    def __init__(self, gaits: Sequence[Gait], meshcat: Meshcat) -> None:
        """
        Args:
            gaits: The gaits; the keys 1, 2, … do as their buttons do.
            meshcat: Where the buttons show.
        """
        super().__init__()
        self._meshcat = meshcat
        self._gaits = tuple(gaits)
        self._active = 0
        self._add_buttons()
        self._requested = self.DeclareDiscreteState(1)
        self._requested_gait_port = self.DeclareStateOutputPort("requested_gait", self._requested)
        self.DeclarePeriodicUnrestrictedUpdateEvent(
            period_sec=CONTROL_PERIOD, offset_sec=0.0, update=self._latch
        )

    def get_requested_gait_output_port(self) -> OutputPort:
        """Gives the number of the gait that is to run."""
        return self._requested_gait_port

    def _latch(self, context: Context, state: State) -> None:
        requested = state.get_mutable_discrete_state(self._requested)
        clicks = [self._meshcat.GetButtonClicks(label) for label in self._labels()]
        pressed = [i for i, count in enumerate(clicks) if count > self._clicks[i]]
        # Which of two was pressed last is not known; the gait that is requested already gives way.
        pressed.sort(key=lambda number: number != self._active)
        if pressed:
            requested.SetFromVector([float(pressed[-1])])
        self._clicks = clicks
        active = int(requested.GetAtIndex(0))
        if active != self._active:
            for label in self._labels():
                self._meshcat.DeleteButton(label)
            self._active = active
            self._add_buttons()

    def _labels(self) -> list[str]:
        return [gait_button(gait, i == self._active) for i, gait in enumerate(self._gaits)]

    def _add_buttons(self) -> None:
        for i, label in enumerate(self._labels()):
            self._meshcat.AddButton(label, f"Digit{i + 1}" if i < MOST_KEYS else "")
        self._clicks = [0] * len(self._gaits)


def gait_button(gait: Gait, active: bool = False) -> str:
    """Returns what the button of a gait is called, with a star where that gait is requested."""
    return gait.name.replace("_", "-") + (" *" if active else "")

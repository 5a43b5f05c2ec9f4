"""Requests of a gait, or of a mode of a day, from buttons in Meshcat and from a gamepad."""

from collections.abc import Callable, Sequence

from pydrake.geometry import Meshcat
from pydrake.systems.framework import Context, InputPort, LeafSystem, OutputPort, State

from glassgait.models.link.remote import Button, Remote
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.request import RequestGate
from glassgait.systems.meshcat_gamepad import MeshcatGamepad

ByGamepad = Callable[[Remote, Remote, int], int]
"""Returns the number that is requested, of what the gamepad's operator does now and did a control
step before, and of what was requested."""


class MeshcatRequest(LeafSystem):
    """Requests what was clicked last, or pressed on a gamepad, looked at once every control step.

    .. pydrake_system::

        name: MeshcatRequest
        input_ports:
        - mode
        output_ports:
        - requested

    Inputs: mode (1), only with a gate: the number of the mode of the robot's day, or
    `NO_MODE`. The gate drops what that mode cannot take.
    Outputs: requested (1), the number of what is requested, until a button is clicked the first.
    State: that number, and the gamepad's buttons at the step before, latched every 20 ms
    (unrestricted update), which uses the clicks up: a context that begins anew begins with the
    first. Feedthrough: none.

    The button of what is requested carries a star. Meshcat cannot rename a button, and shows one
    that is added again below all others, so that all of them are replaced at once: they stay where
    they are as long as no other control is added after this system.
    """

    def __init__(
        self,
        names: Sequence[str],
        meshcat: Meshcat,
        *,
        keys: Sequence[str],
        by_gamepad: ByGamepad,
        gate: RequestGate | None = None,
        first: int = 0,
    ) -> None:
        """
        Args:
            names: What can be requested, by number.
            meshcat: Where the buttons show.
            keys: JavaScript's codes of keys that do as the buttons do; those beyond have none.
            by_gamepad: What a gamepad requests.
            gate: What takes requests of a day's modes, or drops them; all are taken by default.
            first: Number of what is requested until a button is clicked.
        """
        super().__init__()
        self._meshcat, self._names, self._by_gamepad = meshcat, tuple(names), by_gamepad
        self._gamepad = MeshcatGamepad(meshcat)
        self._keys = (*keys, *len(names) * ("",))[: len(names)]
        self._active = first
        self._add_buttons()
        self._gate = gate
        self._mode_port = None if gate is None else self.DeclareVectorInputPort("mode", 1)
        self._requested = self.DeclareDiscreteState([float(first)])
        self._pressed = self.DeclareDiscreteState(1)
        self._requested_port = self.DeclareStateOutputPort("requested", self._requested)
        self.DeclarePeriodicUnrestrictedUpdateEvent(
            period_sec=CONTROL_PERIOD, offset_sec=0.0, update=self._latch
        )

    def get_mode_input_port(self) -> InputPort:
        """Takes the number of the mode of the robot's day, where there is a gate."""
        assert self._mode_port is not None
        return self._mode_port

    def get_requested_output_port(self) -> OutputPort:
        """Gives the number of what is requested."""
        return self._requested_port

    def _latch(self, context: Context, state: State) -> None:
        requested = state.get_mutable_discrete_state(self._requested)
        before = int(context.get_discrete_state(self._requested).GetAtIndex(0))
        asked = self._held(context, state, self._clicked(before))
        active = self._settled(context, before, asked)
        requested.SetFromVector([float(active)])
        if active != self._active:
            for label in self._labels():
                self._meshcat.DeleteButton(label)
            self._active = active
            self._add_buttons()

    def _settled(self, context: Context, before: int, asked: int) -> int:
        """Returns what is requested, of what is asked for."""
        if self._gate is None or self._mode_port is None:
            return asked
        mode = round(self._mode_port.Eval(context)[0])
        return self._gate.settled(mode, before, asked)

    def _clicked(self, before: int) -> int:
        """Returns what is requested by the buttons in Meshcat."""
        clicks = [self._meshcat.GetButtonClicks(label) for label in self._labels()]
        pressed = [i for i, count in enumerate(clicks) if count > self._clicks[i]]
        # Which of two was pressed last is not known; what is requested already gives way.
        pressed.sort(key=lambda number: number != self._active)
        self._clicks = clicks
        return pressed[-1] if pressed else before

    def _held(self, context: Context, state: State, requested: int) -> int:
        """Returns what is requested by the gamepad, if it requests anything."""
        now = self._gamepad.held() or Remote.untouched()
        pressed = int(context.get_discrete_state(self._pressed).GetAtIndex(0))
        before = Remote.untouched()._replace(buttons=Button(pressed))
        state.get_mutable_discrete_state(self._pressed).SetFromVector([float(now.buttons)])
        return self._by_gamepad(now, before, requested)

    def _labels(self) -> list[str]:
        return [request_button(name, i == self._active) for i, name in enumerate(self._names)]

    def _add_buttons(self) -> None:
        for label, key in zip(self._labels(), self._keys, strict=True):
            self._meshcat.AddButton(label, key)
        self._clicks = [0] * len(self._names)


def request_button(name: str, active: bool = False) -> str:
    """Returns what a button is called, with a star where that is what is requested."""
    return name.replace("_", "-") + (" *" if active else "")

"""The gamepad of a browser that shows Meshcat, as long as that browser is there."""

from pydrake.geometry import Meshcat

from glassgait.models.link.gamepad import read_gamepad
from glassgait.models.link.remote import Remote


class MeshcatGamepad:
    """Reads the gamepad; Meshcat itself keeps the last report of a browser that is gone."""

    def __init__(self, meshcat: Meshcat) -> None:
        """
        Args:
            meshcat: What browsers report a gamepad to.
        """
        self._meshcat, self._n_browsers = meshcat, 0
        self._left: tuple[object, ...] | None = None

    def held(self) -> Remote | None:
        """Returns what is done with the gamepad; None where no browser has reported one.

        A gamepad is untouched while no browser is connected. When one of several leaves it may
        have been the gamepad's, which is untouched from then on until it reports something else.
        """
        gamepad, n_browsers = self._meshcat.GetGamepad(), self._meshcat.GetNumActiveConnections()
        report = (gamepad.index, *gamepad.axes, *gamepad.button_values)
        if n_browsers < self._n_browsers:
            self._left = report
        self._n_browsers = n_browsers
        if gamepad.index is None:
            return None
        if n_browsers == 0 or report == self._left:
            return Remote.untouched()
        self._left = None
        return read_gamepad(gamepad.axes, gamepad.button_values)

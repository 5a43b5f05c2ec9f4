"""Messages on a channel that no process of this version sent."""

from glassgait.studies.common.console import say


class ForeignMessages:
    """Says once that some came: they are passed over, and the process goes on."""

    def __init__(self) -> None:
        self._said = False

    def say(self, count: int) -> None:
        """Says so, once the count of them is above 0."""
        if count > 0 and not self._said:
            self._said = True
            say(
                "a message came that is of another kind, or of another version: it was passed "
                "over; run both processes of one version, or name other --channels"
            )

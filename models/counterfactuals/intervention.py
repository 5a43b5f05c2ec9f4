"""What is put in for an observation, for some control steps."""

from dataclasses import dataclass

from glassgait.models.arrays import Array


@dataclass(frozen=True)
class Intervention:
    """A change of the observation that a policy is given, while the robot is as it is.

    Attributes:
        offset: What is added to the observation (n).
        first: The control step at which it begins.
        count: For how many control steps it lasts.
    """

    offset: Array
    first: int
    count: int = 1

    def applied(self, step: int, observation: Array) -> Array:
        """Returns what the policy is given (..., n) at a control step, of an observation."""
        lasts = self.first <= step < self.first + self.count
        return observation + self.offset if lasts else observation

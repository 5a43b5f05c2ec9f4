"""A policy of formulas whose numbers change while it acts."""

from collections.abc import Sequence

import numpy as np

from glassgait.models.arrays import Array
from glassgait.models.errors import InputError
from glassgait.models.formulas.numbers import FileNumbers
from glassgait.models.formulas.quantities import RobotUnits, actions_of
from glassgait.models.policies.policy import Policy
from glassgait.models.policies.symbolic import FormulaPolicy


class AdjustablePolicy(Policy):
    """Acts by the formulas of a file, with numbers that are exchanged while it acts.

    It alone of all policies is not immutable: what advances a simulator calls `adjust` between
    two control steps, and all contexts of a diagram that holds it then act by the new numbers. The
    formulas are compiled once, so that a change takes no time, and to the last bit it acts as
    `to_policy` does. It has no file of its own.

    Attributes:
        numbered: The file, and where its numbers stand.
    """

    kind = "adjustable"

    def __init__(self, policy: FormulaPolicy) -> None:
        """
        Args:
            policy: The policy to begin with.
        """
        super().__init__(policy.gait, policy.observation_names, robot=policy.robot)
        self.joint_law, self.machine = policy.joint_law, policy.machine
        self.observes_by, self._estimator = policy.observes_by, policy.estimator
        self.numbered = FileNumbers(policy.to_file())
        file = self.numbered.open
        rows: dict[int, list] = {}
        for place, formula in file.formulas.items():
            rows.setdefault(place[0] if len(place) > 1 else 0, []).append(formula)
        self._tapes = [self.numbered.tape(formulas) for formulas in rows.values()]
        self._units = RobotUnits.of(policy.robot, policy.observation_names)
        readings = policy.readings
        self._ends = None if readings is None else readings.ends(policy.observation_names)
        self._numbers = np.array(self.numbered.start)
        self._written: FormulaPolicy | None = None

    def __call__(self, observation: Array) -> Array:
        actions = self._act(observation)
        if np.isfinite(actions).all():
            return actions
        # The file leaves out what is multiplied by 0; here 0 times what is infinite is no number.
        if self._written is None:
            self._written = self.to_policy()
        return self._written(observation)

    def _act(self, observation: Array) -> Array:
        read = self.read(observation)
        if len(self._tapes) == 1:
            return actions_of(self.robot, self._tapes[0](read))
        states = self.machine_state(observation)
        if observation.ndim == 1:
            return actions_of(self.robot, self._tapes[int(states)](read))
        targets = np.stack([tape(read) for tape in self._tapes])
        return actions_of(self.robot, np.take_along_axis(targets, states[None, ..., None], 0)[0])

    def read(self, observation: Array) -> Array:
        """Returns what formulas read (..., n), and the numbers behind it (..., n + p)."""
        quantities = self._units.quantities(observation)
        if self._ends is not None:
            quantities = np.clip(quantities, *self._ends)
        # One look at the numbers: a change comes before or after, never in between.
        numbers = self._numbers
        shape = (*observation.shape[:-1], len(numbers))
        return np.concatenate([quantities, np.broadcast_to(numbers, shape)], axis=-1)

    @property
    def numbers(self) -> tuple[float, ...]:
        """The numbers by which it acts (p)."""
        return tuple(self._numbers.tolist())

    def adjust(self, numbers: Sequence[float]) -> None:
        """Acts by other numbers (p) from now on.

        Raises:
            InputError: if there are more or fewer, or one is not finite.
        """
        given = np.array(numbers, dtype=float)
        if given.shape != self._numbers.shape or not np.isfinite(given).all():
            raise InputError(
                f"adjustable policy: needs {len(self._numbers)} finite numbers, as many as its "
                "file holds"
            )
        self._numbers, self._written = given, None

    def to_policy(self, numbers: Sequence[float] | None = None) -> FormulaPolicy:
        """Returns the policy that acts by given numbers (p), by those of now by default."""
        given = self.numbers if numbers is None else numbers
        own = FormulaPolicy.from_file(self.numbered.replaced(given), self.robot)
        own.observes_by, own._estimator = self.observes_by, self._estimator
        return own

    def digest(self) -> str:
        return self.to_policy().digest()

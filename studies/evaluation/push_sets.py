"""Sets of pushes that a policy survives, as far as a set of so simple a shape can say.

A set ranks pushes by a margin, the greater the safer. `calibrated` then says from which margin on
enough are survived.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_discrete_lyapunov
from scipy.stats import binom
from sklearn.linear_model import LogisticRegression
from sklearn.metrics import roc_auc_score

from glassgait.models.arrays import Array
from glassgait.studies.common.scores import wilson_interval

SHARE, CONFIDENCE = 0.95, 0.95
"""Share of a set's pushes that must be survived, and how sure that must be."""

SMALLEST, N_THRESHOLDS = 100, 41
"""About how many pushes the smallest set holds that is tested, and how many sets are. Of fewer than
59 pushes nothing can be shown, though all be survived."""

PUSHED = 0.02
"""Speed of the pushes by which the way to the stride's end is differentiated (m/s)."""


@dataclass(frozen=True)
class PushOutcomes:
    """Pushes, and what became of the robots.

    Attributes:
        velocity: What they add to the trunk's velocity, forward and left (n, 2; m/s).
        phase: Where in the stride they come, from 0 to 1 (n,).
        survived: Whether robots survived (n,).
    """

    velocity: Array
    phase: Array
    survived: NDArray[np.bool_]


class PushSet(ABC):
    """A set of pushes for each phase of the stride.

    Attributes:
        title: What tables call it.
    """

    title: ClassVar[str]

    @abstractmethod
    def margin(self, velocity: Array, phase: Array) -> Array:
        """Returns the margins (n,) of pushes (n, 2; m/s, forward and left) in phases (n,)."""


@dataclass(frozen=True)
class Circle(PushSet):
    """Pushes up to some speed, from whichever side and in whichever phase."""

    title: ClassVar[str] = "circle"

    def margin(self, velocity: Array, phase: Array) -> Array:
        return -np.linalg.norm(velocity, axis=-1)


@dataclass(frozen=True)
class OrbitEllipses(PushSet):
    """An ellipse for each control step of the stride, from the stride map alone.

    Near a fixed point x of a stride map with the Jacobian A, V(d) = d' P d falls from stride to
    stride by d' d, where A' P A - P = -1: its level sets are basins of the linear map. A small push
    v at step k has become B v at the stride's end, and V is v' (B' P B) v then.

    Attributes:
        forms: B' P B by control step (k, 2, 2).
    """

    title: ClassVar[str] = "ellipses of the stride map"

    forms: Array

    @classmethod
    def of(cls, jacobian: Array, ends: Array) -> Self:
        """Builds them.

        Args:
            jacobian: A (d, d), of a fixed point that attracts.
            ends: B by control step (k, d, 2; units per m/s).
        """
        value = solve_discrete_lyapunov(jacobian.T, np.eye(len(jacobian)))
        return cls(np.einsum("kdi,de,kej->kij", ends, value, ends))

    def margin(self, velocity: Array, phase: Array) -> Array:
        steps = np.rint(phase * len(self.forms)).astype(int) % len(self.forms)
        return -np.einsum("ni,nij,nj->n", velocity, self.forms[steps], velocity)


@dataclass(frozen=True)
class FittedConics(PushSet):
    """A conic for each phase, fitted to pushes that were survived and others.

    The log odds of survival are quadratic in the push, with coefficients that go twice around with
    the phase at most.

    Attributes:
        weights: Of each of `TERMS` by each of `WAVES` (6, 5).
    """

    title: ClassVar[str] = "fitted conics"

    TERMS: ClassVar[tuple[str, ...]] = ("1", "x", "y", "x*x", "x*y", "y*y")
    WAVES: ClassVar[tuple[str, ...]] = (
        "1",
        "cos(2 pi phase)",
        "sin(2 pi phase)",
        "cos(4 pi phase)",
        "sin(4 pi phase)",
    )

    weights: Array

    @classmethod
    def fit(cls, pushes: PushOutcomes) -> Self:
        """Fits the log odds; all that are survived, or none, say nothing of the push."""
        shape = len(cls.TERMS), len(cls.WAVES)
        if pushes.survived.all() or not pushes.survived.any():
            weights = np.zeros(shape)
            weights[0, 0] = 1.0 if pushes.survived.any() else -1.0
            return cls(weights)
        model = LogisticRegression(C=1.0, fit_intercept=False, max_iter=10_000)
        model.fit(_features(pushes.velocity, pushes.phase), pushes.survived)
        return cls(model.coef_.reshape(shape))

    def margin(self, velocity: Array, phase: Array) -> Array:
        return _features(velocity, phase) @ self.weights.ravel()


def _features(velocity: Array, phase: Array) -> Array:
    """Returns the products of terms and waves (n, 30)."""
    (x, y), angle = velocity.T, 2.0 * np.pi * phase
    terms = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=1)
    waves = [np.ones_like(x), *(f(k * angle) for k in (1, 2) for f in (np.cos, np.sin))]
    products = terms[:, :, None] * np.stack(waves, axis=1)[:, None, :]
    return products.reshape(len(x), len(FittedConics.TERMS) * len(FittedConics.WAVES))


def calibrated(own: PushSet, tried: PushOutcomes, pushes: PushOutcomes) -> float:
    """Returns the margin from which on enough pushes are survived.

    Thresholds that are known beforehand are tested one after the other, from small sets to large
    ones, until one cannot be shown to hold enough («fixed sequence testing», Angelopoulos et al.,
    «Learn then test», 2021). If pushes are independent, `SHARE` of those in the set that is
    returned are survived where they are drawn in the same way, unless the calibration was unlucky,
    at a chance of 1 - `CONFIDENCE` for each set. Pushes of one robot are not quite independent.

    Args:
        own: The set.
        tried: Pushes whose margins are the thresholds.
        pushes: Other pushes, by which they are tested.

    Returns:
        The threshold; infinity where not even the smallest set holds.
    """
    if not len(tried.survived) or not len(pushes.survived):
        return float("inf")
    smallest = min(SMALLEST / len(pushes.survived), 1.0)
    sizes = np.linspace(smallest, 1.0, N_THRESHOLDS)
    thresholds = np.quantile(own.margin(tried.velocity, tried.phase), 1.0 - sizes)
    margins, found = own.margin(pushes.velocity, pushes.phase), float("inf")
    for threshold in thresholds:
        inside = pushes.survived[margins >= threshold]
        # How probable so many survivors are where fewer than the share survive.
        if binom.sf(inside.sum() - 1, len(inside), SHARE) > 1.0 - CONFIDENCE:
            break
        found = float(threshold)
    return found


@dataclass(frozen=True)
class Prediction:
    """A set of pushes, and what became of pushes that it had not seen.

    Attributes:
        own: The set.
        threshold: Margin from which on survival is predicted.
        test: The pushes.
    """

    own: PushSet
    threshold: float
    test: PushOutcomes

    @property
    def margins(self) -> Array:
        """Margins of the pushes over the threshold (n,)."""
        return self.own.margin(self.test.velocity, self.test.phase) - self.threshold

    def row(self) -> dict[str, Any]:
        """Returns what the table says of it."""
        inside, survived = self.margins >= 0.0, self.test.survived
        n, kept = int(inside.sum()), int((inside & survived).sum())
        low, high = wilson_interval(kept, n) if n else (float("nan"), float("nan"))
        margins = self.own.margin(self.test.velocity, self.test.phase)
        known = 0 < survived.sum() < len(survived)
        return {
            "set": self.own.title,
            "pushes": len(survived),
            "predicted": n,
            "of these survived": kept / n if n else float("nan"),
            "95 % from": low,
            "95 % to": high,
            "survived": int(survived.sum()),
            "of these predicted": kept / survived.sum() if survived.any() else float("nan"),
            "AUC": roc_auc_score(survived, margins) if known else float("nan"),
        }

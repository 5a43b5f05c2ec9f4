"""Checks a certificate without the program that proved it.

Nothing of the prover is used here, and nothing of how policies act: the policy's file is read and
multiplied out anew, bounds are computed in balls of real numbers (Arb, by python-flint) that hold
all rounding, and every claim is decided again from bounds and witnesses that hold.

What is trusted: these files, Python, NumPy's reading of numbers, and Arb.
"""

try:
    import flint as _  # noqa: F401
except ImportError as missing:
    raise ImportError(
        "checking needs python-flint; install it with pip install 'glassgait[certify]'"
    ) from missing

from .certificate import check
from .robot import RefusedError

__all__ = ["RefusedError", "check"]

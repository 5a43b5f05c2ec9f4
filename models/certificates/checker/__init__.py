"""Checks a certificate without the program that proved it.

It uses nothing of the prover, and nothing by which policies act. Files are read anew, and every
claim is decided again from bounds in balls of real numbers (Arb, by python-flint).

Trusted are these files, Python, NumPy, PyYAML and Arb, that robots compute in double precision with
functions that are right to 4 units of the last place, and that robots stay in the boxes.
"""

try:
    import flint as _  # noqa: F401
except ImportError as missing:
    raise ImportError(
        "checking needs python-flint; install it with pip install 'glassgait[certify]'"
    ) from missing

from .certificate import check
from .files import RefusedError

__all__ = ["RefusedError", "check"]

"""Checks certificates with code that neither the prover nor the policies use."""

from .certificate import Decision, check
from .files import RefusedError

__all__ = ["Decision", "RefusedError", "check"]

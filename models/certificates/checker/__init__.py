"""Checks a certificate without the program that proved it, or anything by which policies act."""

from .certificate import Decision, check
from .files import RefusedError

__all__ = ["Decision", "RefusedError", "check"]

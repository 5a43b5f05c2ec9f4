"""The alternation of expert and student within an episode (paper, Algorithm 1)."""

from fractions import Fraction

from glassgait.models.errors import InputError


def expert_acts(step: int, period: int) -> bool:
    """Returns whether the expert acts at a control step, counted from the episode's start.

    With a period of n it acts every n steps (alternation ratio 1/n), with a period of 0 never.
    """
    return period > 0 and step % period == 0


def ratio_title(period: int) -> str:
    """Writes a period as the paper's alternation ratio."""
    return {0: "0", 1: "1"}.get(period, f"1/{period}")


def parse_ratio(text: str) -> int:
    """Turns an alternation ratio such as 1, 1/4 or 0 into the expert's period."""
    try:
        ratio = Fraction(text)
    except (ValueError, ZeroDivisionError):
        ratio = Fraction(-1)
    if ratio == 0:
        return 0
    if ratio.numerator != 1:
        raise InputError(f"ratio {text!r} is not an alternation ratio; give 1, 0, or 1/2, 1/3, …")
    return ratio.denominator

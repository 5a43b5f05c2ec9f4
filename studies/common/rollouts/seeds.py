"""Seeds of rollouts: those that choose among candidates, and those that are reported.

Robots that a candidate was chosen for tell more good of it than others would: of few robots the
choice takes luck for skill. So what chooses by rollouts has seeds of its own, and none of them is
reported.
"""

from collections.abc import Iterable

from glassgait.models.errors import InputError

REPORTED_SEEDS = range(1000, 1005)
"""Seeds of the rollouts that tables report, unless others are named."""

SELECTION_SEEDS = range(500, 510)
"""Seeds of the rollouts that choose among candidates."""


def refuse_to_report(seeds: Iterable[int]) -> None:
    """Refuses to report rollouts of seeds that choose.

    Raises:
        InputError: if one of the seeds is kept for selection.
    """
    _refuse(seeds, SELECTION_SEEDS, "rollouts: seed", "choose among candidates")


def refuse_to_select(seeds: Iterable[int], setting: str) -> None:
    """Refuses to choose by rollouts of seeds that are reported.

    Args:
        seeds: The seeds that are to choose.
        setting: The setting that names them, as a sentence begins with it.

    Raises:
        InputError: if one of the seeds is reported.
    """
    _refuse(seeds, REPORTED_SEEDS, setting, "are reported")


def _refuse(seeds: Iterable[int], kept: range, setting: str, what: str) -> None:
    for seed in seeds:
        if seed in kept:
            raise InputError(
                f"{setting} is or leads to {seed}, but {kept[0]} to {kept[-1]} {what}; name others"
            )

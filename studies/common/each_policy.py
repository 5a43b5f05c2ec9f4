"""One measurement of each of several policies, kept as soon as it is done."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from glassgait.models.files import record_or_made
from glassgait.models.policies.controller import AlternatingController
from glassgait.studies.common.console import progress_bar


def measure_each(
    walkers: Mapping[str, AlternatingController],
    measure: Callable[[AlternatingController], Any],
    folder: Path,
    *,
    of: str,
) -> dict[str, Any]:
    """Measures each policy, but for those that a run has measured already.

    Args:
        walkers: Policies by name.
        measure: Returns what is told of one, as JSON can hold it.
        folder: Folder of the run; it keeps `policies/<name>.json`.
        of: What tells the run from others.

    Returns:
        What was measured, by name.

    Raises:
        InputError: if what the folder keeps is damaged.
    """
    results = {}
    with progress_bar(len(walkers)) as (progress, bar):
        for name, walker in walkers.items():
            progress.update(bar, text=name)
            path = folder / "policies" / f"{name}.json"
            results[name] = record_or_made(path, lambda w=walker: measure(w), of=f"{of} {name}")
            progress.update(bar, advance=1)
    return results

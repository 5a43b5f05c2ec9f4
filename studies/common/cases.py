"""Cases: pieces of work that are done side by side, each kept as soon as it is done."""

import hashlib
import json
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pandas as pd
from joblib import delayed

from glassgait.diagrams.scenario import Scenario
from glassgait.models.files import read_record, write_record
from glassgait.models.policies.controller import AlternatingController, Controller
from glassgait.models.task.gait import Gait
from glassgait.studies.common.console import progress_bar
from glassgait.studies.common.parallel.loop import run_parallel
from glassgait.studies.common.serialization import to_plain


@dataclass(frozen=True)
class Case:
    """What is measured at once: a controller in a scenario, with a seed.

    Attributes:
        labels: Columns that distinguish the case's rows from the others'.
        gait: The gait.
        controller: What acts.
        scenario: Where.
        seed: Seed of all that is drawn.
        config: Further settings of the measurement, a dataclass or plain values.
        scores: Names of what is measured, where an earlier version measured something else.
    """

    labels: dict[str, Any]
    gait: Gait
    controller: Controller
    scenario: Scenario
    seed: int
    config: Any = None
    scores: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """What progress and files call it."""
        return "_".join(map(_short, self.labels.values())).replace("/", "-")

    @property
    def alone(self) -> AlternatingController:
        """The controller, where a policy acts alone or two by turns."""
        assert isinstance(self.controller, AlternatingController)
        return self.controller

    def digest(self) -> str:
        """Returns a digest that differs between cases that would not give the same table."""
        own = self.controller
        config = self.config.digest() if hasattr(self.config, "digest") else to_plain(self.config)
        settings = [self.gait.digest(), self.scenario.digest(), self.seed, config]
        policies = [policy.digest() for policy in (own.expert, own.student) if policy is not None]
        whole = [*settings, self.scores, own.settings(), *policies]
        return hashlib.sha256(json.dumps(whole).encode()).hexdigest()[:16]

    def with_config(self, config: Any) -> "Case":
        """Returns the case with other settings of the measurement."""
        return replace(self, config=config)


def _short(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


Measure = Callable[[Case], pd.DataFrame]


def run_cases(
    cases: Sequence[Case],
    measure: Measure,
    folder: Path,
    *,
    of: str = "",
    processes: int | None = None,
) -> pd.DataFrame:
    """Measures every case side by side, but for those whose tables the folder holds already.

    Args:
        cases: The cases, the slowest best first.
        measure: Measures one of them, in whichever process.
        folder: Where each case's table is kept as soon as it is done.
        of: What else distinguishes the tables of a run from those of another.
        processes: Cases at once; by default as many as there are cores, or the cluster has.

    Returns:
        The tables with their labels, in the order of the cases.

    Raises:
        InputError: if a table that the folder holds is damaged.
    """
    paths = [folder / f"{case.name}.{case.digest()}.json" for case in cases]
    names = [f"{of} {path.stem}".strip() for path in paths]
    kept = {
        i: pd.DataFrame(read_record(path, of=names[i]))
        for i, path in enumerate(paths)
        if path.exists()
    }
    pending = [i for i in range(len(cases)) if i not in kept]
    processes = max(1, min(processes or len(pending), len(pending)))
    work = (delayed(_numbered)(i, measure, cases[i]) for i in pending)
    with progress_bar(len(cases), len(cases) - len(pending)) as (progress, bar):
        for i, table in run_parallel(work, processes, in_order=False):
            values = table.to_dict(orient="list")
            write_record(paths[i], values, of=names[i])
            kept[i] = pd.DataFrame(values)
            progress.update(bar, advance=1, text=cases[i].name)
    return pd.concat([_labelled(case, kept[i]) for i, case in enumerate(cases)], ignore_index=True)


def _numbered(index: int, measure: Measure, case: Case) -> tuple[int, pd.DataFrame]:
    return index, measure(case)


def _labelled(case: Case, table: pd.DataFrame) -> pd.DataFrame:
    labels = pd.DataFrame(dict.fromkeys(case.labels), index=table.index)
    for name, value in case.labels.items():
        labels[name] = value
    return pd.concat([labels, table], axis=1)


def digests_of(cases: Iterable[Case]) -> dict[str, str]:
    """Returns digests of all that cases take in, as a run's record holds them."""
    every = list(cases)
    digests = {
        "gait": [case.gait.digest() for case in every],
        "expert": [case.controller.expert.digest() for case in every],
        "scenario": [case.scenario.digest() for case in every],
        "policies": [
            f"{case.labels.get('policy', '')} {own.digest()}".strip()
            for case in every
            for own in case.controller.policies.values()
        ],
    }
    return {name: " ".join(dict.fromkeys(own)) for name, own in digests.items()}


def slow_first(scenarios: Mapping[str, Scenario]) -> list[tuple[str, Scenario]]:
    """Returns scenarios by name, the slow ones first: few robots are rolled out there."""
    return sorted(scenarios.items(), key=lambda item: item[1].max_robots or math.inf)

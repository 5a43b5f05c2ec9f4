"""What all experiments share: they measure and report, and the base does the rest."""

import pickle
from collections.abc import Mapping
from functools import cached_property
from typing import ClassVar

import pandas as pd
import pytest

from glassgait.models.errors import InputError
from glassgait.models.settings import checked
from glassgait.studies.cli import COMMANDS, command_class
from glassgait.studies.common.experiment import Experiment, Report, RolloutExperiment
from glassgait.studies.common.sweep import WorkersConfig
from glassgait.studies.examples.stopping import Stopping

WRITTEN = {"measure", "report"}
KINDS = [own for own in map(command_class, COMMANDS) if issubclass(own, Experiment)]


@pytest.mark.parametrize("kind", [*KINDS, Stopping])
def test_an_experiment_overrides_nothing_but_measure_and_report(kind):
    bases = vars(Experiment) | vars(RolloutExperiment)
    done = {
        name
        for name, own in bases.items()
        if not name.startswith("__") and (callable(own) or hasattr(own, "__get__"))
    }
    assert {"cases", "run", "once", "_run_one", "_refuse", "seeds"} <= done
    assert {*vars(kind)} >= WRITTEN
    assert not (done - WRITTEN) & {*vars(kind)}


@checked
class Shared(Experiment):
    """Makes a number once, and measures it times each factor."""

    title: ClassVar[str] = "shared"
    of_students: ClassVar[bool] = True
    one: ClassVar[tuple[str, ...]] = ("policy",)
    axes: ClassVar[Mapping[str, str]] = {"factor": "factors"}
    prepared: ClassVar[tuple[str, ...]] = ("number",)
    inputs: ClassVar[Mapping[str, str]] = {"number": "digest"}

    policy: tuple[str, ...] = ("sparse_formula",)
    digest: ClassVar[str] = "of a number"
    factors: ClassVar[Mapping[str, int]] = {"one": 1, "three": 3}
    made: ClassVar[list[int]] = []

    @cached_property
    def number(self) -> int:
        return self.once("number", lambda: self.made.append(1) or 14)

    def measure(self, case):
        # As a worker has it, which is sent no policies but those of its cases.
        own = pickle.loads(pickle.dumps(self))
        assert "controllers" not in vars(own)
        return pd.DataFrame({"value": [vars(own)["number"] * case.values["factor"]]})

    def report(self, table):
        return Report(tables={"values": table}, metrics=table["value"].tolist())


def test_what_is_prepared_is_made_once_and_goes_to_every_case(tmp_path):
    Shared.made.clear()
    here = WorkersConfig(n_workers=1)
    Shared(output=tmp_path / "run", workers=here).run()
    table = pd.read_csv(tmp_path / "run" / "values.csv")
    assert table[["policy", "factor", "value"]].to_numpy().tolist() == [
        ["sparse_formula", "one", 14], ["sparse_formula", "three", 42],
    ]  # fmt: skip
    assert "number: of a number" in (tmp_path / "run" / "config.yaml").read_text()
    Shared(output=tmp_path / "run", workers=here, resume=True).run()
    assert Shared.made == [1]


@pytest.mark.parametrize(
    ("settings", "key"),
    [
        ({"policy": ("expert",)}, "--policy expert"),
        ({"policy": ("gbm", "ebm")}, "--policy"),
        ({"gait": ("three_one",)}, "--policy 'sparse_formula'"),
        ({"seed": 500}, "seed"),
    ],
)
def test_what_cannot_be_measured_is_refused_before_anything_is_made(settings, key, tmp_path):
    with pytest.raises(InputError, match=key):
        Shared(output=tmp_path / "run", **settings).run()
    assert not (tmp_path / "run").exists()

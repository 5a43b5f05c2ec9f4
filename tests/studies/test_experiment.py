"""Experiments: the base finds, measures and keeps; a study measures a case and reports."""

import json
from typing import ClassVar

import pandas as pd
import pytest

from glassgait.models.errors import InputError
from glassgait.models.settings import checked
from glassgait.studies.common.experiment import Experiment, Report

SMALL = {"policy": ("expert", "formulas"), "scenario": ("nominal", "push_1.0")}


@checked
class Count(Experiment):
    """Counts how often cases are measured."""

    title: ClassVar[str] = "count"
    measured: ClassVar[list[str]] = []
    interrupted: ClassVar[int] = 100

    def measure(self, case):
        if len(self.measured) >= self.interrupted:
            raise KeyboardInterrupt
        self.measured.append(case.name)
        value = case.seed + 0.1 * len(case.scenario.title)
        return pd.DataFrame({"value": [value, float("nan")], "text": ["", "b"]})

    def report(self, table):
        return Report(tables={"values": table}, metrics=table["value"].dropna().tolist())


@pytest.fixture(autouse=True)
def fresh(monkeypatch):
    monkeypatch.setattr(Count, "measured", [])


def test_every_policy_meets_every_scenario_and_seed(tmp_path):
    Count(**SMALL, n_seeds=2, output=tmp_path / "run").run()
    table = pd.read_csv(tmp_path / "run" / "values.csv")
    assert len(Count.measured) == 8 and len(table) == 16
    assert table.columns.tolist() == ["gait", "policy", "scenario", "seed", "value", "text"]
    assert set(table["seed"]) == {7000, 7001}
    assert len(json.loads((tmp_path / "run" / "metrics.json").read_text())) == 8


def test_a_run_that_was_interrupted_measures_only_what_is_missing(tmp_path, monkeypatch):
    whole, folder = tmp_path / "whole", tmp_path / "run"
    Count(**SMALL, output=whole).run()
    Count.measured.clear()
    monkeypatch.setattr(Count, "interrupted", 3)
    with pytest.raises(KeyboardInterrupt):
        Count(**SMALL, output=folder).run()
    monkeypatch.setattr(Count, "interrupted", 4)
    Count(**SMALL, output=folder, resume=True).run()
    assert len(set(Count.measured)) == len(Count.measured) == 4
    for name in ("values.csv", "metrics.json"):
        assert (folder / name).read_bytes() == (whole / name).read_bytes()
    with pytest.raises(InputError, match="--resume"):
        Count(**SMALL, output=folder).run()
    kept = next((folder / "cases").iterdir())
    kept.write_text(kept.read_text().replace("value", "valve", 1))
    with pytest.raises(InputError, match="is damaged; delete it, and --resume makes it anew"):
        Count(**SMALL, output=folder, resume=True).run()


def test_each_of_several_gaits_has_its_folder(tmp_path, monkeypatch):
    Count(gait=("trot", "walk"), policy=("expert",), output=tmp_path).run()
    assert {path.name for path in tmp_path.iterdir()} == {"trot", "walk"}
    monkeypatch.chdir(tmp_path)
    Count(gait=("trot",), policy=("expert",)).run()
    assert (tmp_path / "runs" / "count" / "trot_expert" / "values.csv").exists()


@pytest.mark.parametrize(
    ("settings", "key"),
    [
        ({"gait": ("three_one",), "policy": ("formulas",)}, "policy 'formulas'"),
        ({"gait": ("gallop",)}, "unknown gait 'gallop'"),
        ({"scenario": ("mars",)}, "mars"),
        ({"seed": 500}, "500 to 509 selected among candidates"),
        ({"seed": 1004}, "1000 to 1004 selected among shipped policies"),
    ],
)
def test_bad_settings_are_refused_before_anything_is_written(settings, key, tmp_path):
    with pytest.raises(InputError, match=key):
        Count(output=tmp_path / "run", **settings).run()
    assert not (tmp_path / "run").exists()

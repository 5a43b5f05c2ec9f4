"""The benchmark times what it says it times."""

import pandas as pd
import pytest

from glassgait.models.export.binding import has_compiler
from glassgait.studies.cli import main
from glassgait.studies.reproduction import benchmark


@pytest.mark.slow
@pytest.mark.skipif(not has_compiler(), reason="needs a C compiler, cc")
def test_actions_are_timed_in_python_and_in_c(tmp_path, monkeypatch):
    monkeypatch.setattr(benchmark, "STEPS", 2000)
    main(["reproduce", "benchmark", "--output", str(tmp_path / "run")])
    table = pd.read_csv(tmp_path / "run" / "actions.csv")
    times = table[["action in Python (µs)", "step in C (µs)", "step in C, 99.9 % (µs)"]]
    assert (times > 0).all(axis=None)

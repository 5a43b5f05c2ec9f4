"""The demo, in small: one command from the shipped expert to a page."""

import pytest

from glassgait.studies.cli import main
from glassgait.studies.demo import command
from glassgait.studies.distillation.config import DistillationConfig
from glassgait.studies.students.settings import StudentsSettings
from glassgait.studies.students.symbolic_settings import StatewiseSymbolicSettings

TINY = DistillationConfig(
    students=("linear", "statewise_symbolic"),
    episodes=5,
    alone_rounds=0,
    episode_steps=60,
    settings=StudentsSettings(
        statewise_symbolic=StatewiseSymbolicSettings(shapes=((20, 20),), start_weights=(1,))
    ),
    n_jobs=1,
)


@pytest.mark.slow
def test_demo_writes_a_page_with_tables_formulas_and_replays(
    tmp_path, monkeypatch, capsys, refused
):
    monkeypatch.setattr(command, "QUICK", TINY)
    monkeypatch.setattr(command, "REPLAY_SECONDS", 1.0)
    command_line = ["demo", "--output", str(tmp_path), "--n-robots", "2"]
    main(command_line)
    page = (tmp_path / "report.html").read_text()
    assert page.count("<b>FL_hip in q") == 2
    assert "Linear" in page
    for kind in ("expert", "statewise_symbolic"):
        assert f'src="{kind}_replay.html"' in page
        assert (tmp_path / f"{kind}_replay.html").exists()
    assert "report written to" in capsys.readouterr().out
    assert "continue it with --resume" in refused(command_line)
    main([*command_line, "--resume"])

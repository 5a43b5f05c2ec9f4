"""The command line: help, bad input, and the ends of commands."""

import os
import subprocess
import sys

import numpy as np
import pandas as pd
import pytest

from glassgait.studies.cli import COMMANDS, command_class, main
from glassgait.studies.common.console import report_errors
from glassgait.studies.common.run import default_folder
from glassgait.studies.common.tables import format_cell, to_markdown

EARLY = {
    "gallop": "unknown command 'gallop'; the commands are demo",
    "evaluate scenario": "unknown command 'evaluate scenario', perhaps 'evaluate scenarios'",
    "--version x": "unknown command '--version x'",
    "gait tort": "unknown gait 'tort', perhaps 'trot'; the gaits are",
    "train --gait gallop": "unknown gait 'gallop'; the gaits are",
    "evaluate pushes --scenario nominal push1.0": "unknown scenario 'push1.0', perhaps 'push_1.0'",
    "evaluate scenarios --policy=oracle": "unknown policy 'oracle'; the policies are expert",
    "distill --students gbm ebn": "unknown student 'ebn', perhaps 'ebm'",
    "robot a2": "unknown robot 'a2'; the robots are",
    "view --output taken": "--output taken: taken is a file",
    "gait --output=taken/trot.md": "--output taken/trot.md: taken is a file",
}
"""Refused before anything slow is imported."""

REFUSED = {
    "train --n-robots 0": "n_robots",
    "distill --students linear linear": "students",
    "evaluate scenarios --scenario nominal nominal": "scenario",
    "train --gait trot pace --print-settings": "a settings file is of one gait",
    "evaluate alternation --ratios 2/3": "is not an alternation ratio",
    "evaluate alternation --ratios 1": "no student acts; give one, and a ratio below 1",
    "importance --n-samples 1": "n_samples",
    "reproduce nonesuch.yaml": "nonesuch.yaml",
}


@pytest.mark.parametrize("command", EARLY)
def test_unknown_names_and_files_in_the_way_are_refused_early(
    command, refused, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "taken").touch()
    monkeypatch.setattr("glassgait.studies.cli.import_module", None)
    assert EARLY[command] in refused(command.split())
    assert [path.name for path in tmp_path.iterdir()] == ["taken"]


def test_a_locale_that_drake_cannot_read_is_refused():
    old = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    command = [sys.executable, "-c", "from glassgait.studies.cli import main; main(['view'])"]
    ended = subprocess.run(
        command, check=False, capture_output=True, text=True, env={**os.environ, **old}
    )
    assert ended.returncode == 2 and "set PYTHONUTF8=1" in ended.stderr


@pytest.mark.parametrize("command", REFUSED)
def test_bad_input_is_refused_in_one_sentence(command, refused, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert REFUSED[command] in refused(command.split())
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]


@pytest.mark.parametrize("arguments", [["--help"], ["evaluate", "--help"]])
def test_help_lists_the_commands(arguments, capsys):
    main(arguments)
    listed = capsys.readouterr().out
    for name in COMMANDS:
        assert (f"  {name} " in listed) == (arguments[:1] != ["evaluate"] or "evaluate" in name)


def test_settings_are_printed_and_read_with_their_gait(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for gait, read in (("pace", "pace"), ("hop.yaml", tmp_path / "hop.yaml")):
        for command in ("train", "distill"):
            main([command, "--gait", gait, "--print-settings"])
            (tmp_path / "mine.yaml").write_text(capsys.readouterr().out)
            main([command, "--settings", "mine.yaml", "--print-settings"])
            assert capsys.readouterr().out.startswith(f"gait: {read}\n")


@pytest.mark.parametrize(
    "name", [name for name in COMMANDS if name not in ("gait", "reproduce paper")]
)
def test_errors_and_folders_call_a_command_by_its_words(name):
    assert command_class(name).title == name
    assert default_folder(name).parts == ("runs", *name.split())


@pytest.mark.parametrize("command", ["evaluate scenarios", "train", "refine", "importance"])
def test_help_waits_for_no_library(command):
    # Settings of worlds are Drake's.
    heavy = {"torch", "sklearn", "interpret", "matplotlib"}
    heavy |= {"pydrake"} if command == "evaluate scenarios" else set()
    code = (
        "import sys; from glassgait.studies.cli import main\n"
        f"try: main('{command} --help'.split())\n"
        f"except SystemExit: print(*(set(sys.modules) & {heavy}), file=sys.stderr)"
    )
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "--n-robots" in ended.stdout and not ended.stderr.strip()


def test_ctrl_c_ends_in_a_sentence(capsys):
    with pytest.raises(SystemExit, match="130"), report_errors():
        raise KeyboardInterrupt
    assert capsys.readouterr().err == "glassgait: interrupted; what was finished is kept\n"


def test_a_refusal_is_one_line_whatever_a_path_holds(refused):
    assert "\\n\\x1b" in refused(["view", "--policy", "a\n\x1b[2J.formulas"])


def test_cells_and_markdown():
    assert [format_cell(x) for x in (np.nan, 0.0123, 3.14159, 1234.5, "a", 3)] == [
        "–", "0.0123", "3.142", "1,234", "a", "3",
    ]  # fmt: skip
    table = to_markdown(pd.DataFrame({"a": [1], "b": [0.5]}))
    assert table == "| a | b |\n| --- | --- |\n| 1 | 0.500 |\n"


def test_gait_command_draws_the_machine(capsys):
    main(["gait", "trot"])
    assert "q0, initial\n  └─ FL & RR & ~FR & ~RL, after dwell" in capsys.readouterr().out

"""Every command in small: it runs, and writes what it should. Those of pages are valid."""

import re
import shlex
from pathlib import Path

import pandas as pd
import pytest

from glassgait.models.export.binding import has_compiler
from glassgait.studies import cli
from glassgait.studies.cli import COMMANDS, main

ROBOTS = ["--n-robots", "2", "--n-steps", "20"]

SEEDED = [*ROBOTS, "--n-seeds", "1", "--policy", "expert", "formulas"]

FORMULAS = ["--policy", "formulas"]

FAST = {
    "gait": (["trot"], []),
    "robot": (["a1"], []),
    "evaluate scenarios": ([*SEEDED, "--scenario", "nominal"], ["metrics.json"]),
    "evaluate alternation": ([*SEEDED, "--ratios", "1", "0"], ["return.png"]),
    "explain formulas": (FORMULAS, []),
    "explain page": ([*FORMULAS, "--n-steps", "20", "--step", "10"], ["index.html"]),
    "view": ([*FORMULAS, "--n-steps", "20"], ["*.html", "*.png"]),
}
"""Settings of a command, and patterns of files that it writes."""

SETTINGS = Path(__file__).parent / "settings"
TRAIN = ["--settings", str(SETTINGS / "train.yaml"), "--updates", "1"]
REFINE = ["--settings", str(SETTINGS / "refine.yaml"), "--updates", "2", "--candidate-steps", "10"]

PUSHES = ["--n-directions", "4", "--speeds", "0.5", "1", "--n-phases", "1", "--n-steps", "50"]

SLOW = {
    "train": (TRAIN, ["trot.safetensors"]),
    "distill": (
        ["--students", "linear", "--episodes", "5", "--alone-rounds", "0", "--episode-steps", "30"],
        ["linear.safetensors", "r2.csv"],
    ),
    "refine": (REFINE, ["*.formulas"]),
    "evaluate pushes": ([*FORMULAS, *PUSHES], ["metrics.json"]),
    "importance": (["--policy", "gbm", "--n-samples", "20", "--repeats", "1"], ["metrics.json"]),
    "explain interventions": ([*FORMULAS, "--n-robots", "2"], ["*.csv"]),
    "explain counterfactual": (FORMULAS, ["*.csv"]),
    "export": ([*FORMULAS, "--n-steps", "20"], ["*.c", "deploy.yaml"]),
    "verify prove": (FORMULAS, ["*"]),
}

ELSEWHERE = {
    "demo": "test_reproduce.py",
    "policy check": "test_described_policies.py",
    "policy convert": "test_described_policies.py",
    "studio": "test_browser.py",
    "verify check": "test_certification.py",
    "reproduce paper": "test_reproduce.py",
    "reproduce report": "test_reproduce.py",
    "reproduce benchmark": "test_benchmark.py",
}
"""Where the other commands are tested."""


ROOT = Path(cli.__file__).parents[1]
PAGES = "\n".join(page.read_text("utf-8") for page in sorted(ROOT.glob("**/README.md")))
BLOCKS = re.findall(r"```bash\n(.*?)```", PAGES, re.DOTALL)
FILES = {"mine.yaml": "{}"}
FILES |= dict(
    re.findall(r"`(students\.yaml|refine\.yaml)`:\n\n```yaml\n(.*?)```", PAGES, re.DOTALL)
)
PAGE_COMMANDS = sorted({*re.findall(r"^glassgait ([^>|&#\n]+)", "\n".join(BLOCKS), re.MULTILINE)})


@pytest.mark.parametrize("command", PAGE_COMMANDS)
def test_a_command_of_a_page_is_valid(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name, text in FILES.items():
        Path(name).write_text(text)
    Path("models").symlink_to(ROOT / "models")
    read, ran = cli.command_class, []

    def idle(name):
        monkeypatch.setattr(read(name), "run", lambda self: ran.append(type(self)))
        return read(name)

    monkeypatch.setattr(cli, "command_class", idle)
    main(shlex.split(command))
    assert len(ran) == 1


def test_every_command_is_tested():
    assert {*FAST, *SLOW, *ELSEWHERE} == {*COMMANDS}
    assert len(PAGE_COMMANDS) > 30


def run(command, arguments, patterns, folder):
    output = ["--output", str(folder)] if patterns else []
    main([*command.split(), *arguments, *output])
    for pattern in patterns:
        assert list(folder.rglob(pattern)), pattern
    for path in folder.rglob("*.csv"):
        assert_numeric(pd.read_csv(path))


def assert_numeric(table):
    """Asserts that no column mixes numbers and text, nor holds numbers with signs around them."""
    for name in table.select_dtypes(exclude=["number", "bool"]):
        for cell in table[name].dropna().map(str):
            assert not any(mark in cell for mark in ("±", "–", " %")), (name, cell)
            words = cell.replace(" of ", " ").split()
            assert not all(word.lstrip("+-").replace(".", "", 1).isdigit() for word in words), name


@pytest.mark.parametrize("command", FAST)
def test_a_command_writes_its_results(command, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    run(command, *FAST[command], tmp_path / "run")
    assert capsys.readouterr().out


@pytest.mark.slow
@pytest.mark.parametrize("command", SLOW)
def test_a_long_command_writes_its_results(command, tmp_path, monkeypatch):
    if command == "export" and not has_compiler():
        pytest.skip("needs a C compiler, cc")
    monkeypatch.chdir(tmp_path)
    run(command, *SLOW[command], tmp_path / "run")

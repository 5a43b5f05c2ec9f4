"""A person's own words, wherever they are written: none of them are read as a language."""

import numpy as np
import pandas as pd
import pytest
import yaml

from glassgait.diagrams.rollout import Rollout
from glassgait.models.task.gait import GAIT_DIRECTORY, load_gait
from glassgait.studies.cli import main
from glassgait.studies.common.console import console, progress_bar, say
from glassgait.studies.common.figures import save_figure, subplots
from glassgait.studies.common.gait_figure import draw_gait
from glassgait.studies.common.tables import print_table, to_markdown

WORDS = ["[/y]", "[bold]x[/bold]", "x[y]", ":smile:", "[link=a]b[/link]", "\\[x]"]


@pytest.mark.parametrize("words", WORDS)
def test_the_terminal_shows_words_as_they_are(words, capsys):
    say(words)
    console.print(words)
    print_table(words, pd.DataFrame({words: [words]}))
    with progress_bar(1) as (progress, bar):
        progress.update(bar, text=words)
    # Say, print, title, head, cell and bar.
    assert capsys.readouterr().out.count(words) >= 6


def test_gait_command_takes_files_named_like_markup(tmp_path, capsys):
    trot = (GAIT_DIRECTORY / "trot.yaml").read_text()
    gait, output = tmp_path / "x[y].yaml", tmp_path / "x[" / "y].md"
    gait.write_text(trot)
    main(["gait", str(gait), "--output", str(output)])
    assert capsys.readouterr().out == f"x[y]: 2 states, drawn in {output}\n"
    assert output.read_text().startswith("```mermaid\nstateDiagram-v2\n")


def test_paths_that_are_not_utf_8_are_reported_by_their_codes(tmp_path, capsys):
    main(["gait", "trot", "--output", str(tmp_path / "\udcff.md")])
    assert r"\udcff.md" in capsys.readouterr().out


def test_names_stay_in_their_cells_in_markdown():
    frame = pd.DataFrame({"a|b": ["x | y", "`z", "two\nlines", "back\\", "<b>"]})
    assert to_markdown(frame).splitlines() == [
        r"| a\|b |", "| --- |", r"| x \| y |", r"| \`z |", "| two lines |", r"| back\\ |",
        r"| \<b> |",
    ]  # fmt: skip


def test_states_named_like_mathematics_are_drawn(tmp_path):
    values = yaml.safe_load((GAIT_DIRECTORY / "trot.yaml").read_text())
    path = tmp_path / "mine.yaml"
    path.write_text(yaml.safe_dump(values).replace("q1", "$x^{$"))
    gait = load_gait(path)
    rollout = Rollout(
        np.arange(4.0), {"rm_state": np.eye(2)[[0, 1, 0, 1]], "foot_contact": np.eye(4)}
    )
    figure, axes = subplots()
    draw_gait(axes, rollout, gait)
    save_figure(figure, tmp_path / "gait")
    assert (tmp_path / "gait.png").exists()

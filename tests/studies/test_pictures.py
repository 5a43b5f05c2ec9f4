"""Pictures of the pages: none is older than what it was drawn from, and all can be read."""

import re
from datetime import date
from xml.etree import ElementTree

import pytest

from glassgait.models.task.gait import load_gait
from glassgait.models.task.palette import contrast
from glassgait.studies.evaluation.worlds_figures import fall_overview
from glassgait.studies.pictures.age import FOLDER, KINDS, digests, read_record
from glassgait.studies.pictures.blocks import BLOCKS, blocks_svg
from glassgait.studies.pictures.draw import FALLS_PAGE, loop_dot, pictures
from glassgait.studies.pictures.falls import POLICIES, falls_on

RECORD = read_record()
PRESENT = sorted(path.name for path in FOLDER.iterdir() if path.suffix in KINDS)


def test_every_picture_has_a_record_and_every_record_a_picture():
    assert sorted(RECORD) == PRESENT


@pytest.mark.parametrize("name", sorted(pictures()))
def test_a_picture_is_no_older_than_what_it_was_drawn_from(name):
    assert RECORD[name].get("inputs") == pictures()[name].inputs(), (
        f"{name} is old; draw it with '{RECORD[name]['command']}'"
    )


@pytest.mark.parametrize("name", sorted(set(PRESENT) - set(pictures())))
def test_of_other_pictures_the_record_says_which_run_drew_them(name):
    own = RECORD[name]
    assert set(own) == {"command", "date", "run"}
    assert own["command"].startswith("glassgait ")
    assert date.fromisoformat(own["date"]) <= date.today()


def test_a_changed_input_is_noticed(tmp_path, monkeypatch):
    monkeypatch.setattr("glassgait.studies.pictures.age.ROOT", tmp_path)
    (tmp_path / "a.yaml").write_text("speed: 1")
    before = digests(tmp_path / "a.yaml")
    (tmp_path / "a.yaml").write_text("speed: 2")
    assert digests(tmp_path / "a.yaml") != before


def test_the_blocks_that_ship_are_those_that_are_drawn():
    assert (FOLDER / "blocks.svg").read_text() == blocks_svg()


def test_words_of_blocks_fit_and_can_be_read():
    drawing = ElementTree.fromstring(blocks_svg())
    assert len(BLOCKS) == 6
    for block in BLOCKS:
        assert max(map(len, block.words)) <= 24
        ground, edge = block.look
        assert contrast(ground, "#1b1f24") >= 4.5
        assert contrast(edge, "#ffffff") >= 3.0
    texts = [node.text for node in drawing.iter("{http://www.w3.org/2000/svg}text")]
    assert "4. Formulas" in texts
    colors = {node.get("fill") for node in drawing.iter("{http://www.w3.org/2000/svg}text")}
    assert all(contrast(color, "#ffffff") >= 4.5 for color in colors)


def test_the_map_of_falls_is_drawn_from_the_numbers_on_the_page():
    page = "text\n\n| scenario | walk | half-bound |\n|---|---|---|\n" + (
        "| slope | 2 / 8 / 1 / 7 / 9 | 22 / 26 / 0 / 5 |\n"
        "| SAP (training) | 0 / 0 / 0 / 0 / – | 0 / 0 / 0 / 0 |\n\nmore"
    )
    walk, half_bound = falls_on(page).values()
    assert walk["policy"].tolist() == [*POLICIES, *POLICIES[:4]]
    assert walk["falls"].tolist() == [2, 8, 1, 7, 9, 0, 0, 0, 0]
    assert half_bound["falls"].tolist() == [22, 26, 0, 5, 0, 0, 0, 0]
    assert half_bound["scenario"].unique().tolist() == ["slope", "training"]
    assert half_bound["fall_rate"][1] == 1.0


def test_rows_of_the_map_are_in_the_order_of_the_table_on_the_page():
    tables = falls_on(FALLS_PAGE.read_text())
    (first, *_) = fall_overview(tables).axes
    drawn = [" ".join(label.get_text().split()) for label in first.get_yticklabels()]
    assert drawn == next(iter(tables.values()))["world"].unique().tolist()


def test_the_loop_is_described_alike_however_many_systems_there_were():
    first, second = (loop_dot(load_gait("trot")) for _ in range(2))
    assert first == second
    assert not re.search(r"\bs\d{3,}", first)

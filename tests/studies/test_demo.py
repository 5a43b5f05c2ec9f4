"""The demo, in small: one command from the shipped expert to a page that grows."""

import time
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pandas as pd
import pytest

from glassgait.models.policies.library import load_expert, load_student
from glassgait.models.task.gait import load_gait
from glassgait.studies.cli import main
from glassgait.studies.common.figures import save_figure, subplots
from glassgait.studies.common.rollouts import RolloutConfig
from glassgait.studies.distillation.config import DistillationConfig
from glassgait.studies.distillation.students.settings import StudentsSettings
from glassgait.studies.distillation.students.symbolic_regression import StatewiseSymbolicSettings
from glassgait.studies.reproduction import demo
from glassgait.studies.reproduction.demo import Parts, demo_page, formula_texts
from glassgait.studies.reproduction.page import Page, Replay

TINY = DistillationConfig(
    students=("linear", "statewise_symbolic"),
    episodes=5,
    alone_rounds=0,
    episode_steps=60,
    settings=StudentsSettings(
        statewise_symbolic=StatewiseSymbolicSettings(shapes=((20, 20),), start_weights=(1,))
    ),
    n_workers=1,
)

VOID = {"meta", "img", "br", "link", "input"}
MISSING = "Not there yet"


class Strict(HTMLParser):
    """Reads a page strictly: what is opened is closed, in order; links lead somewhere."""

    def __init__(self, text):
        super().__init__()
        self.open, self.ids, self.anchors = [], [], set()
        self.feed(text)
        self.close()
        assert text.startswith("<!doctype html>")
        assert self.open == []
        assert len(set(self.ids)) == len(self.ids)
        assert self.anchors <= set(self.ids)

    def handle_starttag(self, tag, attrs):
        own = dict(attrs)
        # A paragraph holds text alone: a browser would close it before these.
        assert not (tag in ("table", "div", "figure", "h2", "p") and "p" in self.open)
        if "id" in own:
            self.ids.append(own["id"])
        if own.get("href", "").startswith("#"):
            self.anchors.add(own["href"][1:])
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


@pytest.fixture
def complete(tmp_path):
    """What a complete page shows, its pictures in the folder."""
    strip = {"period": 0.02, "legs": ["FL"], "states": ["<q0>"], "colors": ["#0072B2"]}
    strip |= {"inks": ["#ffffff"], "state": [0, 0], "contact": [[1], [0]]}
    names = ("shipped", "expert", "own")
    replays = {name: Replay(name.title(), f"{name}_replay.html", strip) for name in names}
    save_figure(subplots()[0], tmp_path / "return", ("png",))
    trot = load_gait("trot")
    return Parts(
        trot,
        load_expert("trot"),
        RolloutConfig(n_seeds=1),
        replays=replays,
        standalone=pd.DataFrame({"policy": ["Open loop"], "falls": ["3 of 26"]}),
        return_figure=tmp_path / "return.png",
        r2=pd.DataFrame({"student": list(demo.QUICK.students), "R²": 0.9}),
        formulas=formula_texts(trot, load_student("trot", "statewise_symbolic")),
        minutes=2.0,
    )


def written(folder, parts):
    text = demo_page(parts).write(folder).read_text()
    Strict(text)
    return text


def test_complete_page_misses_nothing(complete, tmp_path):
    page = written(tmp_path, complete)
    assert MISSING not in page
    assert "not complete" not in page
    assert "3 of 26" in page
    assert page.count("<summary>") == 12


def test_page_says_what_is_missing(complete, tmp_path):
    parts = {
        "replays": ({}, "further replays"),
        "standalone": (None, "how every student walks alone"),
        "return_figure": (None, "take turns"),
        "formulas": ([], "the formulas"),
    }
    for name, (nothing, message) in parts.items():
        page = written(tmp_path, replace(complete, **{name: nothing, "minutes": None}))
        assert page.count(MISSING) == 1
        assert message in page[page.index(MISSING) :].split("</p>")[0]
        assert "This page is not complete" in page


def test_page_says_how_many_students_are_missing(complete, tmp_path):
    some = replace(complete, r2=complete.r2[:-2], minutes=None)
    assert f"{MISSING}: 2 of 9 students" in written(tmp_path, some)
    none = replace(complete, r2=None, minutes=None)
    assert f"{MISSING}: the first of 9 students" in written(tmp_path, none)


def test_page_lists_what_is_smaller_and_what_is_lost(complete, tmp_path):
    page = written(tmp_path, complete)
    assert "What is smaller here, and what is lost" in page
    assert "12 episodes of 10 s" in page
    assert "Symbolic, for all" in page
    assert "26 of one seed, for 20 s" in page
    assert '<td class="text">1, 1/4, 0</td>' in page
    assert "intervals are 2.2 times as wide" in page
    assert "GBM is not compared" in page


@pytest.fixture(scope="module")
def road(tmp_path_factory):
    """The demo's folder, its command line, and how the report looked each time it was written.

    What stood in the folder when distillation began comes last.
    """
    folder = tmp_path_factory.mktemp("demo")
    command_line = ["demo", "--output", str(folder), "--n-robots", "2"]
    pages, before = [], []

    def write(page, own_folder):
        path = own_write(page, own_folder)
        pages.append(path.read_text())
        return path

    def distill(*arguments, **options):
        before.extend(path.name for path in folder.iterdir())
        return own_distill(*arguments, **options)

    own_distill, own_write = demo.distill, Page.write
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(demo, "QUICK", TINY)
        patch.setattr(demo, "REPLAY_STEPS", 50)
        patch.setattr(Page, "write", write)
        patch.setattr(demo, "distill", distill)
        main(command_line)
        yield folder, command_line, pages, before


@pytest.mark.slow
def test_replay_and_page_are_there_before_distillation_begins(road):
    _, _, pages, before = road
    assert {"shipped_replay.html", "expert_replay.html", "report.html"} <= set(before)
    assert "return.png" not in before
    assert 'src="shipped_replay.html"' in pages[0]
    assert "not complete" in pages[0]


@pytest.mark.slow
def test_page_grows_until_it_is_complete(road):
    folder, _, pages, _ = road
    for page in pages:
        Strict(page)
    missing = [page.count(MISSING) for page in pages]
    assert missing == sorted(missing, reverse=True)
    assert missing[0] == 5
    assert [bool(count) for count in missing] == ["not complete" in page for page in pages]
    assert missing[-1] == 0
    assert pages[-1] == (folder / "report.html").read_text()


@pytest.mark.slow
def test_demo_writes_a_page_with_tables_formulas_and_replays(road, refused, capsys):
    folder, command_line, pages, _ = road
    page = pages[-1]
    assert page.count("<strong>FL_hip in q") == 2
    assert "Linear" in page
    for name in ("shipped", "expert", "statewise_symbolic"):
        assert f'src="{name}_replay.html"' in page
        assert (folder / f"{name}_replay.html").exists()
    assert "continue it with --resume" in refused(command_line)
    main([*command_line, "--resume"])
    message = capsys.readouterr().out
    assert "report written to" in message
    assert "shipped_replay.html" in message


@pytest.mark.slow
def test_everybody_can_read_the_report(road, faults_of):
    folder, *_ = road
    assert faults_of(folder / "report.html") == []


@pytest.mark.slow
def test_browser_shows_every_picture_and_a_replay_that_moves(road, browser):
    folder, *_ = road
    browser.get((folder / "report.html").as_uri())
    widths = browser.execute_script("return [...document.images].map(own => own.naturalWidth)")
    assert len(widths) == 1
    assert min(widths) > 0
    browser.get((folder / "shipped_replay.html").as_uri())
    place = (
        "const trunk = viewer.scene_tree.find(arguments[0]).object;"
        "return [...trunk.matrix.elements];"
    )
    path = ["drake", "visualizer", "a1", "trunk"]
    seen = set()
    # Longer than the replay: it begins anew.
    time.sleep(3.0)
    deadline = time.monotonic() + 60.0
    while len(seen) < 3 and time.monotonic() < deadline:
        seen.add(tuple(np.round(browser.execute_script(place, path), 4)))
        time.sleep(0.1)
    assert len(seen) >= 3

"""The page that explains a rollout: its numbers, what it refuses, and what a browser shows."""

import json
import re
import shutil
import subprocess

import numpy as np
import pytest

from models.policies.library import load_expert
from models.policies.linear import LinearPolicy
from models.policies.open_loop import OpenLoopPolicy
from studies.cli import main

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("chrome")


@pytest.fixture(scope="module")
def students(tmp_path_factory):
    """A folder with a linear student, which leans a little, and one that is no sum of terms."""
    folder = tmp_path_factory.mktemp("students")
    names = load_expert("trot").observation_names
    weights = 0.02 * np.random.default_rng(3).normal(size=(12, len(names)))
    LinearPolicy("trot", names, weights, np.full(12, 0.1)).save(folder / "linear.safetensors")
    OpenLoopPolicy("trot", names, np.zeros((2, 5, 12))).save(folder / "open_loop.safetensors")
    walk = load_expert("walk").observation_names
    LinearPolicy("trot", walk, np.zeros((12, len(walk))), np.zeros(12)).save(
        folder / "ebm.safetensors"
    )
    return folder


@pytest.fixture(scope="module")
def page(students, tmp_path_factory):
    output = tmp_path_factory.mktemp("page")
    where = ["--students", str(students), "--output", str(output)]
    main(["explain", "--policy", "linear", "--seconds", "0.8", "--step", "12", *where])
    return output / "index.html"


def embedded(page, name):
    found = re.search(rf'id="{name}" type="application/json">(.*?)</script>', page.read_text())
    assert found is not None
    return json.loads(found.group(1))


def test_shown_terms_and_the_rest_are_the_action(page):
    data = embedded(page, "data")
    assert data["step"] == 12
    assert len(data["explained"]) == 12
    assert len(data["state"]) == len(data["contact"]) == len(data["place"]) == 41
    for joint in data["explained"]:
        assert joint["error"] < 1e-9
        total = np.sum(joint["value"], axis=1) + joint["rest"]
        np.testing.assert_allclose(total, joint["action"], atol=2e-4)
        assert (np.diff(np.abs(joint["value"]), axis=1) <= 0).all()


def test_page_needs_nothing_from_elsewhere(page):
    text = page.read_text()
    head = text[: text.index('id="replay-page"')]
    assert "http://" not in head.replace("http://www.w3.org/2000/svg", "")
    assert "https://" not in head
    assert "<script src" not in text
    assert "MeshCat.Viewer" in embedded(page, "replay-page")


def test_figures_of_the_step_lie_beside_the_page(page):
    for extension in ("png", "pdf"):
        assert (page.parent / f"linear_FL_hip_step_12.{extension}").exists()


@pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium to open the page")
def test_browser_shows_the_moment_that_a_link_names(page):
    command = [str(CHROMIUM), "--headless=new", "--no-sandbox", "--disable-gpu", "--dump-dom"]
    link = f"file://{page}#joint=4&step=30"
    shown = subprocess.run(
        [*command, "--virtual-time-budget=3000", link],
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    ).stdout
    joint = embedded(page, "data")["explained"][4]
    sign = "−" if joint["action"][30] < 0 else "+"
    action = f"{sign}{abs(joint['action'][30]):.3f}"
    assert f"FR thigh at step 30: action {action}" in shown
    assert "0.60 s" in shown
    largest = joint["terms"][joint["index"][30][0]]
    rows = re.findall(r'<td class="term" title="([^"]*)"', shown)
    assert rows[0] == largest
    assert "sum = action" in rows
    assert "other terms" in rows[rows.index("sum = action") - 1]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--gait", "gallop"], "gallop"),
        (["--joint", "FL_knee"], "unknown joint 'FL_knee'; the joints are FL_hip"),
        (["--step", "900", "--seconds", "0.2"], "name one from 0 to 10"),
        (["--policy", "forest"], "unknown policy 'forest'"),
        (["--policy", "open_loop"], "kind 'open_loop' do not split into contributions"),
        (["--policy", "ebm"], "distil it again for this layout"),
        (["--policy", "gbm"], "no student 'gbm' of the trot"),
    ],
)
def test_bad_input_is_told(students, tmp_path, refused, arguments, message):
    policy = [] if "--policy" in arguments else ["--policy", "linear"]
    where = ["--students", str(students), "--output", str(tmp_path / "page")]
    assert message in refused(["explain", *policy, *arguments, *where])
    assert not (tmp_path / "page" / "index.html").exists()

"""The page that asks what a robot would have had to observe."""

import html
import json

import numpy as np
import pandas as pd
import pytest

from glassgait.models.robots import quadruped
from glassgait.models.robots.library import load_robot
from glassgait.studies.cli import main
from glassgait.studies.explanation.counterfactuals.futures import BEFORE

A1 = load_robot()


STEP = 12


@pytest.fixture(scope="module")
def page(few_students, tmp_path_factory):
    output = tmp_path_factory.mktemp("page") / "run"
    where = ["--source", str(few_students), "--output", str(output)]
    asked = ["--policy", "linear", "--step", str(STEP), "--by", "0.004", "--survey", "4"]
    main(["explain", "counterfactual", *asked, "--n-steps", "40", *where])
    return output / "index.html"


def test_page_needs_nothing_from_elsewhere(page, embedded):
    text = page.read_text()
    head = text[: text.index('id="replay-page"')]
    assert "https://" not in head and "http://" not in head
    assert "<script src" not in text
    assert "given the other observation" in embedded(page, "replay-page")


def test_page_asks_in_words_and_lists_what_would_differ(page):
    text = page.read_text()
    assert f"Why did FR calf not stretch more at step {STEP}?" in text
    assert "The nearest observation" in text and "The fewest changes" in text
    nearest = pd.read_csv(page.parent / "nearest.csv")
    fewest = pd.read_csv(page.parent / "fewest.csv")
    assert len(fewest) in (1, 2) and len(nearest) >= len(fewest)
    for row in nearest.itertuples():
        assert row.observation in html.unescape(text)
    np.testing.assert_allclose(nearest["would be"] - nearest["was"], nearest["difference"])


def test_page_says_by_how_much_the_target_changes_as_it_was_asked(page):
    text = html.unescape(page.read_text())
    assert "to fall by" not in text and "to rise by 0.004 rad" in text
    assert "target that the policy asks for then changes by +0.00400 rad." in text
    assert "The target changed by +0.00400 rad;" in text


def test_the_replayed_robot_is_asked_for_what_was_answered(page):
    metrics = json.loads((page.parent / "metrics.json").read_text())
    nearest, outcome = metrics["nearest"], metrics["outcome"]
    assert nearest["change_of_target"] == pytest.approx(0.004)
    assert outcome["target"] == pytest.approx(nearest["change_of_target"], abs=1e-9)
    assert outcome["joint"] > 0
    assert 0 < outcome["after"] <= 0.2
    survey = pd.read_csv(page.parent / "survey.csv")
    assert len(survey) == 4
    assert set(survey["joint"]) <= set(quadruped.JOINTS)
    assert (survey["by"].abs() == 0.004).all()


def test_what_comes_before_the_moment_is_the_same(few_students, tmp_path, monkeypatch):
    kept = []

    def keep(left, right, path, **_):
        kept.extend((left, right))
        path.write_text("")

    monkeypatch.setattr(
        "glassgait.studies.explanation.counterfactuals.command.save_pair_replay", keep
    )
    where = ["--source", str(few_students), "--output", str(tmp_path / "run")]
    asked = ["--policy", "linear", "--step", str(STEP), "--by", "-0.01", "--lasting", "3"]
    main(["explain", "counterfactual", *asked, "--n-steps", "40", *where])
    was, would_be = (own.rollout for own in kept)
    moment = min(STEP, BEFORE)
    for port in ("observations", "state"):
        np.testing.assert_array_equal(was[port][: moment + 1], would_be[port][: moment + 1])
        assert (was[port][moment + 1] != would_be[port][moment + 1]).any()
    joint = quadruped.joint_index("FR_calf")
    np.testing.assert_array_equal(was["actions"][:moment], would_be["actions"][:moment])
    change = A1.action_scale * (would_be["actions"] - was["actions"])[moment, joint]
    assert change == pytest.approx(-0.01)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--by", "40"], "the most that was found is"),
        (["--by", "0"], "by is 0; give 1e-6 rad or more"),
        (["--step", "-1"], "step is -1; it must be"),
        (["--joint", "FL_knee"], "unknown joint 'FL_knee'"),
        (["--policy", "expert"], "a network is not searched"),
        (["--policy", "open_loop"], "kind 'open_loop' cannot be searched"),
        (["--lasting", "0"], "lasting is 0; it must be"),
        (["--gait", "gallop"], "gallop"),
    ],
)
def test_bad_input_is_refused(few_students, tmp_path, refused, arguments, message):
    short = ["--step", "3", "--n-steps", "5"]
    policy = [] if "--policy" in arguments else ["--policy", "linear"]
    where = ["--source", str(few_students), "--output", str(tmp_path / "sparse_formula")]
    assert message in refused(["explain", "counterfactual", *policy, *short, *arguments, *where])
    assert not (tmp_path / "sparse_formula").exists()

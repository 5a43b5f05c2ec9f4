"""Two policies side by side: their lines, their targets, and one replay of both."""

import json
import time
from dataclasses import replace

import numpy as np
import pytest

from glassgait.diagrams.rollout import Rollout
from glassgait.diagrams.scenario import Scenario
from glassgait.models.policies.library import load_student
from glassgait.models.policies.linear import LinearPolicy
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.models.robots import quadruped
from glassgait.models.robots.library import load_robot
from glassgait.models.task.gait import load_gait
from glassgait.studies.cli import main
from glassgait.studies.common.figures import save_figure
from glassgait.studies.common.policies import find_policies
from glassgait.studies.evaluation.pair import (
    ALL_JOINTS,
    Pair,
    TargetDifference,
    changed_lines,
    difference_figure,
    joint_table,
    line_sentence,
    only,
    target_difference,
    target_sentence,
)

SMALL = ["--n-robots", "1", "--n-steps", "20", "--n-workers", "1", "--replay-steps", "10"]
SMALL += ["--scenario", "training"]


@pytest.fixture
def edited(tmp_path):
    """A file of the shipped page in which one number is another."""
    page = load_student("trot", "sparse_formula")
    assert isinstance(page, FormulaPolicy)
    path = tmp_path / "edited.formulas"
    path.write_text(page.to_text().replace("FL_hip = 0.324 ", "FL_hip = 0.424 "))
    return path


def pair(*names):
    gait = load_gait("trot")
    return Pair(gait, find_policies(gait).controllers(map(str, names)), Scenario())


def test_one_edited_number_is_one_changed_line(edited):
    both = pair("sparse_formula", edited)
    lines = changed_lines(both)
    assert lines is not None
    assert lines[:2] == ["--- A: Page of formulas", "+++ B: edited"]
    assert (only(lines, "-"), only(lines, "+")) == (1, 1)
    changed = [line for line in lines[2:] if line[0] in "+-"]
    assert [line[:15] for line in changed] == ["-FL_hip = 0.324", "+FL_hip = 0.424"]
    assert "A alone: 1, of B alone: 1" in line_sentence(both, lines)


def test_policies_that_are_no_text_have_no_lines():
    both = pair("sparse_formula", "gbm")
    assert changed_lines(both) is None
    assert "B is of the kind" in line_sentence(both, None)


def constant(names, joint, value):
    """A policy that moves one joint's target (rad) off the default stance, and no other."""
    bias = np.zeros(quadruped.N_JOINTS)
    bias[quadruped.JOINTS.index(joint)] = value / load_robot().action_scale
    return LinearPolicy("trot", names, np.zeros((quadruped.N_JOINTS, len(names))), bias)


@pytest.fixture
def still(expert):
    """A rollout of 5 instants in which nothing is observed."""
    n = len(expert.observation_names)
    return Rollout(0.02 * np.arange(5), {"observations": np.zeros((5, n))})


def test_differences_are_of_targets_in_rad(expert, still):
    names = expert.observation_names
    a, b = constant(names, "FL_hip", 0.1), constant(names, "RR_calf", -0.3)
    table = joint_table(target_difference(still, a, b)).set_index("joint")
    assert table.index.tolist() == [*quadruped.JOINTS, ALL_JOINTS]
    assert table.loc["FL_hip", ["rms", "largest"]].tolist() == pytest.approx([0.1, 0.1])
    assert table.loc["RR_calf", ["rms", "largest"]].tolist() == pytest.approx([0.3, 0.3])
    assert table.loc["FR_hip", "rms"] == 0.0
    assert table.loc[ALL_JOINTS, "rms"] == pytest.approx(np.sqrt((0.1**2 + 0.3**2) / 12))
    message = target_sentence(table.reset_index())
    assert "most by 0.3 rad, of RR_calf at 0.00 s" in message


def test_the_largest_difference_has_its_time():
    values = np.zeros((4, quadruped.N_JOINTS))
    values[2, 5], values[1, 5] = -0.4, 0.2
    table = joint_table(TargetDifference(0.02 * np.arange(4), values)).set_index("joint")
    for row in ("FR_calf", ALL_JOINTS):
        assert table.loc[row, ["largest", "time"]].tolist() == [0.4, 0.04]
    assert table.loc["FR_calf", "rms"] == pytest.approx(np.sqrt((0.16 + 0.04) / 4))


def test_targets_that_are_not_finite_are_reported_and_left_out(expert, still, capsys, tmp_path):
    names = expert.observation_names

    class Lost(LinearPolicy):
        def __call__(self, observation):
            action = super().__call__(observation)
            action[3:, 1] = np.inf
            action[:, 2] = np.nan
            return action

    base = constant(names, "FL_thigh", 0.2)
    lost = Lost("trot", names, base.weights, base.intercepts)
    difference = target_difference(still, constant(names, "FL_hip", 0.0), lost)
    assert "a target of FL_calf is not finite at control step 0" in capsys.readouterr().out
    table = joint_table(difference).set_index("joint")
    assert table.loc["FL_thigh", "rms"] == pytest.approx(0.2)
    assert table.loc["FL_calf"].isna().all()
    assert "of FL_thigh at" in target_sentence(table.reset_index())
    save_figure(difference_figure(difference, "$\\frac{"), tmp_path / "targets", ("png",))
    nowhere = replace(difference, values=np.full_like(difference.values, np.nan))
    assert target_sentence(joint_table(nowhere)) == "no difference of targets is finite"


def test_the_figure_is_white_where_targets_agree():
    values = np.zeros((4, quadruped.N_JOINTS))
    picture = difference_figure(TargetDifference(0.02 * np.arange(4), values), "").axes[0].images[0]
    assert picture.get_clim() == (-1.0, 1.0)
    values[1, 2] = -0.25
    axes = difference_figure(TargetDifference(0.02 * np.arange(4), values), "").axes[0]
    assert axes.images[0].get_clim() == (-0.25, 0.25)
    assert [label.get_text() for label in axes.get_yticklabels()][:3] == [
        "FL hip", "FL thigh", "FL calf",
    ]  # fmt: skip
    assert axes.get_xlim() == (0.0, pytest.approx(0.08))


def test_command_writes_lines_targets_and_replay(edited, tmp_path):
    folder = tmp_path / "run"
    policies = ["--policy", "sparse_formula", str(edited)]
    main(["evaluate", "worlds", *policies, *SMALL, "--output", str(folder)])
    metrics = json.loads((folder / "metrics.json").read_text())
    assert metrics["lines"] == {"only_a": 1, "only_b": 1}
    assert metrics["policies"] == {"A": "sparse_formula", "B": "edited"}
    joints = {row["joint"]: row["rms"] for row in metrics["targets"]}
    # It stands in the formula of one state; in the other the mirror image's joint has it.
    assert 0.0 < joints["FL_hip"] < 0.1
    assert joints["FL_hip"] ** 2 + joints["FR_hip"] ** 2 == pytest.approx(0.1**2)
    assert joints["FL_calf"] == pytest.approx(0.0, abs=1e-9)
    assert metrics["worlds"][1]["share_ci"] is None
    assert "+FL_hip = 0.424 " in (folder / "lines.diff").read_text()
    page = (folder / "replay.html").read_text()
    assert "A: Page of formulas" in page and "B: edited" in page


def test_the_same_file_twice_says_and_asks_the_same(tmp_path):
    copy = load_student("trot", "sparse_formula")
    copy.save(tmp_path / "sparse_formula.formulas")
    both = pair("sparse_formula", tmp_path / "sparse_formula.formulas")
    assert changed_lines(both) == []
    report = both.report(10, 0)
    assert {row["rms"] for row in report.metrics["targets"]} == {0.0}
    assert "lines.diff" not in report.files


def test_a_robot_that_falls_is_said_to(expert, tmp_path):
    path, folder = tmp_path / "lying.safetensors", tmp_path / "run"
    constant(expert.observation_names, "FL_thigh", 1.5).save(path)
    longer = [*SMALL, "--replay-steps", "75", "--output", str(folder)]
    main(["evaluate", "worlds", "--policy", "expert", str(path), *longer])
    walks = json.loads((folder / "metrics.json").read_text())["walks"]
    assert walks["A"] == {"fell": False, "seconds": 1.5}
    assert walks["B"]["fell"]
    caption = f"B: lying, fell after {walks['B']['seconds']:.2f} s<"
    assert caption in (folder / "replay.html").read_text()


@pytest.mark.slow
def test_both_robots_are_in_the_page_in_their_colors_and_move(browser, tmp_path):
    folder = tmp_path / "run"
    main(
        [
            "evaluate",
            "worlds",
            "--policy",
            "statewise_symbolic",
            "sparse_formula",
            *SMALL,
            "--replay-steps",
            "100",
            "--output",
            str(folder),
        ]
    )
    browser.set_window_size(480, 400)
    browser.get((folder / "replay.html").as_uri())
    legend = browser.find_element("id", "legend").text
    assert "A: Symbolic per RM state" in legend and "B: Page of formulas" in legend
    for name, side in (("A", 0.5), ("B", -0.5)):
        start, colors = shown_at(browser, name, 0.0)
        assert start == pytest.approx([0.0, side], abs=0.02)
        (forward, _), _ = shown_at(browser, name, 2.0)
        assert forward > 0.5
        red_over_blue = [int(color[:2], 16) > int(color[4:], 16) for color in colors]
        assert red_over_blue == [name == "B"] * len(colors)


def shown_at(browser, name, instant):
    """Returns where the page shows a robot's trunk at an instant (m), and its parts' colours."""
    script = (
        "const path = ['drake', 'visualizer', arguments[0], 'a1', 'trunk'], found = [];"
        "const trunk = viewer.scene_tree.find(path).object;"
        "viewer.animator.pause(); viewer.animator.seek(arguments[1]);"
        "trunk.traverse(part => part.material && found.push(part.material.color.getHexString()));"
        "return [trunk.matrix.elements.slice(12, 14), found];"
    )
    # The animation starts by itself once the page has loaded, whenever that is.
    before = None
    for _ in range(100):
        shown = browser.execute_script(script, name, instant)
        if shown == before:
            return shown
        before = shown
        time.sleep(0.5)
    raise AssertionError("the replay does not stand still")

"""Two policies side by side: lines, targets, scores, and the replay of both robots."""

import json
import time
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from glassgait.diagrams.rollout import Rollout
from glassgait.models.policies.library import load_student, policy_path
from glassgait.models.policies.linear import LinearPolicy
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.models.robots import quadruped, robot
from glassgait.studies.cli import main
from glassgait.studies.common.figures import save_figure
from glassgait.studies.common.rollouts.scores import SCORES
from glassgait.studies.evaluation.compare.figures import difference_figure
from glassgait.studies.evaluation.compare.lines import changed_lines, told_changes
from glassgait.studies.evaluation.compare.scores import readable_scores, score_table
from glassgait.studies.evaluation.compare.sides import find_side
from glassgait.studies.evaluation.compare.targets import (
    ALL_JOINTS,
    TargetDifference,
    joint_table,
    target_difference,
    told_differences,
)

SMALL = ["--n-robots", "2", "--n-steps", "20", "--n-workers", "1", "--seconds", "0.2"]

WRITTEN = {"config.yaml", "metrics.json", "rollouts", "replay.html"}
WRITTEN |= {f"targets.{kind}" for kind in ("csv", "md", "png", "pdf")}
WRITTEN |= {f"scores.{kind}" for kind in ("csv", "md")}


@pytest.fixture
def edited(tmp_path):
    """The shipped page, and a file of it where one number is another."""
    page = load_student("trot", "sparse_formula")
    assert isinstance(page, FormulaPolicy)
    path = tmp_path / "edited.formulas"
    path.write_text(page.to_text().replace("FL_hip = 0.0152", "FL_hip = 0.1152"))
    return path


def sides(expert, *names):
    return [
        find_side(letter, str(name), expert, None)
        for letter, name in zip("AB", names, strict=False)
    ]


def test_one_edited_number_is_one_changed_line(expert, edited):
    a, b = sides(expert, "sparse_formula", edited)
    changes = changed_lines(a, b)
    assert changes is not None
    assert changes.lines[:2] == ("--- A: Page of formulas", "+++ B: edited.formulas")
    assert (changes.only_a, changes.only_b) == (1, 1)
    changed = [line for line in changes.lines[2:] if line[0] in "+-"]
    assert [line[:16] for line in changed] == ["-FL_hip = 0.0152", "+FL_hip = 0.1152"]
    assert told_changes(a, b, changes) == "lines of A alone: 1, of B alone: 1"
    styles = [str(line.style) for line in changes.colored()]
    assert {"green", "red", "cyan"} <= set(styles)
    assert styles[:2] == ["bold", "bold"]


def test_files_that_say_the_same_have_no_changes(expert):
    a, b = sides(expert, "sparse_formula", "sparse_formula")
    changes = changed_lines(a, b)
    assert changes is not None
    assert not changes.lines and not changes.colored()
    assert told_changes(a, b, changes) == "the files say the same"


def test_what_is_no_text_is_told(expert):
    a, b = sides(expert, "sparse_formula", "gbm")
    assert changed_lines(a, b) is None
    told = told_changes(a, b, None)
    assert told.startswith("there is no text to compare: B is of the kind ")
    assert "A is" not in told


def test_a_neural_policy_observes_by_its_own_estimator(expert, other_expert, tmp_path):
    path = tmp_path / "other.safetensors"
    other_expert.save(path)
    a, b = sides(expert, "expert", path)
    assert a.walker.expert is expert
    assert b.walker.expert is b.policy
    assert b.walker.student is None
    (student,) = sides(expert, "gbm")
    assert student.walker.expert is expert
    assert "expert" not in student.walker.policies


def constant(names, joint, value):
    """A policy that moves one joint's target (rad) off the default stance, and no other."""
    bias = np.zeros(quadruped.N_JOINTS)
    bias[quadruped.JOINTS.index(joint)] = value / robot.ACTION_SCALE
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
    told = told_differences(table.reset_index())
    assert "most by 0.3 rad, of RR_calf at 0.00 s" in told


def test_the_largest_difference_has_its_time():
    values = np.zeros((4, quadruped.N_JOINTS))
    values[2, 5], values[1, 5] = -0.4, 0.2
    table = joint_table(TargetDifference(0.02 * np.arange(4), values)).set_index("joint")
    for row in ("FR_calf", ALL_JOINTS):
        assert table.loc[row, ["largest", "time"]].tolist() == [0.4, 0.04]
    assert table.loc["FR_calf", "rms"] == pytest.approx(np.sqrt((0.16 + 0.04) / 4))


def test_targets_that_are_not_finite_are_told_and_left_out(expert, still, capsys, tmp_path):
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
    assert "of FL_thigh at" in told_differences(table.reset_index())
    save_figure(difference_figure(difference, "$\\frac{"), tmp_path / "targets", ("png",))
    nowhere = replace(difference, values=np.full_like(difference.values, np.nan))
    assert told_differences(joint_table(nowhere)) == "no difference of targets is finite"


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


def test_b_is_set_against_a_in_the_same_world_robot_by_robot(expert):
    rows = []
    for world, lost in (("training", 1.0), ("icy", 4.0)):
        for robot_index in range(3):
            for letter in "AB":
                reward = 10.0 * (robot_index + 1) - (lost if letter == "B" else 0.0)
                row = dict.fromkeys(SCORES, 1.0) | {"policy": letter, "scenario": world}
                rows.append(row | {"robot": robot_index, "fell": False, "reward": reward})
    table = score_table(pd.DataFrame(rows), {"training": "home", "icy": "ice"})
    assert table[["world", "policy"]].to_numpy().tolist() == [
        ["home", "A"], ["home", "B"], ["ice", "A"], ["ice", "B"],
    ]  # fmt: skip
    assert table["share"].tolist() == pytest.approx([1.0, 19 / 20, 1.0, 16 / 20])
    # All robots lose as much: far less is unknown than if they were not compared one by one.
    assert table.loc[1, "share_ci"] < 0.1 * table.loc[1, "reward_ci"] / 20
    readable = readable_scores(table, sides(expert, "sparse_formula", "sparse_formula"))
    assert readable["policy"].tolist() == ["A: Page of formulas", "B: Page of formulas"] * 2


def test_command_writes_lines_targets_scores_and_replay(edited, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    worlds = ["--worlds", "training", "friction_0.5"]
    main(["evaluate", "compare", "sparse_formula", str(edited), *SMALL, *worlds])
    folder = tmp_path / "runs" / "compare" / "trot" / "page_edited"
    written = {path.name for path in folder.iterdir() if not path.name.startswith(".")}
    assert written == WRITTEN | {"lines.diff"}
    metrics = json.loads((folder / "metrics.json").read_text())
    assert metrics["lines"] == {"only_a": 1, "only_b": 1}
    assert metrics["policies"] == {"A": "sparse_formula", "B": str(edited)}
    joints = {row["joint"]: row["rms"] for row in metrics["targets"]}
    # It stands in the formula of one state; in the other the mirror image's joint has it.
    assert 0.0 < joints["FL_hip"] < 0.1
    assert joints["FL_hip"] ** 2 + joints["FR_hip"] ** 2 == pytest.approx(0.1**2)
    assert joints["FL_calf"] == pytest.approx(0.0, abs=1e-9)
    assert len(metrics["scores"]) == 4
    assert metrics["walks"] == {side: {"fell": False, "seconds": 0.2} for side in "AB"}
    told = capsys.readouterr().out
    assert "+FL_hip = 0.1152" in told
    page = (folder / "replay.html").read_text()
    assert "A: Page of formulas" in page and "B: edited.formulas" in page


def test_a_policy_beside_itself_is_the_same(tmp_path, capsys):
    folder = tmp_path / "run"
    main(["evaluate", "compare", "gbm", "gbm", *SMALL, "--output", str(folder)])
    metrics = json.loads((folder / "metrics.json").read_text())
    assert metrics["lines"] is None
    assert {row["rms"] for row in metrics["targets"]} == {0.0}
    a, b = metrics["scores"]
    assert {**a, "policy": "B"} == b
    assert b["share"] == 1.0
    assert "there is no text to compare" in capsys.readouterr().out
    written = {path.name for path in folder.iterdir() if not path.name.startswith(".")}
    assert written == WRITTEN


def test_a_robot_that_falls_is_said_to(expert, tmp_path):
    path, folder = tmp_path / "lying.safetensors", tmp_path / "run"
    constant(expert.observation_names, "FL_calf", 2.0).save(path)
    longer = [*SMALL, "--seconds", "1.5", "--output", str(folder)]
    main(["evaluate", "compare", "expert", str(path), *longer])
    walks = json.loads((folder / "metrics.json").read_text())["walks"]
    assert walks["A"] == {"fell": False, "seconds": 1.5}
    assert walks["B"]["fell"]
    told = f"B: lying.safetensors, fell after {walks['B']['seconds']:.2f} s<"
    assert told in (folder / "replay.html").read_text()


def test_one_robot_has_no_interval_and_resume_gives_the_same(tmp_path, refused):
    folder = tmp_path / "run"
    alone = [
        "compare",
        "sparse_formula",
        "expert",
        *SMALL,
        "--n-robots",
        "1",
        "--output",
        str(folder),
    ]
    main(alone)
    before = (folder / "metrics.json").read_bytes()
    assert json.loads(before)["scores"][1]["share_ci"] is None
    assert "continue it with --resume" in refused(alone)
    (folder / "metrics.json").unlink()
    main([*alone, "--resume"])
    assert (folder / "metrics.json").read_bytes() == before
    swapped = ["evaluate", "compare", "expert", "sparse_formula", *alone[3:], "--resume"]
    assert "was made with" in refused(swapped)


def test_refuses_what_it_cannot_compare(refused, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert "unknown policy 'oracle'" in refused(["evaluate", "compare", "oracle", "sparse_formula"])
    assert "unknown policy 'oracle'" in refused(["evaluate", "compare", "sparse_formula", "oracle"])
    assert "no student 'sparse_formula' of the three_one" in refused(
        ["evaluate", "compare", "--gait", "three_one"]
    )
    other = str(policy_path(tmp_path, "none"))
    assert "none" in refused(["evaluate", "compare", "sparse_formula", other])
    assert "unknown scenario 'mars'" in refused(["evaluate", "compare", "--worlds", "mars"])
    mujoco = ["evaluate", "compare", "--worlds", "mujoco", "training"]
    assert "targets and replay are of the first scenario" in refused(mujoco)
    (tmp_path / "steered.yaml").write_text("command: {sliders: true}\n")
    assert "command is of sliders" in refused(["evaluate", "compare", "--worlds", "steered.yaml"])
    assert "the range of gait 'trot'" in refused(["evaluate", "compare", "--command.speed", "9"])
    assert "seconds is 0.0" in refused(["evaluate", "compare", "--seconds", "0"])
    assert "n_robots is 0" in refused(["evaluate", "compare", "--n-robots", "0"])
    assert not (tmp_path / "runs").exists()


@pytest.mark.slow
def test_both_robots_are_in_the_page_in_their_colors_and_move(browser, tmp_path):
    folder = tmp_path / "run"
    main(["evaluate", "compare", *SMALL, "--seconds", "2", "--output", str(folder)])
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

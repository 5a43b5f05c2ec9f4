"""Gaits that change while walking: what is rolled out, how it is scored, and the command."""

import json

import numpy as np
import pandas as pd
import pytest
from matplotlib.patches import Rectangle

from glassgait.studies.cli import main
from glassgait.studies.evaluation.transition_rollouts import Requests, settled_from
from glassgait.studies.evaluation.transitions import (
    Transitions,
    in_order,
    path_of,
    summary_table,
    transition_figure,
    transition_table,
)

GAITS = ("trot", "pace", "walk")
TITLES = {"training": "home"}


def cases(**settings):
    return Transitions(gait=GAITS, speeds=(0.4, 0.3), **settings).cases()


def paths(**settings):
    """Names the gaits of every path, of robots of the first speed."""
    listed = [own for own in cases(**settings) if own.labels["speed"] == 0.4]
    return {" ".join(own.gait.name for own in path_of(case)) for case in listed}


def test_every_gait_goes_to_every_other_at_every_speed():
    assert [own.labels["speed"] for own in cases()] == [0.4, 0.3] * 9
    pairs = {"trot pace", "trot walk", "pace trot", "pace walk", "walk trot", "walk pace"}
    assert paths() == {*GAITS} | pairs


def test_a_gait_on_the_way_lies_between_others_alone():
    pairs = {"trot pace", "trot walk", "pace trot", "pace trot walk", "walk trot", "walk trot pace"}
    assert paths(via="trot") == {*GAITS} | pairs


def test_cases_of_another_way_have_digests_of_their_own():
    first, other = (
        {(case.name, case.digest()) for case in cases(**settings)}
        for settings in ({}, {"via": "trot"})
    )
    # To the gait on the way there is no other.
    assert {name.split("_")[3] for name, _ in first & other} == {"trot"}
    assert len(first & other) == 6


def test_robots_that_never_change_come_first_of_each_speed():
    labels = [own.labels for own in cases()]
    robots = pd.DataFrame(labels).rename(columns={"gait": "from"}).assign(robot=0)
    ordered = in_order(robots)
    assert ordered["speed"].tolist() == [0.4] * 9 + [0.3] * 9
    assert (ordered["from"] == ordered["to"]).tolist() == 2 * ([True] * 3 + [False] * 6)
    assert ordered.columns.tolist() == ["policy", "scenario", "from", "to", "speed", "robot"]


def test_the_rhythm_is_kept_from_the_first_whole_cycle_on_that_is_in_time():
    served = np.zeros(80)
    # Of two states of 8 steps each: the first is 7 late, the others a step or none.
    served[[10, 25, 34, 42, 50]] = 8.0
    assert settled_from(served, start=10, n_states=2) == 25
    assert settled_from(served, start=25, n_states=2) == 25
    # What the gait before earned at the change is not the new one's.
    served[40] = 8.0
    assert settled_from(served[:30], start=10, n_states=2) is None
    late = np.zeros(80)
    late[[10, 25, 40, 55, 70]] = 8.0
    assert settled_from(late, start=10, n_states=2) is None


def test_gaits_of_a_path_are_requested_one_after_the_other():
    requests = Requests(np.array([5, 8]), last=2)
    running, slow = np.array([0, 0]), []
    for step in range(120):
        requests.advance(step, running)
        slow.append(requests.on_the_way(step, running))
        # The first robot changes at once, the other one waits for 10 steps on its way.
        after = np.where([True, step >= 18], requests.number, running)
        requests.note(step, running, after)
        running = after
    assert running.tolist() == [2, 2]
    # A second after the robot came to the gait on the way, and it came at the end of a step.
    assert requests.asked.tolist() == [5 + 1 + 50, 18 + 1 + 50]
    first, last = np.flatnonzero(np.array(slow)[:, 1])[[0, -1]]
    assert (first, last) == (8, 69 + 50)


def test_robots_of_one_gait_are_asked_for_nothing():
    requests = Requests(np.array([5]), last=0)
    for step in range(10):
        requests.advance(step, np.array([0]))
        assert not requests.on_the_way(step, np.array([0])).any()
    assert (requests.number.tolist(), requests.asked.tolist()) == ([0], [5])


@pytest.fixture
def table():
    rows = []
    for policy, speed in (("expert", 0.3), ("expert", 0.5)):
        for source in ("trot", "walk"):
            for target in ("trot", "walk"):
                fallen = 3 if (source, target, speed) == ("trot", "walk", 0.5) else 0
                for robot in range(10):
                    fell = robot < fallen
                    row = {"policy": policy, "scenario": "training", "from": source, "to": target}
                    row |= {"speed": speed, "robot": robot, "fell": fell, "before": robot == 0}
                    row["before"] = fell and robot == 0
                    row |= {"wait": 0.02 * robot, "settling": np.nan if fell else 0.1}
                    row["reward"] = 0.0 if fell else 4.0 if source == target else 3.0
                    rows.append(row)
    return transition_table(pd.DataFrame(rows))


def test_tables_sum_up_every_pair_beside_robots_that_never_change(table):
    assert len(table) == 8
    row = table[(table["from"] == "trot") & (table["to"] == "walk") & (table["speed"] == 0.5)]
    (row,) = row.to_dict("records")
    assert (row["robots"], row["falls"], row["before"], row["unsettled"]) == (10, 3, 1, 3)
    assert row["wait"] == pytest.approx(0.09)
    assert row["longest_wait"] == pytest.approx(0.18)
    assert row["settling"] == pytest.approx(0.1)
    assert row["share"] == pytest.approx(0.7 * 3.0 / 4.0)
    stayed = table[table["from"] == table["to"]]
    assert stayed["share"].tolist() == [1.0] * 4


def test_the_summary_names_the_pairs_that_fall(table):
    (row,) = summary_table(table, TITLES).to_dict("records")
    assert row["pairs without a fall"] == "1 of 2"
    assert row["falls"] == "3 of 40"
    assert row["falls from, to"] == "trot to walk 3"


def test_the_figure_has_a_matrix_of_every_speed(table):
    figure = transition_figure(table, TITLES)
    panels = [axes for axes in figure.axes if axes.get_title()]
    assert [axes.get_title() for axes in panels] == ["0.3 m/s", "0.5 m/s"]
    texts = [[text.get_text() for text in axes.texts] for axes in panels]
    assert texts == [["·"] * 4, ["·", "3", "·", "·"]]
    # The row is the gait before, the column the one after.
    (at,) = [text.get_position() for text in panels[1].texts if text.get_text() == "3"]
    labels = [label.get_text() for label in panels[1].get_xticklabels()]
    assert (labels[at[0]], labels[at[1]]) == ("walk", "trot")
    assert sum(isinstance(patch, Rectangle) for patch in panels[0].patches) == 6


@pytest.mark.slow
def test_the_command_rolls_out_writes_and_resumes(tmp_path, monkeypatch, capsys):
    short = {"FIRST_STEPS": 60, "AFTER_STEPS": 120, "SCORED_STEPS": 40, "SPREAD_STEPS": 10}
    for name, value in short.items():
        monkeypatch.setattr(f"glassgait.studies.evaluation.transition_rollouts.{name}", value)
    command = [
        "evaluate",
        "transitions",
        "--gait",
        "trot",
        "pace",
        "--speeds",
        "0.4",
        "--n-robots",
        "2",
    ]
    command += ["--n-workers", "1", "--output", str(tmp_path / "run")]
    main(command)
    written = {path.name for path in (tmp_path / "run").iterdir() if path.name[0] != "."}
    tables = {f"{name}.{end}" for name in ("robots", "transitions") for end in ("csv", "md")}
    figures = {"transitions.png", "transitions.pdf"}
    assert written == {"config.yaml", "metrics.json", "cases"} | tables | figures
    rows = json.loads((tmp_path / "run" / "metrics.json").read_text())
    assert [(row["from"], row["to"]) for row in rows] == [
        ("trot", "trot"),
        ("pace", "pace"),
        ("trot", "pace"),
        ("pace", "trot"),
    ]
    # Half a cycle is 11 steps at most.
    assert all(0.0 <= row["longest_wait"] <= 0.3 and row["falls"] == 0 for row in rows)
    before = (tmp_path / "run" / "robots.csv").read_bytes()
    kept = sorted((tmp_path / "run" / "cases").iterdir())
    kept[0].unlink()
    main([*command, "--resume"])
    assert (tmp_path / "run" / "robots.csv").read_bytes() == before
    assert sorted((tmp_path / "run" / "cases").iterdir()) == kept
    assert "2 of 2" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "reported"),
    [
        (["--gait", "trot"], "--gait"),
        (["--gait", "trot", "gallop"], "unknown gait 'gallop'"),
        (["--speeds", "0.8"], "range of gait 'walk trot pace bound'"),
        (["--speeds", "0.3", "0.3"], "names nothing twice"),
        (["--via", "gallop"], "unknown gait 'gallop'"),
        (["--policy", "symbolic"], "--policy 'symbolic'"),
        (["--scenario", "cenic_1e-5"], "is continuous"),
        (["--patience", "-1"], "patience is -1.0; it must be 0 or more"),
        (["--slowdown", "0"], "slowdown is 0.0; it must be more than 0"),
        (["--n-robots", "0"], "n_robots is 0"),
    ],
)
def test_what_cannot_be_rolled_out_is_refused(refused, tmp_path, monkeypatch, arguments, reported):
    monkeypatch.chdir(tmp_path)
    assert reported in refused(["evaluate", "transitions", *arguments])
    assert not list(tmp_path.iterdir())

"""Who falls where: intervals, the order of the worlds, the map, and the command."""

import json

import numpy as np
import pandas as pd
import pytest

from glassgait.studies.cli import main
from glassgait.studies.common.scores import SCORES, wilson_interval
from glassgait.studies.distillation.linear import untrained_student
from glassgait.studies.evaluation.figures import fall_map
from glassgait.studies.evaluation.scenarios import Scenarios
from glassgait.studies.evaluation.tables import fall_table, worst_first

WORLDS = {"nominal": "home", "icy": "ice", "late": "delay", "calm": "calm"}


def scores_of(falls, robots=10):
    """Makes scores from the falls of each policy in each world; fallen robots earn half."""
    rows = []
    for (policy, world), fallen in falls.items():
        count = 1 if world == "late" else robots
        for robot in range(count):
            row = dict.fromkeys(SCORES, 1.0) | {"policy": policy, "scenario": world}
            fell = robot < fallen
            row |= {"robot": robot, "fell": fell, "return": (5.0 if fell else 10.0) + robot}
            rows.append(row)
    return pd.DataFrame(rows)


@pytest.fixture
def table():
    # In the order of jobs, where the slow worlds come first and the expert is not first everywhere.
    falls = {("linear", "late"): 1, ("expert", "late"): 0, ("gbm", "late"): 0}
    falls |= {("expert", "nominal"): 0, ("linear", "nominal"): 0, ("gbm", "nominal"): 0}
    falls |= {("expert", "icy"): 2, ("linear", "icy"): 8, ("gbm", "icy"): 3}
    falls |= {("expert", "calm"): 0, ("linear", "calm"): 0, ("gbm", "calm"): 0}
    return fall_table(scores_of(falls), WORLDS)


@pytest.mark.parametrize(("falls", "robots"), [(0, 26), (1, 26), (13, 26), (26, 26), (1, 1)])
def test_intervals_of_falls_are_wilsons(falls, robots):
    share = falls / robots
    low, high = wilson_interval(falls, robots)
    # A share at an end would be just as far from what was seen as chance allows in 95 of 100.
    for end in (low, high):
        reach = 1.959964 * np.sqrt(end * (1 - end) / robots)
        assert abs(share - end) == pytest.approx(reach, abs=1e-6)
    assert 0.0 <= low < high <= 1.0


def test_worlds_are_ordered_worst_first_and_policies_expert_first(table):
    # Worlds without a fall stay in the order that they were named in.
    assert table["scenario"].unique().tolist() == ["icy", "late", "nominal", "calm"]
    assert table["policy"].tolist() == ["expert", "linear", "gbm"] * 4
    assert worst_first(table.sample(frac=1.0, random_state=3))[:2] == ["icy", "late"]


def test_the_worst_world_is_that_where_most_of_all_robots_fall():
    falls = {("expert", "nominal"): 0, ("linear", "nominal"): 5}
    falls |= {("expert", "icy"): 2, ("linear", "icy"): 4}
    table = fall_table(scores_of(falls), WORLDS)
    assert worst_first(table) == ["icy", "nominal"]
    assert worst_first(table, {"linear"}) == ["nominal", "icy"]


def test_students_are_set_against_the_expert_in_the_same_world(table):
    row = table.set_index(["scenario", "policy"]).loc[("icy", "linear")]
    assert (row["robots"], row["falls"], row["fall_rate"]) == (10, 8, 0.8)
    assert row["points_more"] == pytest.approx(60.0)
    assert row["fall_rate_low"] < 0.8 < row["fall_rate_high"]
    # Robots of the expert earn 135 together, those of the student 105.
    assert row["share"] == pytest.approx(105 / 135)
    assert row["share_ci"] > 0.0
    experts = table[table["policy"] == "expert"]
    assert (experts["share"] == 1.0).all() and (experts["points_more"] == 0.0).all()


def test_the_map_has_a_cell_for_each_policy_and_scenario(table):
    other = table.drop(index=table.query("scenario == 'icy' and policy == 'gbm'").index)
    figure = fall_map({"trot": table, "three_one": other})
    first, second = figure.axes
    assert [axes.get_title() for axes in figure.axes] == ["trot", "three-one"]
    assert numbers_of(first) == [["2", "8", "3"], ["·", "1", "·"], ["·"] * 3, ["·"] * 3]
    labels = [label.get_text() for label in first.get_yticklabels()]
    assert labels == ["ice", "delay (1 robots)", "home", "calm"]
    # A cell that was not measured is hatched.
    hatched = [sum(bool(cell.get_hatch()) for cell in axes.patches) for axes in (first, second)]
    assert hatched == [0, 1]


def numbers_of(axes, n_columns=3):
    """Returns the texts of a map's cells, row by row."""
    texts = sorted(axes.texts, key=lambda text: text.get_position()[::-1])
    found = [text.get_text() for text in texts]
    return [found[i : i + n_columns] for i in range(0, len(found), n_columns)]


def test_policies_meet_the_same_robots_by_the_commands_of_the_scenario(tmp_path):
    (tmp_path / "own.yaml").write_text("command: {speed_range: [0.1, 0.2]}\n")
    worlds = ("nominal", "lagged_0.5ms", str(tmp_path / "own.yaml"))
    study = Scenarios(policy=("expert", "linear_per_state"), scenario=worlds, n_seeds=2)
    cases = study.cases()
    assert len(cases) == 3 * 2 * 2
    # The slow world comes first.
    assert [*cases[0].labels.values()] == ["trot", "expert", "lagged_0.5ms", 7000]
    by_policy = [
        [(own.scenario, own.seed) for own in cases if own.labels["policy"] == policy]
        for policy in ("expert", "linear_per_state")
    ]
    assert by_policy[0] == by_policy[1]


@pytest.fixture
def run(expert, tmp_path):
    """Runs the command on one small student in two worlds, one of them of a single robot."""
    source = tmp_path / "source"
    source.mkdir()
    untrained_student(expert).save(source / "linear.safetensors")
    (tmp_path / "lonely.yaml").write_text("title: lonely\nmax_robots: 1\n")
    small = ["--n-robots", "2", "--n-steps", "20", "--n-workers", "1"]
    worlds = ["--scenario", "nominal", str(tmp_path / "lonely.yaml")]
    own, folder = ["--source", str(source)], tmp_path / "run"

    def start(*more):
        main(["evaluate", "scenarios", *small, *worlds, *own, "--output", str(folder), *more])
        return folder

    return start


def test_command_writes_table_metrics_and_map(run, capsys):
    folder = run()
    written = {path.name for path in folder.iterdir()}
    both = {f"scenarios.{suffix}" for suffix in ("csv", "md", "png", "pdf")}
    assert written == {"config.yaml", "metrics.json", "cases", "robots.csv", "robots.md"} | both
    table = pd.read_csv(folder / "scenarios.csv")
    assert table[["policy", "scenario", "robots"]].to_numpy().tolist() == [
        ["expert", "nominal (SAP 10 ms)", 2],
        ["linear", "nominal (SAP 10 ms)", 2],
        ["expert", "lonely", 1],
        ["linear", "lonely", 1],
    ]
    assert table["share of the expert's return"].tolist()[::2] == [1.0, 1.0]
    # NaN is no JSON.
    json.loads((folder / "metrics.json").read_text(), parse_constant=pytest.fail)
    assert str(folder.parent / "source") in capsys.readouterr().err.splitlines()[0]


def test_falls_by_the_task_and_physical_ones_are_told_apart(run, tmp_path):
    (tmp_path / "strict.yaml").write_text("limits: {trunk_height: 0.5}\n")
    (tmp_path / "heavy.yaml").write_text("station: {payload: 60.0}\n")
    named = [str(tmp_path / f"{name}.yaml") for name in ("strict", "heavy")]
    folder = run("--policy", "linear", "--scenario", "nominal", *named, "--n-steps", "40")
    robots = pd.read_csv(folder / "robots.csv").groupby("scenario")
    assert robots["fell"].sum().to_dict() == {"nominal": 0, "strict": 2, "heavy": 2}
    assert robots["fell_physically"].sum().to_dict() == {"nominal": 0, "strict": 0, "heavy": 2}
    table = pd.read_csv(folder / "scenarios.csv").set_index("scenario")["physical falls"]
    assert table.to_dict() == {"nominal (SAP 10 ms)": 0, "strict": 0, "heavy": 2}


@pytest.mark.parametrize("arguments", [["--source", "empty"], ["--policy", "linear"]])
def test_policies_that_are_not_there_are_refused(arguments, refused, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "empty").mkdir()
    named = ["--gait", "all"] if arguments[0] == "--policy" else []
    assert arguments[0] in refused(["evaluate", "scenarios", *named, *arguments])
    assert not (tmp_path / "runs").exists()


def test_of_several_gaits_those_policies_are_measured_that_there_are(tmp_path):
    named = ["--gait", "trot", "pace", "--policy", "expert", "symbolic", "--scenario", "nominal"]
    small = ["--n-robots", "2", "--n-steps", "10", "--output", str(tmp_path / "run")]
    main(["evaluate", "scenarios", *named, *small])
    whole = pd.read_csv(tmp_path / "run" / "scenarios.csv")
    assert whole["gait"].tolist() == ["trot", "trot", "pace"]
    assert (tmp_path / "run" / "scenarios.png").exists()

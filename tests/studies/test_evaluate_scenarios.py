"""Who falls where: intervals, the order of the worlds, the map, and the command."""

import json

import numpy as np
import pandas as pd
import pytest
from matplotlib.colors import to_rgb
from matplotlib.patches import Rectangle

import glassgait.studies.common.cases
from glassgait.models.files import read_yaml
from glassgait.studies.cli import main
from glassgait.studies.common.scores import SCORES, wilson_interval
from glassgait.studies.distillation.linear import untrained_student
from glassgait.studies.evaluation.fall_map import (
    COLORS,
    fall_map,
    policies_of,
    readable_on,
    worst_first,
)
from glassgait.studies.evaluation.scenarios import (
    Scenarios,
    fall_table,
    worst_table,
)

WORLDS = {"training": "home", "icy": "ice", "late": "delay", "calm": "calm"}


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
    falls |= {("expert", "training"): 0, ("linear", "training"): 0, ("gbm", "training"): 0}
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
    assert table["scenario"].unique().tolist() == ["icy", "late", "training", "calm"]
    assert table["policy"].tolist() == ["expert", "linear", "gbm"] * 4
    assert worst_first(table.sample(frac=1.0, random_state=3))[:2] == ["icy", "late"]


def test_the_worst_world_is_that_where_most_of_all_robots_fall():
    falls = {("expert", "training"): 0, ("linear", "training"): 5}
    falls |= {("expert", "icy"): 2, ("linear", "icy"): 4}
    table = fall_table(scores_of(falls), {"training": "home", "icy": "ice"})
    assert worst_first(table) == ["icy", "training"]
    assert worst_first(table, {"linear"}) == ["training", "icy"]


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


def test_one_fallen_robot_is_no_worst_world_beside_many(table):
    worst = worst_table(table).set_index("policy")
    assert worst.loc["Linear", "its worst scenario"] == "ice"
    assert worst.loc["Linear", "falls there"] == "8 of 10"
    assert worst.loc["Linear", "points more than the expert"] == "+60"
    assert worst.loc["Linear", "scenarios without a fall"] == "2 of 4"
    assert worst["return"].notna().all()
    assert worst["falls in training scenario"].tolist() == ["0 of 10"] * 3


def test_a_policy_that_never_fell_has_no_worst_world():
    scores = scores_of({("expert", "icy"): 0})
    (row,) = worst_table(fall_table(scores, {"icy": "ice"})).to_dict(orient="records")
    assert (
        row["its worst scenario"] == row["falls there"] == row["falls in training scenario"] == "–"
    )


def cells_of(figure):
    """Returns the cells of a map, apart from the frame around the training world."""
    patches = [patch for patch in figure.axes[0].patches if isinstance(patch, Rectangle)]
    return [patch for patch in patches if patch.get_width() == 1]


def numbers_of(figure, n_columns):
    """Returns the texts of a map's cells, row by row."""
    texts = sorted(figure.axes[0].texts, key=lambda text: text.get_position()[::-1])
    message = [text.get_text() for text in texts]
    return [message[i : i + n_columns] for i in range(0, len(message), n_columns)]


def test_the_map_has_a_cell_for_each_policy_and_world(table):
    figure = fall_map(table, "trot")
    assert len(cells_of(figure)) == len(table) == 12
    assert numbers_of(figure, 3) == [["2", "8", "3"], ["·", "1", "·"], ["·"] * 3, ["·"] * 3]
    labels = [label.get_text() for label in figure.axes[0].get_yticklabels()]
    assert labels == ["ice", "delay (1 robot)", "home", "calm"]
    columns = [label.get_text() for label in figure.axes[0].get_xticklabels()]
    assert columns == ["Neural\nexpert", "Linear", "GBM"]
    expert, first, second = figure.axes[0].get_xticks()
    assert first - expert > second - first
    assert "10 robots of each policy" in figure.get_supxlabel()
    assert figure.axes[1].get_ylabel() == "share of robots that fall"


def test_the_training_world_is_marked(table):
    axes = fall_map(table, "trot").axes[0]
    weights = {label.get_text(): label.get_fontweight() for label in axes.get_yticklabels()}
    assert [name for name, weight in weights.items() if weight == "bold"] == ["home"]
    (frame,) = [patch for patch in axes.patches if patch.get_width() != 1]
    assert frame.get_y() + 0.5 == list(weights).index("home")


def test_what_was_not_rolled_out_is_hatched_and_not_white(table):
    figure = fall_map(
        table.drop(index=table.query("scenario == 'icy' and policy == 'gbm'").index), ""
    )
    (missing,) = [cell for cell in cells_of(figure) if cell.get_hatch()]
    assert max(missing.get_facecolor()[:3]) < 0.95
    assert len(cells_of(figure)) == 12
    assert "hatched: not rolled out" in figure.get_supxlabel().replace("\n", " ")
    assert "hatched" not in fall_map(table, "").get_supxlabel()


def test_numbers_stand_out_from_their_cells():
    def luminance(color):
        channels = np.array(to_rgb(color))
        linear = np.where(
            channels <= 0.04045, channels / 12.92, ((channels + 0.055) / 1.055) ** 2.4
        )
        return float(linear @ (0.2126, 0.7152, 0.0722))

    shades = [COLORS(share)[:3] for share in np.linspace(0, 1, 27)]
    brightness = [luminance(shade) for shade in shades]
    # One that sees no colours sees the order.
    assert brightness == sorted(brightness, reverse=True)
    assert brightness[0] > 0.85
    for shade, own in zip(shades, brightness, strict=True):
        pair = sorted([own + 0.05, luminance(readable_on(shade)) + 0.05])
        # As WCAG 2 asks of text.
        assert pair[1] / pair[0] >= 4.5


def test_policies_meet_the_same_robots_by_the_commands_of_the_scenario(tmp_path):
    (tmp_path / "own.yaml").write_text("command: {speed_range: [0.1, 0.2]}\n")
    worlds = ("training", "cenic_1e-5", str(tmp_path / "own.yaml"))
    study = Scenarios(policy=("expert", "statewise_linear"), scenario=worlds, n_seeds=2)
    cases = study.cases()
    assert len(cases) == 3 * 2 * 2
    # The slow world comes first.
    assert cases[0].labels == {
        "gait": "trot", "policy": "expert", "scenario": "cenic_1e-5", "seed": 1000,
    }  # fmt: skip
    by_policy = {
        policy: [
            (own.scenario, study.rollouts(own)) for own in cases if own.labels["policy"] == policy
        ]
        for policy in ("expert", "statewise_linear")
    }
    assert by_policy["expert"] == by_policy["statewise_linear"]
    assert all(study.rollouts(own).commanding(own.scenario) == own.scenario for own in cases)


@pytest.fixture
def run(expert, tmp_path):
    """Runs the command on one small student in two worlds, one of them of a single robot."""
    source = tmp_path / "source"
    source.mkdir()
    untrained_student(expert).save(source / "linear.safetensors")
    (tmp_path / "lonely.yaml").write_text("title: lonely\nmax_robots: 1\n")
    small = ["--n-robots", "2", "--n-steps", "20", "--n-workers", "1"]
    worlds = ["--scenario", "training", str(tmp_path / "lonely.yaml")]
    own, folder = ["--source", str(source)], tmp_path / "run"

    def start(*more):
        main(["evaluate", "scenarios", *small, *worlds, *own, "--output", str(folder), *more])
        return folder

    return start


def test_command_writes_table_metrics_and_map(run, capsys):
    folder = run()
    written = {path.name for path in folder.iterdir() if not path.name.startswith(".")}
    both = {
        "scenarios.csv", "scenarios.md", "scenarios.png", "scenarios.pdf",
    }  # fmt: skip
    robots = {"robots.csv", "robots.md"}
    assert written == {"config.yaml", "metrics.json", "cases"} | both | robots
    table = pd.read_csv(folder / "scenarios.csv")
    assert table[["policy", "scenario", "robots"]].to_numpy().tolist() == [
        ["Neural expert", "SAP 10 ms (training)", 2],
        ["Linear", "SAP 10 ms (training)", 2],
        ["Neural expert", "lonely", 1],
        ["Linear", "lonely", 1],
    ]
    assert table["share of the expert's return"].tolist()[::2] == [1.0, 1.0]
    metrics = json.loads((folder / "metrics.json").read_text(), parse_constant=pytest.fail)
    worlds = pd.DataFrame(metrics["scenarios"])
    assert policies_of(worlds) == ["expert", "linear"]
    # The map can be drawn anew from what the run wrote.
    assert len(cells_of(fall_map(worlds, "trot"))) == 4
    captured = capsys.readouterr()
    assert "where each falls most" in captured.out
    assert str(folder.parent / "source") in captured.err.splitlines()[0]
    record = read_yaml(folder / "config.yaml")
    assert record["inputs"]["source"] == str(folder.parent / "source")
    assert record["inputs"]["policies"].startswith("expert ")


def test_falls_by_the_task_alone_and_physical_ones_are_told_apart(run, tmp_path):
    (tmp_path / "strict.yaml").write_text("limits: {trunk_height: 0.5}\n")
    (tmp_path / "heavy.yaml").write_text("station: {payload: 60.0}\n")
    worlds = [str(tmp_path / f"{name}.yaml") for name in ("strict", "heavy")]
    folder = run("--policy", "linear", "--scenario", "training", *worlds, "--n-steps", "40")
    card = pd.read_csv(folder / "scorecard.csv").set_index("scenario")["falls"]
    assert card.to_dict() == {
        "SAP 10 ms (training)": "0 of 2",
        "strict": "2 of 2 (0 physical)",
        "heavy": "2 of 2 (2 physical)",
    }
    robots = pd.read_csv(folder / "robots.csv").groupby("scenario")["fell_physically"]
    assert robots.sum().to_dict() == {"training": 0, "strict": 0, "heavy": 2}


def test_resume_rolls_out_what_is_missing_alone(run, monkeypatch, refused):
    folder = run()
    before = (folder / "metrics.json").read_bytes()
    kept = sorted((folder / "cases").iterdir())
    assert len(kept) == 4
    kept[0].unlink()
    (folder / "metrics.json").unlink()
    rolled_out = []
    original = glassgait.studies.common.cases.roll_out
    monkeypatch.setattr(
        glassgait.studies.common.cases,
        "roll_out",
        lambda *job: rolled_out.append(job) or original(*job),
    )
    run("--resume")
    assert len(rolled_out) == 1
    assert (folder / "metrics.json").read_bytes() == before
    assert "continue it with --resume" in refused(
        ["evaluate", "scenarios", "--output", str(folder)]
    )


@pytest.mark.parametrize(
    ("arguments", "key"),
    [
        (["--policy", "nonesuch"], "--policy"),
        (["--source", "empty"], "--source"),
        (["--gait", "trot", "walk", "--source", "empty"], "--gait"),
        (["--gait", "all", "--policy", "open_loop"], "--policy"),
        (["--scenario", "mars"], "mars"),
        (["--speed-range", "0", "3"], "speed_range"),
    ],
)
def test_refuses_what_it_cannot_roll_out(arguments, key, refused, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "empty").mkdir()
    assert key in refused(["evaluate", "scenarios", *arguments])
    assert not (tmp_path / "runs").exists()


def test_of_all_gaits_those_are_measured_that_have_a_policy(monkeypatch, capsys):
    kept = []
    monkeypatch.setattr(Scenarios, "_run_one", lambda own, folder: kept.append(own.gait))
    main(["evaluate", "scenarios", "--gait", "all", "--policy", "symbolic"])
    assert kept == [("trot",)]
    main(["evaluate", "scenarios", "--gait", "trot", "walk", "--policy", "expert", "symbolic"])
    assert kept[1] == ("trot", "walk")
    assert "walk: has no policy symbolic" in capsys.readouterr().out

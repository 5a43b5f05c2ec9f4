"""The paper's own settings: what they say, what is less in a quick run, and the whole in small."""

import math
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
import yaml
from interpret.glassbox import ExplainableBoostingRegressor
from sklearn.ensemble import GradientBoostingRegressor

from glassgait.models.errors import InputError
from glassgait.models.robots.library import load_robot
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.gait import load_gait
from glassgait.studies.cli import main
from glassgait.studies.distillation.config import rounds
from glassgait.studies.distillation.students.boosting import additive_regressor, boosting_regressor
from glassgait.studies.distillation.students.symbolic_regression import pysr_starts
from glassgait.studies.reproduction import report
from glassgait.studies.reproduction.contents import WITHOUT_PYSR
from glassgait.studies.reproduction.report import Report
from glassgait.studies.reproduction.settings import differences, load_settings, settings_file

A1 = load_robot()


PAPER = settings_file("paper")


@pytest.fixture(scope="module")
def paper():
    return load_settings(Report, PAPER)


@pytest.fixture
def small(tmp_path):
    """A copy of the paper's settings of which a quick run takes seconds."""
    values = yaml.safe_load(PAPER.read_text())
    values["quick"] = {
        "gait": ["trot"],
        "training": {
            "n_robots": 16,
            "updates": 2,
            "ppo": {"steps_per_update": 4, "actor_layers": [8], "critic_layers": [8]},
        },
        "distillation": {
            "episodes": 6,
            "episodes_per_round": 2,
            "episode_steps": 20,
            "settings": {
                "gbm": {"n_trees": 3},
                "ebm": {"outer_bags": 2, "round_bags": 1, "interactions": 3, "max_rounds": 5},
                "symbolic": {"engine": "operon", "generations": 2, "population": 20},
            },
        },
        "periods": [1, 2, 0],
        "rollouts": {"n_robots": 2, "n_steps": 20},
        "n_samples": 20,
        "repeats": 2,
    }
    path = tmp_path / "small.yaml"
    path.write_text(yaml.safe_dump(values))
    return path


def test_experts_learn_as_the_paper_says(paper):
    training = paper.training
    assert paper.gait == ("walk", "trot", "pace", "bound")
    assert (training.n_robots, training.updates, training.ppo.steps_per_update) == (1024, 1500, 24)
    hours = training.updates * training.steps_per_update * CONTROL_PERIOD / 3600
    assert round(hours) == 205
    assert training.curriculum.initial_difficulty == 1.0
    assert not training.mirrored


def test_experts_learn_in_one_world(paper):
    stations = paper.training.worlds.stations(A1, np.random.default_rng(0))
    assert set(stations) == {paper.training.worlds.station}
    assert (stations[0].stiffness, stations[0].damping) == (20.0, 0.5)
    assert paper.training.worlds.randomization.latency == (0.0, 0.0)


@pytest.mark.parametrize("kind", ["gbm", "ebm", "symbolic"])
def test_every_student_is_distilled_by_algorithm_1(kind, paper):
    config = paper.distillation.for_gait(load_gait("trot"))
    assert config.collector_of(kind) == kind
    planned = rounds(config, kind)
    assert [list(own.episodes) for own in planned] == [[episode] for episode in range(1, 31)]
    assert [own.period for own in planned] == [math.ceil(episode / 4) for episode in range(1, 31)]
    assert {own.steps for own in planned} == {1000}
    assert sum(own.steps for own in planned) * CONTROL_PERIOD == 600.0
    assert config.speeds == (0.0, 0.25, 0.5, 0.75)
    settings = config.settings.of(kind)
    assert settings.for_rounds() == settings.for_shuffled_split() == settings
    assert len(settings.candidates()) <= 1


@pytest.mark.parametrize(("gait", "fastest"), [("walk", 0.5), ("trot", 0.75)])
def test_students_are_rolled_out_at_the_speeds_that_they_learned(gait, fastest, paper):
    assert paper.rollouts_of(load_gait(gait)).speed_range == (0.0, fastest)


def test_boosted_trees_are_those_of_scikit_learns_defaults(paper, generator):
    x = generator.normal(size=(200, 5))
    y = x[:, 0] + np.sin(3 * x[:, 1])
    ours = boosting_regressor(paper.distillation.settings.of("gbm"), seed=3).fit(x, y)
    default = GradientBoostingRegressor(random_state=3).fit(x, y)
    np.testing.assert_array_equal(ours.predict(x), default.predict(x))


def test_additive_models_are_those_of_interprets_defaults(paper):
    default = ExplainableBoostingRegressor().get_params()
    ours = additive_regressor(paper.distillation.settings.of("ebm"), 5, seed=3).get_params()
    # How many processes fit is no part of a model; what is observed is numbers.
    assert {name for name in default if ours[name] != default[name]} == {
        "feature_types",
        "n_jobs",
        "random_state",
    }


def test_formulas_are_pysrs(paper):
    settings = paper.distillation.settings.of("symbolic")
    assert settings.engine == "pysr"
    assert (settings.max_length, settings.operator_complexity, settings.iterations) == (90, 4, 20)
    assert settings.start_weights == (1,)


def test_policies_are_rolled_out_as_the_paper_says(paper):
    assert len(paper.periods) == 11
    assert {1, 2, 4, 6, 0} <= set(paper.periods)
    assert (paper.rollouts.n_robots, paper.rollouts.n_seeds) == (26, 1)


def leaves(values, prefix=""):
    for key, value in values.items():
        name = f"{prefix}{key}"
        yield from leaves(value, f"{name}.") if isinstance(value, dict) else (name,)


def test_what_a_quick_run_does_less_of_is_listed(paper):
    quick = load_settings(Report, PAPER, quick=True)
    listed = differences(paper, quick)
    assert set(listed["setting"]) == set(leaves(yaml.safe_load(PAPER.read_text())["quick"])) - {
        "output"
    }
    [row] = listed[listed["setting"] == "training.updates"].itertuples(index=False)
    assert list(row) == ["training.updates", "1500", str(quick.training.updates)]
    assert quick.training.updates < 1500
    assert differences(paper, paper).empty
    # The method is the paper's in small too.
    assert quick.distillation.episodes_per_fit == 1
    assert quick.distillation.collector == "itself"
    assert quick.periods == paper.periods


def test_another_engine_is_a_difference_that_the_report_says(paper, tmp_path, monkeypatch):
    monkeypatch.setattr(report, "pysr_starts", lambda: True)
    operon = replace(paper, engine="operon").settled()
    assert list(differences(paper, operon)["setting"]) == ["distillation.settings.symbolic.engine"]
    assert WITHOUT_PYSR in operon.deviations(tmp_path)
    assert WITHOUT_PYSR not in paper.settled().deviations(tmp_path)


@pytest.mark.parametrize("quick", [[], ["--quick"]])
def test_without_julia_the_papers_formulas_are_refused_at_once(
    quick, tmp_path, monkeypatch, refused
):
    monkeypatch.setattr(report, "pysr_starts", lambda: False)
    output = tmp_path / "run"
    message = refused(["reproduce", "paper", *quick, "--output", str(output)])
    assert "needs Julia" in message
    assert "--engine operon" in message
    assert not output.exists()


@pytest.mark.parametrize(("text", "starts"), [("", True), ("raise OSError('no Julia')", False)])
def test_whether_pysr_starts_is_seen_in_another_process(text, starts, tmp_path, monkeypatch):
    (tmp_path / "pysr.py").write_text(text)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    assert pysr_starts() is starts


def test_settings_that_are_none_are_refused(tmp_path, refused):
    assert "did you mean 'reproduce paper'" in refused(["reproduce", "papper"])
    path = tmp_path / "mine.yaml"
    path.write_text("training: {n_robot: 5}\n")
    with pytest.raises(InputError, match="n_robot"):
        load_settings(Report, path)
    path.write_text("training: {n_robots: 32}\n")
    assert load_settings(Report, path).training.n_robots == 32
    assert "key 'study' is None" in refused(["reproduce", str(path)])
    path.write_text("study: report\ntraining: {n_robots: 32}\n")
    message = refused(["reproduce", str(path), "--quick"])
    assert f"{path}: has no settings under the key 'quick'" in message
    path.write_text("- trot\n")
    with pytest.raises(InputError, match="mapping"):
        load_settings(Report, path)


@pytest.mark.slow
def test_command_does_everything_in_small_and_resumes(small, tmp_path, refused, capsys):
    folder = tmp_path / "run"
    arguments = ["reproduce", str(small), "--quick", "--output", str(folder)]
    main(arguments)
    reported = capsys.readouterr().out
    assert "training.updates" in reported
    assert "1500" in reported
    listed = pd.read_csv(folder / "differences.csv").set_index("setting")
    assert listed.loc["distillation.settings.symbolic.engine", "here"] == "operon"
    page = (folder / "report.html").read_text()
    assert "training.updates: 2, not 1500." in page
    assert "Formulas are searched by Operon, not by PySR" in page
    students = folder / "trot" / "distillation"
    for kind in ("gbm", "ebm", "symbolic"):
        assert len(list((students / kind).glob("round_*.safetensors"))) == 6
    assert not (students / "histogram_gbm").exists()
    ratios = pd.read_csv(folder / "trot" / "ratios.csv")
    assert set(ratios["ratio"].astype(str)) == {"1", "1/2", "0"}
    assert "continue it with --resume" in refused(arguments)
    kept = [students / "ebm" / "round_06.safetensors", students / "ebm" / "record.json"]
    made = [path.stat().st_mtime_ns for path in kept]
    (folder / "report.html").unlink()
    main([*arguments, "--resume"])
    assert (folder / "report.html").read_text() == page
    assert made == [path.stat().st_mtime_ns for path in kept]


@pytest.mark.parametrize(
    "command",
    [
        "demo",
        *(f"reproduce {name}" for name in ("report", "benchmark")),
    ],
)
def test_robots_without_an_expert_and_folders_are_refused(
    command, tmp_path, monkeypatch, own_robot, refused
):
    monkeypatch.chdir(tmp_path)
    parts = ["--parts", "inference"] if command.endswith("benchmark") else []
    assert "holds no policies of the" in refused([*command.split(), *parts, "--robot", own_robot])
    assert "is a folder" in refused([*command.split(), *parts, "--robot", "."])
    assert not list(tmp_path.iterdir())

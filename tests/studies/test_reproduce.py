"""The demo, the report and the paper's settings: what they say, and all of it in small."""

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
from glassgait.studies.distillation.config import DistillationConfig, StudentsSettings, rounds
from glassgait.studies.distillation.students import paper_students
from glassgait.studies.distillation.symbolic import SymbolicPerStateSettings
from glassgait.studies.reproduction import demo, report
from glassgait.studies.reproduction.contents import GaitResults, contents, r2_by_gait
from glassgait.studies.reproduction.report import WITHOUT_PYSR, Report
from glassgait.studies.reproduction.settings import load_settings, settings_file

PAPER = settings_file("paper")

TINY_STUDENTS = {
    "gbm": {"n_trees": 3},
    "ebm": {"outer_bags": 2, "round_bags": 1, "interactions": 3, "max_rounds": 5},
    "symbolic": {"engine": "operon", "generations": 2, "population": 20},
}


@pytest.fixture(scope="module")
def paper():
    return load_settings(Report, PAPER)


@pytest.fixture
def small(tmp_path):
    """The paper's settings with a quick run that takes seconds."""
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
            "settings": TINY_STUDENTS,
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
    assert round(training.updates * training.steps_per_update * CONTROL_PERIOD / 3600) == 205
    assert training.curriculum.initial_difficulty == 1.0 and not training.mirrored
    stations = training.worlds.stations(load_robot(), np.random.default_rng(0))
    assert set(stations) == {training.worlds.station}
    assert (stations[0].stiffness, stations[0].damping) == (20.0, 0.5)


@pytest.mark.parametrize("kind", ["gbm", "ebm", "symbolic"])
def test_every_student_is_distilled_by_algorithm_1(kind, paper):
    config = paper.distillation.for_gait(load_gait("trot"))
    assert config.collector_of(kind) == kind
    planned = rounds(config, kind)
    assert [list(own.episodes) for own in planned] == [[episode] for episode in range(1, 31)]
    assert [own.period for own in planned] == [math.ceil(episode / 4) for episode in range(1, 31)]
    assert {own.steps for own in planned} == {1000}
    assert config.speeds == (0.0, 0.25, 0.5, 0.75)
    assert len(config.settings.of(kind).candidates()) <= 1


def test_students_are_those_of_their_libraries_defaults(paper, generator):
    x = generator.normal(size=(200, 5))
    y = x[:, 0] + np.sin(3 * x[:, 1])
    settings = paper.distillation.settings
    ours = settings.gbm.regressor(5, seed=3).fit(x, y)
    default = GradientBoostingRegressor(random_state=3).fit(x, y)
    np.testing.assert_array_equal(ours.predict(x), default.predict(x))
    default = ExplainableBoostingRegressor().get_params()
    ours = settings.ebm.regressor(5, seed=3).get_params()
    changed = {name for name in default if ours[name] != default[name]}
    assert changed == {"feature_types", "n_jobs", "random_state"}
    formulas = settings.of("symbolic")
    assert (formulas.engine, formulas.max_length, formulas.iterations) == ("pysr", 90, 20)


def test_policies_are_rolled_out_at_most_as_fast_as_the_gait_goes(paper):
    assert paper.rollouts_of(load_gait("walk")).speed_range == (0.0, 0.5)
    assert paper.rollouts_of(load_gait("trot")).speed_range == (0.0, 0.75)


def test_differences_from_the_paper_are_listed(paper, monkeypatch):
    monkeypatch.setattr(report, "pysr_starts", lambda: True)
    assert WITHOUT_PYSR in replace(paper, engine="operon").settled().deviations()
    assert WITHOUT_PYSR not in paper.settled().deviations()


def test_without_julia_the_papers_formulas_are_refused_at_once(tmp_path, monkeypatch, refused):
    monkeypatch.setattr(report, "pysr_starts", lambda: False)
    output = tmp_path / "run"
    message = refused(["reproduce", "paper", "--quick", "--output", str(output)])
    assert "--engine operon" in message and not output.exists()


@pytest.mark.parametrize(
    ("text", "message"), [("training: {n_robot: 5}\n", "n_robot"), ("- trot\n", "mapping")]
)
def test_settings_files_that_are_wrong_are_refused(text, message, tmp_path, refused):
    path = tmp_path / "mine.yaml"
    path.write_text(text)
    assert message in refused(["reproduce", str(path)])


def test_a_report_needs_all_students_and_a_quick_run_quick_settings(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text("training: {n_robots: 32}\n")
    assert load_settings(Report, path).training.n_robots == 32
    with pytest.raises(InputError, match="quick"):
        load_settings(Report, path, quick=True)
    for wrong in ("periods: [1]", "rollouts: {seed: 500}", "distillation: {students: [gbm, ebm]}"):
        path.write_text(wrong)
        with pytest.raises(InputError, match=r"no student acts|include 500|lacks sym"):
            load_settings(Report, path)


@pytest.fixture
def results(tmp_path):
    scores = {"r2": [0.9, 0.8, 0.7], "r2_shuffled_split": [0.95, 0.85, 0.75]}
    r2 = pd.DataFrame({"student": paper_students(), **scores})
    tops = pd.DataFrame({"gait": ["pace"], "student": ["gbm"], "method": ["impurity"], "1st": "x"})
    return [GaitResults("pace", tmp_path / "pace", r2, pd.DataFrame({"policy": ["gbm"]}), tops)]


def test_every_table_and_figure_of_the_paper_is_there(results):
    numbers = [section.number.split(",")[0] for section in contents(results)]
    figures = [f"Figure {number}" for number in range(1, 12)]
    assert set(numbers) == {"Table I", "Table II", *figures}


def test_r2_stands_beside_the_papers(results):
    table = r2_by_gait(results).set_index(["student", "split"])["pace"]
    assert table["gbm", "shuffled"] == 0.95 and table["gbm", "by episode"] == 0.9
    assert table["gbm", "paper"] == 0.9752
    assert table["symbolic", "paper"] == 0.7331


@pytest.mark.slow
def test_the_paper_is_reproduced_in_small_and_resumed(small, tmp_path, refused):
    folder = tmp_path / "run"
    arguments = ["reproduce", str(small), "--quick", "--output", str(folder)]
    main(arguments)
    page = (folder / "report.html").read_text()
    assert page.count("data:image/png;base64") == 12
    assert (folder / "table_i_1.csv").exists()
    students = folder / "trot" / "distillation"
    for kind in ("gbm", "ebm", "symbolic"):
        assert len(list((students / kind).glob("round_*.safetensors"))) == 6
    ratios = pd.read_csv(folder / "trot" / "ratios.csv")
    assert set(ratios["ratio"]) == {1.0, 0.5, 0.0}
    assert "--resume" in refused(arguments)
    kept = students / "ebm" / "record.json"
    made = kept.stat().st_mtime_ns
    (folder / "report.html").unlink()
    main([*arguments, "--resume"])
    assert (folder / "report.html").read_text() == page
    assert kept.stat().st_mtime_ns == made


@pytest.mark.slow
def test_the_demo_shows_a_robot_first_and_then_compares_students(tmp_path, monkeypatch):
    formulas = SymbolicPerStateSettings(shapes=((20, 20),), start_weights=(1,))
    tiny = DistillationConfig(
        students=("linear", "symbolic_per_state"),
        episodes=5,
        alone_rounds=0,
        episode_steps=60,
        settings=StudentsSettings(symbolic_per_state=formulas),
    )
    for name, value in {"QUICK": tiny, "REPLAY_STEPS": 50}.items():
        monkeypatch.setattr(demo, name, value)
    before = []

    def distill(*arguments, **options):
        before.append((tmp_path / "run" / "report.html").read_text())
        return own_distill(*arguments, **options)

    own_distill = demo.distill
    monkeypatch.setattr(demo, "distill", distill)
    main(["demo", "--output", str(tmp_path / "run"), "--n-robots", "2"])
    assert 'src="formulas_replay.html"' in before[0] and "not complete" in before[0]
    page = (tmp_path / "run" / "report.html").read_text()
    assert "not complete" not in page and "linear" in page

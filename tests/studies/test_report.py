"""The report: the paper's tables beside ours, and the whole of it in small."""

import pandas as pd
import pytest

from glassgait.studies.cli import main
from glassgait.studies.distillation.config import DistillationConfig
from glassgait.studies.report import command
from glassgait.studies.report.config import ReportConfig
from glassgait.studies.report.contents import contents, r2_by_gait
from glassgait.studies.report.gait import GaitResults
from glassgait.studies.rollouts.config import RolloutConfig
from glassgait.studies.students.additive import EbmSettings
from glassgait.studies.students.boosting import GbmSettings, HistogramGbmSettings
from glassgait.studies.students.registry import paper_students
from glassgait.studies.students.settings import StudentsSettings
from glassgait.studies.students.symbolic_settings import SymbolicSettings

TINY = ReportConfig(
    distillation=DistillationConfig(
        students=paper_students(),
        episodes=5,
        alone_rounds=1,
        episode_steps=60,
        alone_episodes=4,
        alone_steps=60,
        settings=StudentsSettings(
            gbm=GbmSettings(n_trees=5, depth=2),
            histogram_gbm=HistogramGbmSettings(n_trees=5),
            ebm=EbmSettings(outer_bags=2, interactions=2, round_interactions=1, max_rounds=20),
            symbolic=SymbolicSettings(shapes=((90, 90),), start_weights=(1,), alone_episodes=4),
        ),
        n_jobs=1,
    ),
    rollouts=RolloutConfig(n_robots=2, n_steps=20, n_seeds=1),
    n_samples=30,
    repeats=2,
)


@pytest.fixture
def results(tmp_path):
    r2 = pd.DataFrame(
        {
            "student": paper_students(),
            "r2": [0.9, 0.8, 0.7],
            "r2_shuffled_split": [0.95, 0.85, 0.75],
        }
    )
    tops = pd.DataFrame({"gait": ["pace"], "student": ["gbm"], "method": ["impurity"], "1st": "x"})
    return [GaitResults("pace", tmp_path / "pace", r2, pd.DataFrame({"policy": ["GBM"]}), tops)]


def test_every_number_of_the_paper_is_there(results):
    numbers = [item.number.split(",")[0] for item in contents(results)]
    figures = [f"Figure {number}" for number in range(1, 12)]
    assert set(numbers) == {"Table I", "Table II", *figures}


def test_r2_stands_beside_the_papers(results):
    table = r2_by_gait(results).set_index(["student", "split"])["pace"]
    assert table["GBM", "shuffled"] == 0.95
    assert table["GBM", "by episode"] == 0.9
    assert table["GBM", "paper"] == 0.9752
    assert table["Symbolic", "paper"] == 0.7331


def test_gaits_without_an_expert_are_told(refused):
    message = refused(["report", "--quick", "--gait", "trot", "gallop"])
    assert "no expert of gallop ships with the project" in message


@pytest.mark.slow
def test_command_writes_one_page_and_resumes(tmp_path, monkeypatch, refused):
    monkeypatch.setattr(command, "QUICK", TINY)
    arguments = ["report", "--quick", "--gait", "trot", "--output", str(tmp_path)]
    main(arguments)
    page = (tmp_path / "report.html").read_text()
    assert page.count("data:image/png;base64") == 12
    assert "data:image/svg+xml" in page
    text = (tmp_path / "report.md").read_text()
    for line in text.splitlines():
        if line.startswith("![Trot"):
            assert (tmp_path / line.split("](")[1].rstrip(")")).exists()
    assert (tmp_path / "table_i_1.csv").exists()
    assert "continue it with --resume" in refused(arguments)
    main([*arguments, "--resume"])
    assert (tmp_path / "report.html").read_text() == page

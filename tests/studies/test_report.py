"""The report: the paper's tables beside ours, and the whole of it in small."""

import pandas as pd
import pytest
import yaml

from glassgait.models.files import read_yaml
from glassgait.models.policies.library import (
    EXPERT_DIRECTORY,
    shipped_experts,
)
from glassgait.models.robots.library import load_robot
from glassgait.studies.cli import main
from glassgait.studies.common.rollouts import RolloutConfig
from glassgait.studies.common.run_folder import to_plain
from glassgait.studies.distillation.config import DistillationConfig
from glassgait.studies.distillation.students.boosting import (
    EbmSettings,
    GbmSettings,
    HistogramGbmSettings,
)
from glassgait.studies.distillation.students.registry import paper_students
from glassgait.studies.distillation.students.settings import StudentsSettings
from glassgait.studies.distillation.students.symbolic_regression import (
    StatewiseSymbolicSettings,
    SymbolicSettings,
)
from glassgait.studies.reproduction.contents import contents, deviations, r2_by_gait
from glassgait.studies.reproduction.gait import GaitResults, ReportConfig
from glassgait.studies.training.record import trainings

A1 = load_robot()

PAPER_CONTROL_STEPS = 36.9e6
"""1,500 updates of 1,024 robots and 24 steps."""

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
        n_workers=1,
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
    numbers = [section.number.split(",")[0] for section in contents(results)]
    figures = [f"Figure {number}" for number in range(1, 12)]
    assert set(numbers) == {"Table I", "Table II", *figures}


def test_r2_stands_beside_the_papers(results):
    table = r2_by_gait(results).set_index(["student", "split"])["pace"]
    assert table["GBM", "shuffled"] == 0.95
    assert table["GBM", "by episode"] == 0.9
    assert table["GBM", "paper"] == 0.9752
    assert table["Symbolic", "paper"] == 0.7331


def test_unknown_gaits_are_refused(refused):
    message = refused(["reproduce", "report", "--quick", "--gait", "trot", "gallop"])
    assert "unknown gait 'gallop'" in message


@pytest.mark.slow
def test_command_writes_one_page_and_resumes(tmp_path, refused, faults_of):
    tiny = tmp_path.with_suffix(".yaml")
    tiny.write_text(yaml.safe_dump({"study": "report", "quick": to_plain(TINY)}))
    arguments = ["reproduce", str(tiny), "--quick", "--gait", "trot", "--output", str(tmp_path)]
    main(arguments)
    page = (tmp_path / "report.html").read_text()
    assert faults_of(tmp_path / "report.html") == []
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


def test_the_deviations_are_those_of_what_ships():
    said = " ".join(deviations(A1, trains=False))
    assert "Unitree A1" in said
    steps = [
        sum(read_yaml(run)["control_steps"] for run in trainings(EXPERT_DIRECTORY / f"{name}.yaml"))
        for name in shipped_experts()
    ]
    shares = [own / PAPER_CONTROL_STEPS * 100 for own in steps]
    assert f"{min(shares):.0f} to {max(shares):.0f} % of the paper's control steps" in said
    nodes = max(length for _, length in StatewiseSymbolicSettings().shapes)
    assert f"one per RM state at most {nodes}" in said

"""The report: the paper's tables beside ours, and the whole of it in small."""

import json

import pandas as pd
import pytest
import yaml

from glassgait.models.certificates.certificate import SHIPPED
from glassgait.models.files import digest, read_yaml
from glassgait.models.policies.library import (
    EXPERT_DIRECTORY,
    STUDENT_DIRECTORY,
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
from glassgait.studies.reproduction.certificates import certificates
from glassgait.studies.reproduction.contents import contents, deviations, r2_by_gait
from glassgait.studies.reproduction.gait import GaitResults, ReportConfig
from glassgait.studies.reproduction.page import Page
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


def rendered(section, folder):
    """Writes a page of one section, and returns its HTML and its Markdown."""
    page = Page("Certificates", [], [section]).write(folder)
    return page.read_text(), page.with_suffix(".md").read_text()


def explained(folder, policy_sha256):
    folder.mkdir(parents=True)
    (folder / "config.yaml").write_text(f"gait: trot\npolicy_sha256: {policy_sha256}\n")
    (folder / "index.html").write_text("a page")


def test_policies_with_a_certificate_are_listed_with_their_claims_by_verdict(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    certified = certificates(["half_bound", "trot"], A1, tmp_path / "runs" / "reproduce" / "report")
    verdicts, *policies = certified.tables
    by_heading = {own.heading: own for own in policies}
    assert {"Half_bound: EBM", "Trot: Page of formulas", "Trot: Symbolic"} <= {*by_heading}
    listed = json.loads((SHIPPED / "trot_sparse_formula.json").read_text())["claims"]
    counts = verdicts.frame.set_index("policy").loc["Trot: Page of formulas"]
    for verdict, outcome in (("proved", "proved"), ("refuted", "refuted"), ("open", "undecided")):
        names = [claim["name"] for claim in listed if claim["outcome"] == outcome]
        claims = by_heading["Trot: Page of formulas"].frame
        assert list(claims.loc[claims["verdict"] == verdict, "claim"]) == names
        assert counts[verdict] == len(names)
    for text in rendered(certified, tmp_path):
        assert "RL calf in q0: change of the target of 0.9866 rad by w.y" in text
        assert "glassgait explain page --gait trot --policy sparse_formula" in text
    none = certificates(["half_bound"], load_robot("go2"), tmp_path)
    assert not none.tables
    assert "No policy of these gaits has one." in none.note


def test_a_certificate_links_to_the_page_of_its_very_policy(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    pages = tmp_path / "runs" / "explain" / "page" / "trot"
    explained(pages / "another", "0" * 64)
    (pages / "damaged").mkdir()
    (pages / "damaged" / "config.yaml").write_text("{")
    folder = tmp_path / "runs" / "reproduce" / "report"
    assert not any("](" in own.note for own in certificates(["trot"], A1, folder).tables)
    explained(
        pages / "sparse_formula", digest(STUDENT_DIRECTORY / "trot" / "sparse_formula.formulas")
    )
    certified = certificates(["trot"], A1, folder)
    by_heading = {own.heading: own for own in certified.tables}
    link = "../../explain/page/trot/sparse_formula/index.html#certificate"
    assert f"({link})" in by_heading.pop("Trot: Page of formulas").note
    assert not any("](" in own.note for own in by_heading.values())
    assert all(link in text for text in rendered(certified, tmp_path))


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
    assert "Trot: Page of formulas" in pd.read_csv(tmp_path / "certificates.csv")["policy"].tolist()
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

"""Distillation: Algorithm 1, its students, what it resumes, and what goes wrong."""

import shutil
from dataclasses import replace
from itertools import pairwise

import pandas as pd
import pytest

from glassgait.diagrams.domain_randomization import DomainRandomization
from glassgait.models.errors import InputError
from glassgait.models.policies.library import load_policy, policy_path
from glassgait.models.task.gait import load_gait
from glassgait.models.task.observation import ObservationLayout, overdue
from glassgait.studies.common.selection import simplest_of_the_best
from glassgait.studies.distillation.config import DistillationConfig
from glassgait.studies.distillation.students.boosting import (
    EbmSettings,
    GbmSettings,
    HistogramGbmSettings,
)
from glassgait.studies.distillation.students.dataset import Dataset, load_rounds, r2_scores
from glassgait.studies.distillation.students.library import load_students
from glassgait.studies.distillation.students.settings import StudentsSettings
from glassgait.studies.distillation.students.sparse_formula import SparseFormulaSettings
from glassgait.studies.distillation.students.symbolic_regression import (
    StatewiseSymbolicSettings,
    SymbolicSettings,
)
from glassgait.studies.distillation.study import distill, write_r2_table

GAIT = load_gait("trot")

SMALL_FORMULAS = {
    "population": 20,
    "generations": 2,
    "max_samples": 100,
    "start_weights": (1, 3),
    "alone_episodes": 4,
}

ONE_SHAPE = SMALL_FORMULAS | {"shapes": ((30, 30),), "start_weights": (3,)}


TINY = DistillationConfig(
    episodes=5,
    alone_rounds=1,
    episode_steps=24,
    alone_episodes=4,
    alone_steps=20,
    speeds=(0.0, 0.25, 0.5, 0.75),
    worlds=DomainRandomization(n_groups=2, mujoco_share=0.5),
    settings=StudentsSettings(
        gbm=GbmSettings(n_trees=5),
        histogram_gbm=HistogramGbmSettings(n_trees=5),
        ebm=EbmSettings(outer_bags=2, interactions=1, round_interactions=0, max_rounds=4),
        symbolic=SymbolicSettings(shapes=((30, 30), (30, 60)), **SMALL_FORMULAS),
        statewise_symbolic=StatewiseSymbolicSettings(**ONE_SHAPE),
        sparse_formula=SparseFormulaSettings(terms=36, alone_episodes=4),
    ),
    n_workers=1,
)


@pytest.fixture(scope="module")
def finished(expert, tmp_path_factory):
    folder = tmp_path_factory.mktemp("distillation")
    r2 = distill(TINY, GAIT, expert, folder, lambda line: None)
    write_r2_table(r2, "trot", folder)
    return folder, r2


def test_every_student_is_made_scored_and_saved(finished, expert):
    folder, r2 = finished
    students = load_students(folder, expert)
    assert list(students) == list(TINY.students) == r2["student"].tolist()
    for name in ("metrics.json", "r2.csv", "r2.md", "config.yaml"):
        assert (folder / name).exists()


@pytest.mark.slow
def test_students_that_are_made_side_by_side_are_the_same(finished, expert, tmp_path):
    folder, whole = finished
    reported = []
    students = TINY.students
    config = replace(TINY, n_workers=2)
    r2 = distill(config, GAIT, expert, tmp_path, print, finished=reported.append)
    assert r2["student"].tolist() == reported[-1]["student"].tolist() == list(students)
    assert all(len(table) <= len(later) for table, later in pairwise(reported))
    columns = [name for name in r2 if name != "minutes"]
    same = whole.set_index("student").loc[list(students)].reset_index()
    pd.testing.assert_frame_equal(r2[columns], same[columns], check_exact=True)
    for kind in students:
        made = policy_path(tmp_path, kind)
        assert made.read_bytes() == policy_path(folder, kind).read_bytes()


def test_a_run_cut_short_and_resumed_ends_the_same(finished, expert, tmp_path):
    folder, _ = finished
    shutil.copytree(folder, tmp_path, dirs_exist_ok=True)
    (tmp_path / "metrics.json").unlink()
    for path in ("gbm/record.json", "gbm.safetensors", "histogram_gbm/round_02.safetensors"):
        (tmp_path / path).unlink()
    shutil.rmtree(tmp_path / "linear")
    write_r2_table(
        distill(TINY, GAIT, expert, tmp_path, lambda line: None, resume=True), "trot", tmp_path
    )
    assert (tmp_path / "metrics.json").read_text() == (folder / "metrics.json").read_text()


def test_a_damaged_student_beside_a_good_record_is_refused(finished, expert, tmp_path):
    folder, _ = finished
    shutil.copytree(folder, tmp_path, dirs_exist_ok=True)
    path = tmp_path / "linear.safetensors"
    path.write_bytes(path.read_bytes()[:-9] + b"nonsense!")
    with pytest.raises(InputError, match=r"linear\.safetensors"):
        distill(TINY, GAIT, expert, tmp_path, lambda line: None, resume=True)
    (tmp_path / "linear" / "record.json").unlink()
    distill(TINY, GAIT, expert, tmp_path, lambda line: None, resume=True)
    assert path.read_bytes() == (folder / "linear.safetensors").read_bytes()


def test_another_expert_is_not_mixed_in(finished, other_expert):
    folder, _ = finished
    with pytest.raises(InputError, match="another expert"):
        distill(TINY, GAIT, other_expert, folder, lambda line: None, resume=True)


def test_files_of_another_run_or_round_are_not_mixed_in(finished, expert, tmp_path):
    folder, _ = finished
    config = replace(TINY, students=("linear",))
    other = tmp_path / "other"
    distill(replace(config, seed=1), GAIT, expert, other, lambda line: None)

    def resumed(source, target):
        run = tmp_path / f"{source.parent.parent.name}_{target}".replace("/", "_")
        shutil.copytree(folder, run)
        (run / "linear" / "record.json").unlink()
        shutil.copy(source, run / target)
        distill(config, GAIT, expert, run, lambda line: None, resume=True)

    for source, target in (
        (other / "linear" / "record.json", "linear/record.json"),
        (folder / "ebm" / "record.json", "linear/record.json"),
        (other / "linear" / "round_01.safetensors", "linear/round_01.safetensors"),
        (folder / "linear" / "round_01.safetensors", "linear/round_02.safetensors"),
    ):
        with pytest.raises(InputError, match="another run"):
            resumed(source, target)


@pytest.mark.parametrize("name", ["linear/record.json", "linear/round_01.safetensors"])
def test_damaged_work_is_refused(name, finished, expert, tmp_path):
    folder, _ = finished
    shutil.copytree(folder, tmp_path, dirs_exist_ok=True)
    if "round" in name:
        (tmp_path / "linear" / "record.json").unlink()
    data = bytearray((tmp_path / name).read_bytes())
    data[len(data) // 2] ^= 1
    (tmp_path / name).write_bytes(data)
    with pytest.raises(InputError, match="is damaged"):
        distill(TINY, GAIT, expert, tmp_path, lambda line: None, resume=True)


def test_formulas_are_written_for_people(finished):
    folder, _ = finished
    text = (folder / "statewise_symbolic.formulas").read_text()
    assert "\nmirror: [1, 0] " in text
    assert text.count("\nFL_hip = ") == 1
    assert max(map(len, text.splitlines())) <= 100
    assert load_policy(folder / "statewise_symbolic.formulas").to_text() == text
    latex = (folder / "symbolic.tex").read_text()
    assert latex.count(r"\begin{align*}") == latex.count(r"\end{align*}") >= 12
    assert r"q^{*}_{\mathrm{RR\,calf}} ={}&" in latex


def test_a_finished_folder_is_not_overwritten(finished, expert):
    folder, _ = finished
    with pytest.raises(InputError, match="--resume"):
        distill(TINY, GAIT, expert, folder, lambda line: None)
    with pytest.raises(InputError, match="seed"):
        distill(replace(TINY, seed=1), GAIT, expert, folder, lambda line: None, resume=True)


def test_rounds_follow_the_paper(finished):
    folder, _ = finished
    first, second = (Dataset.load(folder / "linear" / f"round_{n:02d}.safetensors") for n in (1, 2))
    assert sorted(set(first.episodes)) == [1, 2, 3, 4]
    assert set(second.episodes) == {5}
    speeds = [first.observations[first.episodes == episode, 0] for episode in (1, 2, 3, 4)]
    for speed, values in zip((0.0, 0.25, 0.5, 0.75), speeds, strict=True):
        assert set(values) == {speed}


def starts(data):
    return data.starts


def waits(data):
    return overdue(data.observations, ObservationLayout(GAIT.n_states, imu=True).names)


@pytest.mark.parametrize(
    ("counted", "start_weight", "overdue_weight"), [(starts, 50, 1), (waits, 1, 50)]
)
def test_samples_that_count_more_are_imitated_better(
    counted, start_weight, overdue_weight, expert, tmp_path
):
    scores = []
    for weights in ((1, 1), (start_weight, overdue_weight)):
        symbolic = SymbolicSettings(
            **SMALL_FORMULAS | {"shapes": ((30, 30),), "start_weights": weights[:1]}
        )
        config = replace(
            TINY,
            students=("symbolic",),
            # The expert acts alone, so that the samples are the same.
            curriculum="expert_only",
            alone_rounds=0,
            overdue_weight=weights[1],
            settings=StudentsSettings(symbolic=symbolic),
        )
        folder = tmp_path / "_".join(map(str, weights))
        distill(config, GAIT, expert, folder, lambda line: None)
        data = load_rounds(folder / "symbolic")
        own = data.subset(counted(data) & ~data.held_out)
        scores.append(r2_scores(load_policy(folder / "symbolic.formulas"), own).mean())
    assert scores[1] > scores[0]


def test_bands_come_with_the_last_fit_alone(finished):
    folder, _ = finished
    policy = load_policy(folder / "ebm.safetensors")
    assert policy.deviations.max() > 0
    assert len(policy.pairs) == 12
    ebm = TINY.settings.of("ebm")
    assert ebm.for_rounds().outer_bags == ebm.for_shuffled_split().outer_bags == 1
    assert ebm.for_rounds().interactions == 0
    for config in (TINY, DistillationConfig()):
        trees = config.settings.of("histogram_gbm")
        assert trees.for_rounds().n_trees == min(trees.n_trees, 150)


def test_the_simplest_good_one_is_taken_and_the_others_are_reported(finished):
    folder, _ = finished
    ranked = pd.read_csv(folder / "symbolic_candidates.csv")
    shapes = ["sum of 30, 30 in all", "sum of 30, 60 in all"]
    complexity = {title: shape for shape in shapes for title in (shape, f"{shape}, starts count 3")}
    assert set(ranked["candidate"]) == set(complexity)
    assert ranked["return"].is_monotonic_decreasing
    policy = load_policy(folder / "symbolic.formulas")
    longest = max(formula.length for formula in policy.expressions)
    chosen = simplest_of_the_best(ranked, complexity)
    assert (longest <= 30) == (complexity[chosen] == shapes[0])


def test_students_are_saved_as_compact_ones(finished):
    folder, r2 = finished
    assert set(r2["student"]) >= {"gbm", "ebm", "histogram_gbm"}
    for kind in r2["student"]:
        policy = load_policy(policy_path(folder, kind))
        assert policy.digest() == policy.compact().digest(), kind

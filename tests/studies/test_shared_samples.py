"""Samples that one student collects for all: who has them, and where other studies find them."""

import pytest

from glassgait.models.errors import InputError
from glassgait.models.policies.library import load_expert
from glassgait.models.task.gait import load_gait
from glassgait.studies.distillation.config import DistillationConfig
from glassgait.studies.distillation.students.library import samples_folder
from glassgait.studies.distillation.students.registry import StudentsSettings
from glassgait.studies.distillation.students.symbolic_regression import SymbolicSettings
from glassgait.studies.distillation.study import distill

STUDENTS = ("open_loop", "linear", "statewise_linear")


@pytest.fixture(scope="module")
def shared(tmp_path_factory):
    """A distillation whose linear student collects for all, and its tables so far."""
    folder, tables = tmp_path_factory.mktemp("shared"), []
    config = DistillationConfig(
        students=STUDENTS,
        collector="linear",
        episodes=5,
        alone_rounds=0,
        episode_steps=20,
        n_jobs=1,
    )
    gait, expert = load_gait("trot"), load_expert("trot")
    distill(config, gait, expert, folder, lambda line: None, finished=tables.append)
    return folder, tables


def test_the_collector_alone_collects(shared):
    folder, _ = shared
    assert {path.parent.name for path in folder.rglob("round_*.safetensors")} == {"linear"}


def test_all_are_fitted_to_as_many_samples(shared):
    _, tables = shared
    assert set(tables[-1]["samples"]) == {80}


def test_tables_grow_by_a_student(shared):
    _, tables = shared
    assert [tuple(table["student"]) for table in tables] == [
        STUDENTS[:1],
        STUDENTS[:2],
        STUDENTS,
    ]


def test_other_studies_find_the_shared_samples(shared, tmp_path):
    folder, _ = shared
    assert samples_folder(folder, "open_loop") == folder / "linear"
    assert samples_folder(tmp_path, "open_loop") == tmp_path / "open_loop"
    assert samples_folder(tmp_path, "gbm") == tmp_path / "histogram_gbm"


def test_the_collectors_own_episodes_count():
    settings = StudentsSettings(symbolic=SymbolicSettings(alone_episodes=5))
    few = {"students": ("linear",), "episodes": 1, "alone_rounds": 1, "alone_episodes": 1}
    with pytest.raises(InputError, match="linear"):
        DistillationConfig(**few, settings=settings)
    DistillationConfig(**few, settings=settings, collector="symbolic")

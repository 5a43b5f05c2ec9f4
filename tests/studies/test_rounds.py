"""The plan of a distillation: rounds, episodes, what is held out, and whose samples are shared."""

from dataclasses import replace

import numpy as np
import pytest

from glassgait.models.errors import InputError
from glassgait.models.policies.library import load_expert
from glassgait.models.task.gait import load_gait
from glassgait.studies.distillation.config import DistillationConfig, rounds
from glassgait.studies.distillation.students.dataset import Dataset
from glassgait.studies.distillation.students.library import samples_folder
from glassgait.studies.distillation.students.settings import StudentsSettings
from glassgait.studies.distillation.students.symbolic_regression import SymbolicSettings
from glassgait.studies.distillation.study import distill

GAIT = load_gait("trot")


def test_whole_episodes_are_held_out():
    episodes = np.repeat(np.arange(1, 31), 3)
    dataset = Dataset(np.zeros((90, 2)), np.zeros((90, 12)), episodes)
    held_out = set(episodes[dataset.held_out])
    assert len(held_out) == 6
    assert not held_out & set(episodes[~dataset.held_out])
    assert {(episode - 1) % 4 for episode in held_out} == {0, 1, 2, 3}


@pytest.mark.parametrize(
    ("curriculum", "periods"),
    [
        ("alternation", [1, 2, 3, 4]),
        ("student_only", [1, 0, 0, 0]),
        ("expert_only", [1, 1, 1, 1]),
        ("half", [1, 2, 2, 2]),
    ],
)
def test_curricula_say_how_often_the_expert_acts(curriculum, periods):
    config = DistillationConfig(curriculum=curriculum)
    planned = rounds(config.for_gait(GAIT), "linear")
    assert [own.period for own in planned[:4]] == periods
    assert len(planned) == 16
    assert [own.period for own in planned[8:]] == [0] * 8


def test_rounds_hold_every_episode_once():
    config = DistillationConfig(
        episodes=10, episodes_per_round=4, alone_rounds=2, alone_episodes=4, alone_steps=90
    )
    planned = rounds(config, "linear")
    assert [own.number for own in planned] == [1, 2, 3, 4, 5]
    assert [own.steps for own in planned] == [1000, 1000, 1000, 90, 90]
    assert {own.steps for own in rounds(config, "symbolic")} == {1000}
    assert [list(own.episodes) for own in planned] == [
        [1, 2, 3, 4],
        [5, 6, 7, 8],
        [9, 10],
        [11, 12, 13, 14],
        [15, 16, 17, 18],
    ]
    settings = StudentsSettings(symbolic=SymbolicSettings(alone_episodes=6))
    planned = rounds(replace(config, settings=settings), "symbolic")
    alone = [list(own.episodes) for own in planned[2:]]
    assert alone == [[9, 10], [11, 12, 13, 14, 15, 16], [17, 18, 19, 20, 21, 22]]


def test_episodes_of_one_ratio_may_have_a_student_each():
    config = DistillationConfig(
        episodes=7, episodes_per_round=4, episodes_per_fit=2, alone_rounds=1, alone_episodes=4
    )
    planned = rounds(config, "linear")
    assert [own.number for own in planned] == [1, 2, 3, 4, 5]
    assert [own.period for own in planned] == [1, 1, 2, 2, 0]
    assert [list(own.episodes) for own in planned[:4]] == [[1, 2], [3, 4], [5, 6], [7]]
    with pytest.raises(InputError, match="episodes_per_fit"):
        DistillationConfig(episodes_per_round=4, episodes_per_fit=3)


def test_each_student_may_collect_its_own_samples():
    assert DistillationConfig().collector_of("gbm") == "histogram_gbm"
    assert DistillationConfig(collector="itself").collector_of("gbm") == "gbm"
    assert DistillationConfig(collector="linear").collector_of("gbm") == "linear"


def test_machines_of_more_states_ask_for_more_episodes_alone():
    def alone(gait, config):
        machine = load_gait(gait)
        return len(rounds(config.for_gait(machine), "ebm")[-1].episodes)

    sizes = {gait: alone(gait, DistillationConfig()) for gait in ("trot", "walk", "half_bound")}
    assert sizes == {"trot": 16, "walk": 48, "half_bound": 48}
    assert alone("walk", DistillationConfig(alone_episodes=5)) == 5


def test_starts_are_the_first_steps_of_every_episode():
    episodes = np.repeat([3, 4, 6], [7, 3, 9])
    starts = Dataset(np.zeros((19, 2)), np.zeros((19, 12)), episodes).starts
    assert np.flatnonzero(starts).tolist() == [0, 1, 2, 3, 4, 7, 8, 9, 10, 11, 12, 13, 14]


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
        n_workers=1,
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
    assert [tuple(table["student"]) for table in tables] == [STUDENTS[:1], STUDENTS[:2], STUDENTS]


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


@pytest.mark.parametrize(
    ("arguments", "own"),
    [
        (["--students", "sparse_formula", "symbolic"], "--sparse-formula.alone-episodes"),
        (["--students", "gbm", "--collector", "symbolic"], "--symbolic.alone-episodes"),
    ],
)
def test_episodes_alone_that_count_for_nothing_are_refused(arguments, own, tmp_path, refused):
    message = refused(["distill", *arguments, "--alone-episodes", "5", "--output", str(tmp_path)])
    assert "--alone-episodes: counts for nothing" in message and own in message


def test_episodes_alone_that_one_student_takes_are_allowed():
    DistillationConfig(students=("gbm", "symbolic"), alone_episodes=5).refuse_idle()

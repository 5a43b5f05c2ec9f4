"""Distillation: Algorithm 1, its rounds and students, exact resume, and what goes wrong."""

import shutil
from dataclasses import replace

import numpy as np
import pytest
from joblib import parallel_config

from glassgait.models.errors import InputError
from glassgait.models.policies.library import load_policy, policy_path
from glassgait.models.task.gait import load_gait
from glassgait.models.task.observation import overdue
from glassgait.studies.distillation.config import DistillationConfig, StudentsSettings, rounds
from glassgait.studies.distillation.dataset import Dataset, load_rounds
from glassgait.studies.distillation.students import load_students, samples_folder
from glassgait.studies.distillation.study import distill, write_r2_table
from glassgait.studies.distillation.symbolic import SymbolicSettings, fit_symbolic

GAIT = load_gait("trot")


@pytest.fixture
def copied(distilled, tmp_path):
    """A copy of the finished distillation."""
    return shutil.copytree(distilled, tmp_path / "run")


@pytest.fixture
def resume(tiny_distillation, expert):
    def again(folder, **settings):
        return distill(replace(tiny_distillation, **settings), GAIT, expert, folder, resume=True)

    return again


def test_whole_episodes_are_held_out():
    episodes = np.repeat(np.arange(1, 31), 3)
    dataset = Dataset(np.zeros((90, 2)), np.zeros((90, 12)), episodes)
    held_out = set(episodes[dataset.held_out])
    assert len(held_out) == 6
    assert not held_out & set(episodes[~dataset.held_out])
    assert {(episode - 1) % 4 for episode in held_out} == {0, 1, 2, 3}


def test_rounds_hold_every_episode_once():
    config = DistillationConfig(
        episodes=10, episodes_per_round=4, alone_rounds=2, alone_episodes=4, alone_steps=90
    )
    planned = rounds(config, "linear")
    assert [plan.steps for plan in planned] == [1000, 1000, 1000, 90, 90]
    episodes = [list(plan.episodes) for plan in planned]
    assert episodes == [[1, 2, 3, 4], [5, 6, 7, 8], [9, 10], [11, 12, 13, 14], [15, 16, 17, 18]]
    settings = StudentsSettings(symbolic=SymbolicSettings(alone_episodes=6))
    planned = rounds(replace(config, settings=settings), "symbolic")
    assert {plan.steps for plan in planned} == {1000}
    assert [plan.episodes for plan in planned[3:]] == [range(11, 17), range(17, 23)]


def test_episodes_of_one_ratio_may_have_a_student_each():
    config = DistillationConfig(
        episodes=7, episodes_per_round=4, episodes_per_fit=2, alone_rounds=1, alone_episodes=4
    )
    planned = rounds(config, "linear")
    assert [plan.period for plan in planned] == [1, 1, 2, 2, 0]
    assert [list(plan.episodes) for plan in planned[:4]] == [[1, 2], [3, 4], [5, 6], [7]]


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"episodes_per_round": 4, "episodes_per_fit": 3}, "episodes_per_fit"),
        ({"students": ("linear",), "episodes": 2, "alone_rounds": 0}, "linear"),
        ({"students": ("nonesuch",)}, "students"),
        ({"alone_steps": 1}, "alone_steps"),
    ],
)
def test_settings_that_cannot_be_are_refused(settings, message):
    with pytest.raises(InputError, match=message):
        DistillationConfig(**settings)


@pytest.mark.parametrize(("gait", "terms"), [("trot", 493), ("walk", 23)])
def test_settings_that_do_not_fit_a_gait_are_refused_before_anything_is_made(
    gait, terms, tmp_path, refused
):
    (tmp_path / "few.yaml").write_text(f"settings: {{formulas: {{terms: {terms}}}}}")
    options = ["--gait", gait, "--students", "formulas", "--settings", str(tmp_path / "few.yaml")]
    message = refused(["distill", *options, "--output", str(tmp_path / "run")])
    assert f"terms is {terms};" in message and gait in message
    assert not (tmp_path / "run").exists()


def test_machines_of_more_states_ask_for_more_episodes_alone():
    def alone(gait, config):
        return len(rounds(config.for_gait(load_gait(gait)), "ebm")[-1].episodes)

    assert [alone(gait, DistillationConfig()) for gait in ("trot", "walk")] == [16, 48]
    assert alone("walk", DistillationConfig(alone_episodes=5)) == 5


def test_default_formulas_suit_an_expert_that_is_not_symmetric():
    config, free = DistillationConfig(students=("formulas",)), load_gait("free")
    assert config.for_gait(free, symmetric=False).settings.formulas.terms == 100
    with pytest.raises(InputError, match="set 6 to 84"):
        config.for_gait(free)


def test_a_student_may_learn_from_the_samples_of_another(expert, tmp_path):
    assert DistillationConfig().collector_of("gbm") == "histogram_gbm"
    assert DistillationConfig(collector="itself").collector_of("gbm") == "gbm"
    assert samples_folder(tmp_path, "gbm") == tmp_path / "histogram_gbm"
    config = DistillationConfig(
        students=("linear", "linear_per_state"),
        collector="linear",
        episodes=5,
        alone_rounds=0,
        episode_steps=20,
    )
    table = distill(config, GAIT, expert, tmp_path)
    assert {path.parent.name for path in tmp_path.rglob("round_*.safetensors")} == {"linear"}
    assert table["samples"].tolist() == [80, 80]
    assert samples_folder(tmp_path, "linear_per_state") == tmp_path / "linear"


def test_rounds_follow_the_paper(distilled):
    paths = (distilled / "linear" / f"round_{number:02d}.safetensors" for number in (1, 2))
    first, second = map(Dataset.load, paths)
    assert sorted(set(first.episodes)) == [1, 2, 3, 4]
    assert set(second.episodes) == {5}
    speeds = [first.observations[first.episodes == episode, 0] for episode in (1, 2, 3, 4)]
    for speed, values in zip((0.0, 0.25, 0.5, 0.75), speeds, strict=True):
        assert set(values) == {speed}


def test_every_student_is_made_scored_and_saved(distilled, tiny_distillation, expert):
    students = load_students(distilled, expert)
    assert list(students) == list(tiny_distillation.students)
    for name in ("metrics.json", "r2.csv", "r2.md", "config.yaml"):
        assert (distilled / name).exists()
    for kind, student in students.items():
        assert student.digest() == student.compact().digest(), kind


def test_models_are_small_while_samples_are_collected(distilled, tiny_distillation):
    policy = load_policy(distilled / "ebm.safetensors")
    # Bands between bags come with the last fit only.
    assert policy.deviations.max() > 0
    assert len(policy.pairs) == 12
    ebm = tiny_distillation.settings.of("ebm")
    assert ebm.for_rounds().outer_bags == ebm.for_shuffled_split().outer_bags == 1
    assert ebm.for_rounds().interactions == 0
    assert DistillationConfig().settings.of("histogram_gbm").for_rounds().n_trees == 150


def test_samples_of_starts_and_of_robots_that_wait_count_more(distilled, expert):
    samples = load_rounds(distilled / "linear").training_set(GAIT, expert)
    waits = overdue(samples.observations, samples.observation_names)
    assert len(samples.with_overdue(3).actions) == len(waits) + 2 * waits.sum() > len(waits)
    repeated = samples.subset(np.repeat(np.arange(len(waits)), np.where(samples.starts, 5, 1)))
    settings = (SymbolicSettings(shapes=((20, 20),), start_weights=(weight,)) for weight in (5, 1))
    found = [
        fit_symbolic(given, one, seed=0).to_text()
        for given, one in zip((samples, repeated), settings, strict=True)
    ]
    assert found[0] == found[1]


@pytest.mark.slow
def test_students_that_are_made_side_by_side_are_the_same(
    distilled, tiny_distillation, expert, tmp_path
):
    with parallel_config("loky", n_jobs=2):
        write_r2_table(distill(tiny_distillation, GAIT, expert, tmp_path), "trot", tmp_path)
    assert (tmp_path / "metrics.json").read_text() == (distilled / "metrics.json").read_text()
    for kind in tiny_distillation.students:
        made = policy_path(tmp_path, kind)
        assert made.read_bytes() == policy_path(distilled, kind).read_bytes()


def test_a_run_cut_short_and_resumed_ends_the_same(distilled, copied, resume):
    (copied / "metrics.json").unlink()
    for path in ("gbm/record.json", "gbm.safetensors", "histogram_gbm/round_02.safetensors"):
        (copied / path).unlink()
    shutil.rmtree(copied / "linear")
    write_r2_table(resume(copied), "trot", copied)
    assert (copied / "metrics.json").read_text() == (distilled / "metrics.json").read_text()


def test_a_damaged_student_beside_a_good_record_is_refused(distilled, copied, resume):
    path = copied / "linear.safetensors"
    path.write_bytes(path.read_bytes()[:-9] + b"nonsense!")
    with pytest.raises(InputError, match=r"linear\.safetensors"):
        resume(copied)
    (copied / "linear" / "record.json").unlink()
    resume(copied)
    assert path.read_bytes() == (distilled / "linear.safetensors").read_bytes()


def test_a_finished_folder_is_not_overwritten(
    distilled, tiny_distillation, expert, other_expert, resume
):
    with pytest.raises(InputError, match="--resume"):
        distill(tiny_distillation, GAIT, expert, distilled)
    with pytest.raises(InputError, match="seed"):
        resume(distilled, seed=1)
    with pytest.raises(InputError, match="expert"):
        distill(tiny_distillation, GAIT, other_expert, distilled, resume=True)


@pytest.mark.parametrize("name", ["linear/record.json", "linear/round_01.safetensors"])
def test_damaged_work_is_refused(name, copied, resume):
    if "round" in name:
        (copied / "linear" / "record.json").unlink()
    data = bytearray((copied / name).read_bytes())
    data[len(data) // 2] = 0
    (copied / name).write_bytes(data)
    with pytest.raises(InputError, match="is damaged"):
        resume(copied)

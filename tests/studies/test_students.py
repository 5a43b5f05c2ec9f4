"""The students that ship, and where students are found: they load, and walk alone."""

import re
import shutil

import numpy as np
import pytest

from glassgait.diagrams.scenario import Scenario
from glassgait.models.errors import InputError
from glassgait.models.policies.controller import alone
from glassgait.models.policies.library import (
    STUDENT_DIRECTORY,
    load_expert,
    load_student,
    load_student_of,
    recorded_expert,
    shipped_experts,
    shipped_students,
)
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.models.task.gait import load_gait
from glassgait.studies.common.policies import find_policies
from glassgait.studies.common.rollouts import RolloutConfig, roll_out
from glassgait.studies.common.settings_file import read_settings
from glassgait.studies.distillation.config import DistillationConfig
from glassgait.studies.distillation.students import default_student, load_students

SHIPPED = [
    pytest.param(gait, kind, marks=() if gait == "trot" else pytest.mark.slow)
    for gait in shipped_experts()
    for kind in shipped_students(gait)
]


@pytest.mark.parametrize(("gait", "kind"), SHIPPED)
def test_a_shipped_student_walks_alone(gait, kind):
    expert, student = load_expert(gait), load_student(gait, kind)
    student.check(gait=gait, observation_names=expert.observation_names)
    config = RolloutConfig(n_robots=2, n_steps=100, seed=8)
    log = roll_out(load_gait(gait), alone(student, expert), Scenario(), config)
    assert not log.failures.any()
    assert np.abs(log.velocity[50:, :, 0] - log.command[50:, :, 0]).mean() < 0.25


@pytest.mark.parametrize(("gait", "kind"), SHIPPED)
def test_shipped_formulas_are_what_their_files_say(gait, kind):
    student = load_student(gait, kind)
    if isinstance(student, FormulaPolicy):
        text = (STUDENT_DIRECTORY / gait / f"{kind}.formulas").read_text()
        assert student.to_text() == text
        digits = re.findall(r"[-+*( ](\d[\d.]*)(?:e[-+]?\d+)?\b", text.partition("state")[2])
        assert max(len(number.replace(".", "").strip("0")) for number in digits) <= 3


@pytest.mark.parametrize("gait", shipped_experts())
def test_records_name_the_expert_that_ships(gait):
    assert recorded_expert(STUDENT_DIRECTORY / gait)[1] == load_expert(gait).digest()
    for record in (STUDENT_DIRECTORY / gait).glob("*.yaml"):
        if "study: distill" in record.read_text():
            assert read_settings(DistillationConfig(), record).gait == gait
    assert load_student(gait, "gbm").observes_by == load_expert(gait).digest()


def test_a_shipped_student_does_not_walk_behind_another_experts_estimator(other_expert, tmp_path):
    with pytest.raises(InputError, match="expert"):
        load_student_of(other_expert, STUDENT_DIRECTORY / "trot" / "gbm.safetensors")
    shutil.copytree(STUDENT_DIRECTORY / "trot", tmp_path / "run")
    other_expert.save(tmp_path / "run" / "trot.safetensors")
    with pytest.raises(InputError, match="expert"):
        find_policies(load_gait("trot"), tmp_path / "run").controller("gbm")


def test_a_student_of_a_folder_is_given_the_expert_that_its_record_names(
    expert, other_expert, tmp_path
):
    path = tmp_path / "gbm.safetensors"
    load_student("trot", "gbm").save(path)
    # Without a record, its expert is the one that is given.
    assert load_student_of(other_expert, path).observes_by == other_expert.digest()
    write_record = (tmp_path / "config.yaml").write_text
    write_record(f"inputs: {{expert: {expert.digest()}}}")
    assert load_student_of(expert, path).estimator is expert.estimator
    for load in (
        lambda: load_student_of(other_expert, path),
        lambda: load_students(tmp_path, other_expert),
    ):
        with pytest.raises(InputError, match=rf"{expert.digest()} \(.*config"):
            load()


OF_GAITS = [
    pytest.param(gait, marks=() if gait in ("trot", "bound") else pytest.mark.slow)
    for gait in shipped_experts()
    if shipped_students(gait)
]


def test_folders_without_students_are_refused(expert, tmp_path):
    with pytest.raises(InputError, match="holds no students"):
        load_students(tmp_path, expert)


@pytest.mark.parametrize("gait", OF_GAITS)
def test_where_no_student_is_named_a_shipped_one_can_be_explained(gait, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    kind = default_student(find_policies(load_gait(gait)))
    assert kind in shipped_students(gait)
    student = load_student(gait, kind)
    parts = student.explain(np.zeros(len(student.observation_names)), 0)
    assert len(parts.terms) > 1


def test_where_no_student_is_named_the_named_folders_is_taken(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    load_student("trot", "gbm").save(tmp_path / "gbm.safetensors")
    with pytest.raises(InputError, match="a sum of terms"):
        default_student(find_policies(load_gait("trot"), tmp_path))
    load_student("trot", "linear_per_state").save(tmp_path / "linear_per_state.safetensors")
    assert default_student(find_policies(load_gait("trot"), tmp_path)) == "linear_per_state"

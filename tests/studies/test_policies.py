"""The one rule by which commands find policies."""

from dataclasses import replace

import pytest

from glassgait.diagrams.domain_randomization import DomainRandomization
from glassgait.models.errors import InputError
from glassgait.models.estimation.odometry import Odometry
from glassgait.models.policies.library import (
    STUDENT_DIRECTORY,
    find_gait,
    load_expert,
    load_student,
)
from glassgait.models.task.gait import GAIT_DIRECTORY, load_gait
from glassgait.studies.common.arguments import KINDS
from glassgait.studies.common.policies import find_policies
from glassgait.studies.common.run import default_folder
from glassgait.studies.distillation.config import DistillationConfig
from glassgait.studies.distillation.students import STUDENTS
from glassgait.studies.distillation.study import distill

TROT = load_gait("trot")
SUM = "symbolic_per_state"


@pytest.fixture
def own_gait(tmp_path, monkeypatch):
    """A gait that does not ship, in an empty folder to work in."""
    monkeypatch.chdir(tmp_path)
    text = (GAIT_DIRECTORY / "trot.yaml").read_text().replace("name: trot", "name: prance")
    (tmp_path / "prance.yaml").write_text(text)
    return load_gait("prance.yaml")


def keep(policy, folder, name, gait=None):
    if gait is not None:
        policy.gait = gait
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{name}{policy.suffix}"
    policy.save(path)
    return path


def test_what_ships_is_taken_unless_a_run_is_named(tmp_path, monkeypatch, expert, capsys):
    monkeypatch.chdir(tmp_path)
    own = keep(load_student("trot", "symbolic"), tmp_path / "runs/distill/trot", SUM)
    shipped = find_policies(TROT)
    assert shipped.file(SUM).parent == STUDENT_DIRECTORY / "trot"
    assert capsys.readouterr().err.startswith("· trot: policies from shipped")
    run = find_policies(TROT, own.parent.relative_to(tmp_path))
    assert run.policy(SUM).digest() == load_student("trot", "symbolic").digest()
    assert "runs/distill/trot" in capsys.readouterr().err
    assert run.expert.digest() == shipped.expert.digest() == expert.digest()


def test_students_of_a_run_act_beside_the_expert_of_their_record(tmp_path, other_expert):
    config = DistillationConfig(
        students=("linear",),
        episodes=5,
        alone_rounds=0,
        episode_steps=20,
        worlds=DomainRandomization(n_groups=1, mujoco_share=0.0),
    )
    distill(config, TROT, other_expert, tmp_path / "run")
    (tmp_path / "run").rename(tmp_path / "moved")
    found = find_policies(TROT, tmp_path / "moved")
    assert list(found.files) == ["linear"]
    assert found.controller("linear").expert.digest() == other_expert.digest()
    # The same file, beside the policies that ship.
    path = str(tmp_path / "moved" / "linear.safetensors")
    assert find_policies(TROT).controller(path).expert.digest() == other_expert.digest()
    (tmp_path / "moved" / "expert.safetensors").unlink()
    with pytest.raises(InputError, match="uses the estimator"):
        find_policies(TROT, tmp_path / "moved").policy("linear")


def test_the_default_folders_hold_the_policies_of_a_gait_that_does_not_ship(own_gait, tmp_path):
    nothing = find_policies(own_gait)
    for name in ("all", "symbolic"):
        with pytest.raises(InputError, match="--source"):
            nothing.controllers([name])
    keep(load_expert("trot"), tmp_path / "runs/train/prance", "prance", "prance")
    assert find_policies(own_gait).place == "runs/train/prance"
    folder = tmp_path / "runs/distill/prance"
    keep(load_student("trot", "symbolic"), folder, "symbolic", "prance")
    with pytest.raises(InputError, match="the students' expert is not found"):
        find_policies(own_gait)
    keep(load_expert("trot"), folder, "expert", "prance")
    found = find_policies(own_gait)
    assert found.place == "runs/distill/prance"
    assert str(found.expert_file) == "runs/distill/prance/expert.safetensors"
    assert found.controller("symbolic").expert.gait == "prance"


def test_a_gait_of_ones_own_that_was_edited_has_no_policies(own_gait, tmp_path):
    folder = tmp_path / "runs/train/prance"
    keep(load_expert("trot"), folder, "prance", "prance")
    record = "study: train\ninputs:\n  gait: {}\n"
    (folder / "config.yaml").write_text(record.format(own_gait.digest()))
    assert find_policies(own_gait).expert.gait == "prance"
    with pytest.raises(InputError, match="made for another prance"):
        find_policies(replace(own_gait, dwell=(6, 12)))


def test_formulas_that_hold_all_they_need_act_without_an_expert(own_gait, tmp_path):
    text = load_student("trot", "formulas").to_text().replace("gait: trot", "gait: prance")
    (path := tmp_path / "whole.formulas").write_text(text)
    found = find_policies(find_gait(path))
    assert found.optional_expert is None
    controller = found.controller(str(path))
    assert controller.student is None
    assert controller.estimator == Odometry(gain=0.15)
    assert found.expert_of(str(path)) is None
    assert found.output("view") == default_folder("view", "a1") / "prance"
    # Other formulas need an estimator, and other machines are other gaits.
    linear = keep(load_student("trot", "linear_per_state"), tmp_path, "own", "prance")
    with pytest.raises(InputError, match="needs its expert's estimator"):
        found.controller(str(linear))
    with pytest.raises(InputError, match="differs in 'dwell'"):
        find_policies(replace(find_gait(path), dwell=(6, 12))).controller(str(path))


def test_a_neural_file_acts_by_itself(tmp_path, other_expert):
    path = keep(other_expert, tmp_path, "still")
    controllers = find_policies(TROT).controllers(["expert", str(path)])
    assert list(controllers) == ["expert", "still"]
    assert controllers["still"].expert.digest() == other_expert.digest()
    assert controllers["still"].student is None


@pytest.mark.parametrize("name", ["nonesuch", "linear", "pages/page"])
def test_a_policy_that_is_not_there_is_refused(name):
    with pytest.raises(InputError, match=r"unknown .*policy .*gbm"):
        find_policies(TROT).policy(name)


def test_of_policies_of_one_name_the_second_is_called_by_its_path(tmp_path, other_expert):
    path = str(keep(other_expert, tmp_path, "expert"))
    found = find_policies(TROT).controllers(["expert", path])
    assert list(found) == ["expert", path]
    assert found[path].expert.digest() == other_expert.digest()


def test_students_are_in_the_order_of_tables():
    assert tuple(STUDENTS) == KINDS
    found = find_policies(TROT)
    assert list(found.files) == [kind for kind in STUDENTS if kind in found.files]
    assert found.expanded(["all"]) == ("expert", *found.files)


@pytest.mark.parametrize(
    "command", [["view"], ["export"], ["studio"], ["verify", "prove"], ["evaluate", "scenarios"]]
)
def test_a_gait_of_another_robots_formulas_is_refused(command, tmp_path, monkeypatch, refused):
    if command == ["studio"]:
        pytest.importorskip("nicegui")
    monkeypatch.chdir(tmp_path)
    theirs = STUDENT_DIRECTORY / "go2" / "trot" / "formulas.formulas"
    assert "go2" in refused([*command, "--gait", str(theirs), "--robot", "a1"])

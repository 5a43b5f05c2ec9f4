"""The one rule by which commands find policies."""

import pytest

from glassgait.diagrams.domain_randomization import DomainRandomization
from glassgait.models.errors import InputError
from glassgait.models.policies.library import STUDENT_DIRECTORY, load_expert, load_student
from glassgait.models.task.gait import GAIT_DIRECTORY, load_gait
from glassgait.studies.common.policies import ORDER, find_policies, find_policies_of
from glassgait.studies.distillation.config import DistillationConfig
from glassgait.studies.distillation.students.registry import STUDENTS
from glassgait.studies.distillation.study import distill

TROT = load_gait("trot")
SUM = "statewise_symbolic"


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


def test_students_are_in_the_order_of_the_registry():
    found = find_policies(TROT)
    assert list(found.files) == [kind for kind in STUDENTS if kind in found.files]
    assert found.named(["all"]) == ("expert", *found.files)


def test_what_ships_is_taken_unless_a_run_is_named(tmp_path, monkeypatch, expert, capsys):
    monkeypatch.chdir(tmp_path)
    own = keep(load_student("trot", "symbolic"), tmp_path / "runs/distill/trot", SUM)
    shipped = find_policies(TROT)
    assert shipped.file(SUM).parent == STUDENT_DIRECTORY / "trot"
    assert capsys.readouterr().err.startswith("· trot: policies are those that ship")
    run = find_policies(TROT, own.parent.relative_to(tmp_path))
    assert run.policy(SUM).digest() == load_student("trot", "symbolic").digest()
    assert "runs/distill/trot" in capsys.readouterr().err
    assert run.expert.digest() == shipped.expert.digest() == expert.digest()
    assert run.inputs()["source"] == "runs/distill/trot"
    digests = [own.inputs(own.controllers([SUM]).items())["policies"] for own in (shipped, run)]
    assert digests[0] != digests[1] and all(digest.startswith(SUM) for digest in digests)


def test_students_of_a_run_act_beside_the_expert_of_their_record(tmp_path, other_expert):
    config = DistillationConfig(
        students=("linear",),
        episodes=5,
        alone_rounds=0,
        episode_steps=20,
        worlds=DomainRandomization(n_groups=1, mujoco_share=0.0),
        n_workers=1,
    )
    distill(config, TROT, other_expert, tmp_path / "run", lambda line: None)
    (tmp_path / "run").rename(tmp_path / "moved")
    found = find_policies(TROT, tmp_path / "moved")
    assert list(found.files) == ["linear"]
    assert found.controller("linear").expert.digest() == other_expert.digest()
    # The same file, beside the policies that ship.
    path = str(tmp_path / "moved" / "linear.safetensors")
    assert find_policies(TROT).controller(path).expert.digest() == other_expert.digest()
    (tmp_path / "moved" / "expert.safetensors").unlink()
    with pytest.raises(InputError, match=r"inputs\.expert"):
        find_policies(TROT, tmp_path / "moved")


def test_the_default_folders_hold_the_policies_of_a_gait_that_does_not_ship(own_gait, tmp_path):
    with pytest.raises(InputError, match="--source"):
        find_policies(own_gait)
    expert = keep(load_expert("trot"), tmp_path / "runs/train/prance", "prance", "prance")
    assert find_policies(own_gait).place == "runs/train/prance"
    folder = tmp_path / "runs/distill/prance"
    keep(load_student("trot", "symbolic"), folder, "symbolic", "prance")
    found = find_policies(own_gait)
    assert found.place == "runs/distill/prance"
    assert found.expert_place == str(expert.parent.relative_to(tmp_path))
    assert found.controller("symbolic").expert.gait == "prance"


def test_files_that_are_named_are_not_said_to_ship(capsys):
    find_policies(TROT, names=["mine.formulas"])
    assert "policies are the files that are named" in capsys.readouterr().err
    find_policies(TROT, names=["mine.formulas", "gbm"])
    assert "policies are those that ship" in capsys.readouterr().err


def test_a_neural_file_acts_by_itself(tmp_path, other_expert):
    path = keep(other_expert, tmp_path, "still")
    controllers = find_policies(TROT).controllers(["expert", str(path)])
    assert list(controllers) == ["expert", "still"]
    assert controllers["still"].expert.digest() == other_expert.digest()
    assert controllers["still"].student is None


@pytest.mark.parametrize("name", ["nonesuch", "open_loop", "pages/page"])
def test_a_policy_that_is_not_there_is_refused(name):
    with pytest.raises(InputError, match=r"--policy.*gbm"):
        find_policies(TROT).policy(name)


def test_of_policies_of_one_name_the_second_is_called_by_its_path(tmp_path, other_expert):
    path = str(keep(other_expert, tmp_path, "expert"))
    found = find_policies(TROT).controllers(["expert", path])
    assert list(found) == ["expert", path]
    assert found[path].expert.digest() == other_expert.digest()


@pytest.mark.parametrize(("source", "names"), [(STUDENT_DIRECTORY, ()), (None, ["a.formulas"])])
def test_files_of_one_gait_are_refused_for_several(source, names):
    with pytest.raises(InputError, match="--gait"):
        find_policies_of([TROT, load_gait("pace")], source, names)


def test_every_student_has_its_place_in_tables():
    assert tuple(STUDENTS) == ORDER

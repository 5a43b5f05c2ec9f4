"""The C that `glassgait export` writes: sound, bounded, and the policy that it was made of."""

import json
import re
import subprocess
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from glassgait.models.errors import InputError
from glassgait.models.export.binding import (
    LoadedController,
    Sensors,
)
from glassgait.models.export.controller import write_controller
from glassgait.models.export.reference import PythonController
from glassgait.models.files import load_arrays, save_arrays
from glassgait.models.policies.library import (
    STUDENT_DIRECTORY,
    load_expert,
    load_policy,
    load_student,
)
from glassgait.models.robots.robot import load_robot
from glassgait.models.task.command import Command
from glassgait.models.task.gait import load_gait
from glassgait.studies.cli import main
from glassgait.studies.deployment.export import c_file
from glassgait.studies.deployment.export.agreement import (
    compare_controllers,
    random_sequences,
    recorded_sequences,
)
from glassgait.studies.deployment.export.closed_loop import by_controller, walk_both
from glassgait.studies.deployment.export.command import controller_name
from glassgait.studies.deployment.export.compiler import (
    FLAGS,
    compile_c,
    has_compiler,
    load_controller,
    write_source,
)

A1 = load_robot()


pytestmark = pytest.mark.skipif(not has_compiler(), reason="needs a C compiler, cc")

PAGE = Path(__file__).parents[2] / "studies" / "deployment" / "README.md"


def written(gait, kind):
    expert = load_expert(gait)
    policy = expert if kind == "expert" else load_student(gait, kind)
    names = {"name": f"{gait}_{kind}", "policy_name": kind, "version": "0"}
    return policy, expert, write_controller(load_gait(gait), policy, expert, **names)


@pytest.mark.slow
def test_ten_thousand_steps_agree_to_the_last_digits(trot, compiled_page):
    policy, expert = load_student("trot", "sparse_formula"), load_expert("trot")
    python = PythonController(trot, policy, expert)
    sequences = recorded_sequences(trot, policy, expert, 5000, 1)
    found = compare_controllers(
        python, compiled_page, sequences + random_sequences(A1, trot, 5000, 2)
    )
    assert found.steps == 10_000
    assert found.machine == 0
    assert found.changes > 500
    assert found.target < 1e-12


@pytest.mark.parametrize(
    ("gait", "kind"),
    [
        ("trot", "expert"),
        ("trot", "statewise_linear"),
        ("pace", "sparse_formula"),
        pytest.param("bound", "ebm", marks=pytest.mark.slow),
        pytest.param("trot", "gbm", marks=pytest.mark.slow),
    ],
)
def test_shipped_policies_agree(gait, kind, tmp_path):
    policy, expert, source = written(gait, kind)
    machine = load_gait(gait)
    compiled = load_controller(source, tmp_path)
    python = PythonController(machine, policy, expert)
    found = compare_controllers(python, compiled, random_sequences(A1, machine, 150, 0))
    assert found.machine == 0
    assert found.target < 1e-12


@pytest.mark.skipif(find_spec("mujoco") is None, reason="needs MuJoCo")
def test_robots_walk_alike_by_python_and_by_c(trot, compiled_page):
    policy, expert = load_student("trot", "sparse_formula"), load_expert("trot")
    table = walk_both(
        trot,
        policy,
        expert,
        by_controller(compiled_page),
        title="C",
        n_robots=2,
        n_steps=40,
        seed=3,
    )
    assert table["engine"].tolist() == ["Drake", "MuJoCo"]
    assert (table["return, Python"] > 0).all()
    assert (table["apart, robot (%)"] < 1e-3).all()
    assert table["falls, C"].tolist() == table["falls, Python"].tolist()


def test_another_library_is_refused(compiled_page, written_page, tmp_path):
    with pytest.raises(InputError, match="is no controller 'trot_sparse_formula'"):
        LoadedController(tmp_path / "none.so", written_page)


def test_the_command_writes_a_checked_file(tmp_path, capsys):
    folder = tmp_path / "run"
    main(["export", "--n-steps", "60", "--output", str(folder), "--name", "mine"])
    metrics = json.loads((folder / "metrics.json").read_text())
    assert [row["steps"] for row in metrics["agreement"]] == [30, 30]
    assert all(row["target"] < 1e-12 for row in metrics["agreement"])
    assert (folder / "mine.h").exists()
    assert metrics["bytes"] == (folder / "mine.c").stat().st_size
    assert "mine.c" in capsys.readouterr().out
    main(["export", "--n-steps", "60", "--output", str(folder), "--name", "mine", "--resume"])


def test_without_a_compiler_the_file_is_written_and_said_to_be_unchecked(
    tmp_path, monkeypatch, capsys
):
    monkeypatch.setattr(c_file, "has_compiler", lambda: False)
    main(["export", "--output", str(tmp_path / "run")])
    assert (tmp_path / "run" / "trot_sparse_formula.c").exists()
    assert "not compared with Python" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--policy", "oracle"], "--policy 'oracle'"),
        (["--policy", "mine.onnx"], "ending in .safetensors or .formulas"),
        (["--policy", "mine.formulas"], "no such file"),
        (["--name", "Mine"], "the controller's name is 'Mine'"),
        (["--gait", "gallop"], "unknown gait 'gallop'"),
        (["--n-steps", "0"], "n_steps is 0"),
    ],
)
def test_bad_arguments_are_told_and_nothing_is_written(
    arguments, message, tmp_path, monkeypatch, refused
):
    monkeypatch.chdir(tmp_path)
    assert message in refused(["export", *arguments])
    assert list(tmp_path.iterdir()) == []


def test_a_policy_of_another_gait_is_refused(tmp_path, refused):
    path = STUDENT_DIRECTORY / "pace" / "sparse_formula.formulas"
    told = refused(["export", "--policy", str(path), "--output", str(tmp_path / "run")])
    assert "made for gait 'pace', not 'trot'" in told
    assert list(tmp_path.iterdir()) == []


def test_a_policy_with_a_number_that_is_not_finite_is_refused(tmp_path, refused):
    policy = load_student("trot", "statewise_linear")
    path, run = tmp_path / "broken.safetensors", tmp_path / "run"
    policy.save(path)
    arrays, header = load_arrays(path)
    arrays["weights"] = np.full_like(arrays["weights"], np.nan)
    save_arrays(path, arrays, header)
    with pytest.raises(InputError):
        load_policy(path)
    assert "holds nan" in refused(["export", "--policy", str(path), "--output", str(run)])
    assert not run.exists()


def test_a_place_that_cannot_be_written_to_is_refused(tmp_path, refused):
    (tmp_path / "file").write_text("")
    told = refused(["export", "--output", str(tmp_path / "file" / "run")])
    assert "cannot be written to" in told
    assert (tmp_path / "file").read_text() == ""


def test_names_are_made_of_the_gaits_and_the_policys():
    assert controller_name("trot", "sparse_formula") == "trot_sparse_formula"
    assert controller_name("My gait-2", "übung") == "my_gait_2_bung"
    assert controller_name("2nd", "x" * 90).startswith("gait_2nd_xxx")
    assert len(controller_name("2nd", "x" * 90)) == 40


def test_the_pages_program_runs(compiled_page, written_page, tmp_path):
    program, *_ = re.findall(r"^```c\n(.*?)^```", PAGE.read_text(), flags=re.DOTALL | re.MULTILINE)
    source = write_source(written_page, tmp_path)
    own = tmp_path / "program.c"
    own.write_text(program)
    compile_c(own, tmp_path / "program", (*FLAGS, str(source)))
    done = subprocess.run([tmp_path / "program"], check=True, capture_output=True, text=True)
    sensors = Sensors(A1.default_stance, np.zeros(12), np.ones(4, dtype=bool))
    command = Command(np.array([0.5, 0.0]), np.array(8.0))
    target = compiled_page.step(compiled_page.initial(), sensors, command).targets[2]
    assert done.stdout == f"status 0\nfront left calf to {target:.3f} rad\n"

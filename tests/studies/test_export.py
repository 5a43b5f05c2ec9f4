"""`glassgait export` of one gait and of several: the C that it writes is the policy."""

import json
import re
import subprocess
from pathlib import Path

import numpy as np
import pytest

from glassgait.models.errors import InputError
from glassgait.models.export.binding import (
    BAD_INPUT,
    LoadedController,
    Sensors,
)
from glassgait.models.export.controller import write_controller
from glassgait.models.export.reference import PythonController
from glassgait.models.files import load_arrays, save_arrays
from glassgait.models.policies.controller import alone
from glassgait.models.policies.library import (
    STUDENT_DIRECTORY,
    load_expert,
    load_student,
)
from glassgait.models.robots.library import load_robot
from glassgait.models.task.command import Command
from glassgait.models.task.gait import load_gait
from glassgait.studies.cli import main
from glassgait.studies.export import closed_loop, files
from glassgait.studies.export.agreement import (
    compare_controllers,
    drawn_requests,
    random_sequences,
    recorded_sequences,
)
from glassgait.studies.export.closed_loop import by_controller, walk_both
from glassgait.studies.export.command import controller_name
from glassgait.studies.export.files import (
    FLAGS,
    compile_c,
    has_compiler,
    load_controller,
    write_source,
)

A1 = load_robot()


pytestmark = pytest.mark.skipif(not has_compiler(), reason="needs a C compiler, cc")

PAGE = Path(__file__).parents[2] / "studies" / "export" / "README.md"

SEVERAL = ["--gait", "trot", "walk"]

AT_REST = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.1962, 0.0, 0.0, -1.0])
"""What the IMU of a level robot at rest measures."""


def written(gait, kind):
    expert = load_expert(gait)
    policy = expert if kind == "expert" else load_student(gait, kind)
    names = {"name": f"{gait}_{kind}", "policy_name": kind, "version": "0"}
    controller = alone(policy, expert)
    return controller, write_controller(load_gait(gait), controller, **names)


@pytest.fixture
def one(trot, compiled_page):
    """The trot's page, in Python and in C."""
    own = alone(load_student("trot", "sparse_formula"), load_expert("trot"))
    return trot, own, compiled_page


@pytest.fixture
def several(switched_pages, compiled_pages):
    """The pages of several gaits, in Python and in C."""
    return switched_pages.switch, alone(switched_pages), compiled_pages


@pytest.mark.slow
@pytest.mark.parametrize("gaits", ["one", "several"])
def test_ten_thousand_steps_agree_to_the_last_digits(gaits, request):
    gait, controller, compiled = request.getfixturevalue(gaits)
    sequences = recorded_sequences(gait, controller, 5000, 1)
    sequences += random_sequences(A1, gait, 5000, 2)
    found = compare_controllers(PythonController(gait, controller), compiled, sequences)
    assert found.steps == 10_000
    assert found.machine == 0
    assert found.changes > 500
    assert found.target < 1e-12
    if gaits == "several":
        assert found.gaits is not None
        assert found.gaits > 200


def test_recorded_robots_change_their_gaits_and_agree(several):
    gait, controller, compiled = several
    sequences = recorded_sequences(gait, controller, 260, 1)
    found = compare_controllers(PythonController(gait, controller), compiled, sequences)
    assert (found.steps, found.machine, found.gaits) == (260, 0, 2)
    assert found.target < 1e-12


@pytest.mark.parametrize(
    ("gait", "kind"),
    [
        ("trot", "expert"),
        ("trot", "statewise_linear"),
        ("bound", "sparse_formula"),
        pytest.param("bound", "ebm", marks=pytest.mark.slow),
        pytest.param("trot", "gbm", marks=pytest.mark.slow),
    ],
)
def test_shipped_policies_agree(gait, kind, tmp_path):
    controller, source = written(gait, kind)
    machine = load_gait(gait)
    compiled = load_controller(source, tmp_path)
    python = PythonController(machine, controller)
    found = compare_controllers(python, compiled, random_sequences(A1, machine, 150, 0))
    assert found.machine == 0
    assert found.target < 1e-12


@pytest.mark.parametrize("gaits", ["one", pytest.param("several", marks=pytest.mark.slow)])
def test_robots_walk_alike_by_python_and_by_c(gaits, request, monkeypatch):
    monkeypatch.setattr(closed_loop, "REQUEST_STEPS", 30)
    gait, controller, compiled = request.getfixturevalue(gaits)
    n_robots, n_steps = (2, 40) if gaits == "one" else (3, 90)
    table = walk_both(
        gait,
        controller,
        by_controller(compiled),
        title="C",
        n_robots=n_robots,
        n_steps=n_steps,
        seed=3,
    )
    assert table["engine"].tolist() == ["Drake", "MuJoCo"]
    assert (table["return, Python"] > 0).all()
    assert (table["apart, robot (%)"] < 1e-3).all()
    assert table["falls, C"].tolist() == table["falls, Python"].tolist()
    assert ("changes, C" in table) == (gaits == "several")
    if gaits == "several":
        assert (table["changes, Python"] >= 4).all()
        assert table["changes, C"].tolist() == table["changes, Python"].tolist()
        assert not table["robots, RM state apart"].any()


def test_robots_that_move_otherwise_are_seen_to(several, monkeypatch):
    """Else the comparison could not fail: C is asked for the first gait alone."""
    monkeypatch.setattr(closed_loop, "REQUEST_STEPS", 30)
    monkeypatch.setattr(closed_loop, "WORLDS", {"Drake": "training"})
    gait, controller, compiled = several
    step = compiled.step
    monkeypatch.setattr(
        compiled, "step", lambda memory, sensors, command, *_: step(memory, sensors, command)
    )
    exported = by_controller(compiled)
    table = walk_both(gait, controller, exported, title="C", n_robots=2, n_steps=70, seed=3)
    assert (table["apart, robot (%)"] > 0.01).all()


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


def test_the_command_writes_a_checked_file_of_several_gaits(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    asked = ["--gait", "trot", "walk", "--policy", "sparse_formula"]
    arguments = ["export", *asked, "--n-steps", "120"]
    main(arguments)
    folder = tmp_path / "runs" / "export" / "trot_walk" / "sparse_formula"
    metrics = json.loads((folder / "metrics.json").read_text())
    assert [row["steps"] for row in metrics["agreement"]] == [60, 60]
    assert all(row["target"] < 1e-12 and not row["machine"] for row in metrics["agreement"])
    assert metrics["agreement"][1]["gaits"] > 0
    assert metrics["bytes"] == (folder / "trot_walk_sparse_formula.c").stat().st_size
    assert (
        "TROT_WALK_SPARSE_FORMULA_GAIT_WALK" in (folder / "trot_walk_sparse_formula.h").read_text()
    )
    assert "trot_walk_sparse_formula.c" in capsys.readouterr().out
    main([*arguments, "--resume"])


def test_without_a_compiler_the_file_is_written_and_said_to_be_unchecked(
    tmp_path, monkeypatch, capsys
):
    monkeypatch.setattr(files, "has_compiler", lambda: False)
    main(["export", "--output", str(tmp_path / "run")])
    assert (tmp_path / "run" / "trot_sparse_formula.c").exists()
    assert "not compared with Python" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "key"),
    [
        (["--policy", "oracle"], "--policy"),
        (["--policy", "mine.onnx"], "--policy"),
        (["--policy", "mine.formulas"], "no such file"),
        (["--name", "Mine"], "name is 'Mine'"),
        (["--gait", "gallop"], "gait 'gallop'"),
        (["--n-steps", "0"], "n_steps"),
        ([*SEVERAL, "--format", "onnx"], "--format"),
        (["--gait", "trot", "trot"], "gait"),
        (["--gait", "trot", "three_one", "--policy", "sparse_formula"], "--policy"),
        ([*SEVERAL, "--source", "mine"], "no files of your own"),
        ([*SEVERAL, "--policy", "sparse_formula.formulas"], "no files of your own"),
        ([*SEVERAL, "--name", "Mine"], "name is 'Mine'"),
        (["--format", "onnx", "--name", "Mine"], "name is 'Mine'"),
    ],
)
def test_bad_arguments_are_refused_and_nothing_is_written(
    arguments, key, tmp_path, monkeypatch, refused
):
    monkeypatch.chdir(tmp_path)
    assert key in refused(["export", *arguments])
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("kind", ["c", "onnx"])
def test_policies_that_do_not_fit_and_places_that_are_none_are_refused(kind, tmp_path, refused):
    if kind == "onnx":
        pytest.importorskip("onnxruntime")
    export, run = ["export", "--format", kind, "--n-steps", "20"], tmp_path / "run"
    path = STUDENT_DIRECTORY / "bound" / "sparse_formula.formulas"
    message = refused([*export, "--policy", str(path), "--output", str(run)])
    assert "made for gait 'bound', not 'trot'" in message
    policy, broken = load_student("trot", "statewise_linear"), tmp_path / "broken.safetensors"
    policy.save(broken)
    arrays, header = load_arrays(broken)
    arrays["weights"] = np.full_like(arrays["weights"], np.nan)
    save_arrays(broken, arrays, header)
    message = refused([*export, "--policy", str(broken), "--output", str(run)])
    assert "holds nan" in message
    message = refused([*export, "--output", str(broken / "run")])
    assert "cannot be written to" in message
    assert [path.name for path in tmp_path.iterdir()] == ["broken.safetensors"]


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
    sensors = Sensors(A1.default_stance, np.zeros(12), np.ones(4, dtype=bool), AT_REST)
    command = Command(np.array([0.5, 0.0]), np.array(8.0))
    target = compiled_page.step(compiled_page.initial(), sensors, command).targets[2]
    assert done.stdout == f"status 0\nfront left calf to {target:.3f} rad\n"


def test_requests_are_for_another_gait_each_time(switched_pages):
    requested = drawn_requests(switched_pages.switch, 40, 95, 10, 3)
    assert requested.shape == (95, 40)
    assert not requested[:10].any()
    asked = requested[::10]
    assert np.all(asked[1:] != asked[:-1])
    assert np.all(np.diff(requested, axis=0)[np.arange(94) % 10 != 9] == 0)
    assert set(requested.ravel()) == {0, 1, 2}


def test_the_pages_lines_change_the_gait(switched_pages, tmp_path):
    """They stand in a program that is left out there."""
    text = PAGE.read_text().partition("## Several gaits")[2]
    (lines,) = re.findall(r"^```c\n(.*?)^```", text, flags=re.DOTALL | re.MULTILINE)
    (name,) = re.findall(r"^(\w+)_controller controller;$", lines, flags=re.MULTILINE)
    renamed = lines.replace(name, "pages").replace(name.upper(), "PAGES")
    names = {"name": "pages", "policy_name": "sparse_formula", "version": "0"}
    source = write_source(
        write_controller(switched_pages.switch, alone(switched_pages), **names), tmp_path
    )
    program = tmp_path / "program.c"
    program.write_text(
        f"""#include "pages.h"
        #include <stdio.h>
        static pages_sensors read_sensors(void)
        {{
            const pages_sensors standing = {{
                .joint_position = {{{", ".join(map(str, A1.default_stance))}}},
                .foot_contact = {{1, 1, 1, 1}},
                .velocity_change = {{0, 0, 0.1962}}, .gravity = {{0, 0, -1}}}};
            return standing;
        }}
        static void wait_20_ms(void) {{ }}
        static void drive(const pages_targets *targets) {{ (void)targets; }}
        int main(void)
        {{
            {renamed}
            printf("%d", controller.gait);
            command.gait = 3;
            return pages_step(&controller, &sensors, &command, &targets);
        }}"""
    )
    compile_c(program, tmp_path / "program", (*FLAGS, str(source)))
    done = subprocess.run([tmp_path / "program"], capture_output=True, text=True, check=False)
    assert done.returncode == BAD_INPUT
    assert done.stdout == str([gait.name for gait in switched_pages.switch.gaits].index("trot"))


def test_a_step_in_c_is_the_step_that_the_page_describes(switched_pages, compiled_pages):
    """A robot that stands has lost the walk's rhythm after twice the commanded steps."""
    sensors = Sensors(A1.default_stance, np.zeros(12), np.ones(4, dtype=bool), AT_REST)
    command = Command(np.array([0.3, 0.0]), np.array(8.0))
    memory, ran = compiled_pages.initial(), []
    for _ in range(20):
        memory = compiled_pages.step(memory, sensors, command, 1).memory
        ran.append(switched_pages.switch.gaits[compiled_pages.gait_of(memory)].name)
    assert ran == ["walk"] * 15 + ["trot"] * 5


def test_a_day_is_exported_and_compared_with_python(tmp_path):
    folder = tmp_path / "run"
    main(["export", "--day", "day", "--n-steps", "1000", "--output", str(folder)])
    recorded, drawn = json.loads((folder / "metrics.json").read_text())["agreement"]
    for row in (recorded, drawn):
        assert row["target"] < 1e-12
        assert (row["machine"], row["modes"]) == (0, 0)
        assert row["mode_changes"] > 3
    assert "_REQUEST_STAND" in next(folder.glob("*.h")).read_text()

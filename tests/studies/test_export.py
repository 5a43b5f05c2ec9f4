"""The C that `glassgait export` writes: sound, bounded, and the policy that it was made of."""

import json
import re
import shutil
import subprocess
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from glassgait.models.a1 import robot
from glassgait.models.errors import InputError
from glassgait.models.export.binding import (
    ACTION,
    BAD_INPUT,
    COMMAND_LIMITED,
    MACHINE,
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
from glassgait.models.task.command import Command
from glassgait.models.task.gait import load_gait
from glassgait.studies.cli import main
from glassgait.studies.export import command as export_command
from glassgait.studies.export.agreement import (
    compare_controllers,
    random_sequences,
    recorded_sequences,
)
from glassgait.studies.export.closed_loop import walk_both
from glassgait.studies.export.command import controller_name
from glassgait.studies.export.compiler import (
    FLAGS,
    compile_c,
    has_compiler,
    load_controller,
    write_source,
)

pytestmark = pytest.mark.skipif(not has_compiler(), reason="needs a C compiler, cc")

PAGE = Path(export_command.__file__).with_name("README.md")

SANITIZED = ("-g", "-O1", "-std=c99", "-fno-sanitize-recover=all")
SANITIZERS = "-fsanitize=address,undefined,float-cast-overflow,float-divide-by-zero"

DRIVER = """
#include "{name}.h"
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

static const double ODD[] = {{NAN, INFINITY, -INFINITY, 1e300, -1e300, 1e7, 1e6, -1e6, 1e-320, 0}};

static double drawn(void)
{{
    return rand() % 40 == 0 ? ODD[rand() % 10] : 6.0 * rand() / RAND_MAX - 3.0;
}}

int main(void)
{{
    {name}_controller controller;
    {name}_sensors sensors;
    {name}_command command;
    {name}_targets targets;
    int count[8] = {{0}};

    {name}_init(&controller);
    for (int k = 0; k < 4000; k++) {{
        const {name}_controller before = controller;
        for (int joint = 0; joint < 12; joint++) {{
            sensors.joint_position[joint] = drawn();
            sensors.joint_velocity[joint] = drawn();
        }}
        for (int foot = 0; foot < 4; foot++)
            sensors.foot_contact[foot] = rand() % 3 - 1;
        command.speed = drawn();
        command.yaw_rate = drawn();
        command.dwell = 4.0 * drawn();
        const int status = {name}_step(&controller, &sensors, &command, &targets);
        if (status < 0 || status > 7)
            return 2;
        count[status]++;
        for (int joint = 0; joint < 12; joint++) {{
            if (!isfinite(targets.joint_position[joint]))
                return 3;
            if ((status & 3) && controller.action[joint] != before.action[joint])
                return 4;
        }}
        if (rand() % 200 == 0)
            {name}_init(&controller);
    }}
    printf("%d %d", count[0] + count[4], count[1]);
    return 0;
}}
"""


def written(gait, kind):
    expert = load_expert(gait)
    policy = expert if kind == "expert" else load_student(gait, kind)
    names = {"name": f"{gait}_{kind}", "policy_name": kind, "version": "0"}
    return policy, expert, write_controller(load_gait(gait), policy, expert, **names)


@pytest.mark.slow
def test_ten_thousand_steps_agree_to_the_last_digits(trot, compiled_page):
    policy, expert = load_student("trot", "page"), load_expert("trot")
    python = PythonController(trot, policy, expert)
    sequences = recorded_sequences(trot, policy, expert, 5000, 1)
    found = compare_controllers(python, compiled_page, sequences + random_sequences(trot, 5000, 2))
    assert found.steps == 10_000
    assert found.machine == 0
    assert found.changes > 500
    assert found.target < 1e-12


@pytest.mark.parametrize(
    ("gait", "kind"),
    [
        ("trot", "expert"),
        ("trot", "statewise_linear"),
        ("pace", "page"),
        pytest.param("bound", "ebm", marks=pytest.mark.slow),
        pytest.param("trot", "gbm", marks=pytest.mark.slow),
    ],
)
def test_shipped_policies_agree(gait, kind, tmp_path):
    policy, expert, source = written(gait, kind)
    machine = load_gait(gait)
    compiled = load_controller(source, tmp_path)
    python = PythonController(machine, policy, expert)
    found = compare_controllers(python, compiled, random_sequences(machine, 150, 0))
    assert found.machine == 0
    assert found.target < 1e-12


@pytest.mark.parametrize(
    ("gait", "kind"), [("trot", "page"), pytest.param("walk", "ebm", marks=pytest.mark.slow)]
)
def test_no_input_leads_to_undefined_behaviour(gait, kind, tmp_path):
    _, _, source = written(gait, kind)
    path = write_source(source, tmp_path)
    driver, program = tmp_path / "driver.c", tmp_path / "driver"
    driver.write_text(DRIVER.format(name=source.name))
    try:
        compile_c(driver, program, (*SANITIZED, SANITIZERS, str(path)))
    except InputError as error:
        if "san" in str(error):
            pytest.skip("the compiler has no sanitizers")
        raise
    done = subprocess.run([program], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    sound, bad = map(int, done.stdout.split())
    assert sound > 1000
    assert bad > 500


@pytest.mark.parametrize("kind", ["page", "statewise_linear"])
def test_it_allocates_nothing_and_has_no_mutable_state(kind, tmp_path):
    if shutil.which("nm") is None:
        pytest.skip("needs nm")
    _, _, source = written("trot", kind)
    path = write_source(source, tmp_path)
    compile_c(path, tmp_path / "own.o", ("-O2", "-std=c99", "-c"))
    told = subprocess.run(["nm", tmp_path / "own.o"], check=True, capture_output=True, text=True)
    symbols = [line.split()[-2:] for line in told.stdout.splitlines()]
    shared = {name for kind, name in symbols if kind == "T"}
    assert shared == {f"{source.name}_init", f"{source.name}_step"}
    needed = {name for kind, name in symbols if kind == "U"} - {"_GLOBAL_OFFSET_TABLE_"}
    # gcc may call for what clears or copies memory, and for a stack that is overrun.
    own = {"memset", "memcpy", "__stack_chk_fail"}
    assert needed - own <= {"expm1", "tanh", "sin", "cos", "sincos"}
    assert not {kind for kind, _ in symbols} & set("bBdDcC")


def test_the_header_serves_c_plus_plus(written_page, tmp_path):
    if shutil.which("c++") is None:
        pytest.skip("needs a C++ compiler, c++")
    path = write_source(written_page, tmp_path)
    compile_c(path, tmp_path / "own.o", ("-O2", "-std=c99", "-c"))
    program = tmp_path / "program.cpp"
    program.write_text(
        '#include "trot_page.h"\n#include "trot_page.h"\n'
        "int main() { trot_page_controller c; trot_page_sensors s = {}; trot_page_targets t;\n"
        "const trot_page_command m = {0.5, 0.0, TROT_PAGE_MIN_DWELL};\n"
        "trot_page_init(&c); return trot_page_step(&c, &s, &m, &t); }\n"
    )
    command = ["c++", "-Wall", "-Wextra", "-Werror", "-pedantic", program, tmp_path / "own.o"]
    subprocess.run([*command, "-lm", "-o", tmp_path / "program"], check=True)
    assert subprocess.run([tmp_path / "program"], check=False).returncode == 0


@pytest.fixture
def moving(compiled_page, trot):
    """What a controller remembers in the midst of a sequence, and what it then reads."""
    memory = compiled_page.initial()
    *before, now = random_sequences(trot, 10, 4)[0]
    for moment in before:
        memory = compiled_page.step(memory, *moment).memory
    return memory, *now


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1.1e6])
@pytest.mark.parametrize("where", ["position", "velocity", "speed", "dwell"])
def test_bad_input_changes_nothing_and_is_told(value, where, moving, compiled_page):
    memory, sensors, command = moving
    position, velocity = sensors.joint_position.copy(), sensors.joint_velocity.copy()
    speeds, dwell = command.velocity.copy(), command.dwell
    match where:
        case "position":
            position[11] = value
        case "velocity":
            velocity[0] = value
        case "speed":
            speeds[0] = value
        case "dwell":
            dwell = value
    broken = Sensors(position, velocity, sensors.touching)
    step = compiled_page.step(memory, broken, Command(speeds, dwell))
    assert step.status == BAD_INPUT
    np.testing.assert_array_equal(step.memory, memory)
    np.testing.assert_array_equal(step.targets, robot.joint_targets(memory[ACTION]))


def test_commands_beyond_the_gaits_range_are_limited(moving, compiled_page):
    memory, sensors, _ = moving
    beyond = compiled_page.step(memory, sensors, Command(np.array([3.0, -9.0]), np.array(2.0)))
    limit = compiled_page.step(memory, sensors, Command(np.array([1.0, -1.0]), np.array(6.0)))
    assert (beyond.status, limit.status) == (COMMAND_LIMITED, 0)
    np.testing.assert_array_equal(beyond.targets, limit.targets)


def test_starts_in_the_default_stance_and_in_the_initial_state(compiled_page, trot):
    memory = compiled_page.initial()
    assert not memory.any()
    sensors, command = random_sequences(trot, 1, 0)[0][0]
    broken = Sensors(np.full(12, np.nan), sensors.joint_velocity, sensors.touching)
    step = compiled_page.step(memory, broken, command)
    np.testing.assert_array_equal(step.targets, robot.DEFAULT_STANCE)
    assert step.memory[MACHINE].tolist() == [0, 0, 0]


@pytest.mark.skipif(find_spec("mujoco") is None, reason="needs MuJoCo")
def test_robots_walk_alike_by_python_and_by_c(trot, compiled_page):
    policy, expert = load_student("trot", "page"), load_expert("trot")
    table = walk_both(trot, policy, expert, compiled_page, n_robots=2, n_steps=40, seed=3)
    assert table["engine"].tolist() == ["Drake", "MuJoCo"]
    assert (table["return, Python"] > 0).all()
    assert (table["apart, robot (%)"] < 1e-3).all()
    assert table["falls, C"].tolist() == table["falls, Python"].tolist()


def test_another_library_is_refused(compiled_page, written_page, tmp_path):
    with pytest.raises(InputError, match="is no controller 'trot_page'"):
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
    monkeypatch.setattr(export_command, "has_compiler", lambda: False)
    main(["export", "--output", str(tmp_path / "run")])
    assert (tmp_path / "run" / "trot_page.c").exists()
    assert "not compared with Python" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--policy", "oracle"], "unknown policy 'oracle'"),
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
    path = STUDENT_DIRECTORY / "pace" / "page.formulas"
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
    assert controller_name("trot", "page") == "trot_page"
    assert controller_name("My gait-2", "übung") == "my_gait_2_bung"
    assert controller_name("2nd", "x" * 90).startswith("gait_2nd_xxx")
    assert len(controller_name("2nd", "x" * 90)) == 40


def test_the_pages_program_runs(compiled_page, written_page, tmp_path):
    (program,) = re.findall(r"^```c\n(.*?)^```", PAGE.read_text(), flags=re.DOTALL | re.MULTILINE)
    source = write_source(written_page, tmp_path)
    own = tmp_path / "program.c"
    own.write_text(program)
    compile_c(own, tmp_path / "program", (*FLAGS, str(source)))
    done = subprocess.run([tmp_path / "program"], check=True, capture_output=True, text=True)
    sensors = Sensors(robot.DEFAULT_STANCE, np.zeros(12), np.ones(4, dtype=bool))
    command = Command(np.array([0.5, 0.0]), np.array(8.0))
    target = compiled_page.step(compiled_page.initial(), sensors, command).targets[2]
    assert done.stdout == f"status 0\nfront left calf to {target:.3f} rad\n"


def test_it_is_not_compiled_without_checks_for_nan(written_page, tmp_path):
    source = write_source(written_page, tmp_path)
    with pytest.raises(InputError, match="ffast-math"):
        compile_c(source, tmp_path / "own.o", ("-std=c99", "-ffast-math", "-c"))

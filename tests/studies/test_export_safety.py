"""What a controller in C does with input of any kind, and what it cannot do."""

import shutil
import subprocess

import numpy as np
import pytest

from glassgait.models.control import Sensors
from glassgait.models.errors import InputError
from glassgait.models.export.binding import (
    BAD_INPUT,
    BAD_MEMORY,
    BAD_TARGET,
    COMMAND_LIMITED,
    NOT_INITIALISED,
    compile_c,
    has_compiler,
    load_controller,
    write_source,
)
from glassgait.models.export.c_source import write_controller
from glassgait.models.formulas.reader import read_formulas
from glassgait.models.policies.controller import alone
from glassgait.models.policies.library import load_expert, load_student
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.models.robots import quadruped
from glassgait.models.robots.library import load_robot
from glassgait.models.task.command import Command, on_the_spot, sound_command
from glassgait.models.task.gait import load_gait
from glassgait.studies.export.agreement import compare_controllers, random_sequences

A1 = load_robot()


pytestmark = pytest.mark.skipif(not has_compiler(), reason="needs a C compiler, cc")

SHIPPED = ("formulas", "ebm", "gbm", "expert")

SANITIZED = ("-g", "-O1", "-std=c99", "-fno-sanitize-recover=all")
SANITIZERS = "-fsanitize=address,undefined,float-cast-overflow,float-divide-by-zero"

DRIVER = """
#include "{name}.h"
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const double ODD[] = {{NAN, INFINITY, -INFINITY, 1e300, -1e300, 1e7, 1e6, -1e6, 1e-320, 0}};

static double drawn(void)
{{
    return rand() % 40 == 0 ? ODD[rand() % 10] : 6.0 * rand() / RAND_MAX - 3.0;
}}

static int targets_beyond(const {name}_targets *targets)
{{
    for (int joint = 0; joint < 12; joint++) {{
        const double hip = joint % 3 == 0, calf = joint % 3 == 2;
        const double least = hip ? -0.8029 : calf ? -2.6965 : -1.0472;
        const double greatest = hip ? 0.8029 : calf ? -0.9163 : 4.1888;
        const double target = targets->joint_position[joint];
        if ({limited} && !(target >= least && target <= greatest))
            return 1;
    }}
    return 0;
}}

int main(void)
{{
    {name}_controller controller, before;
    {name}_sensors sensors;
    {name}_command command;
    {name}_targets targets;
    int count[32] = {{0}};

    {name}_init(&controller);
    for (int k = 0; k < 20000; k++) {{
        if (rand() % 50 == 0)
            ((unsigned char *)&controller)[rand() % sizeof controller] ^= 1 << rand() % 8;
        memcpy(&before, &controller, sizeof before);
        for (int joint = 0; joint < 12; joint++) {{
            sensors.joint_position[joint] = drawn();
            sensors.joint_velocity[joint] = drawn();
        }}
        for (int foot = 0; foot < 4; foot++)
            sensors.foot_contact[foot] = rand() % 3 - 1;
        for (int axis = 0; axis < 3; axis++) {{
            sensors.angular_velocity[axis] = drawn();
            sensors.velocity_change[axis] = drawn();
            sensors.gravity[axis] = drawn();
        }}
        command.speed = drawn();
        command.yaw_rate = drawn();
        command.dwell = 4.0 * drawn();
        const int status = {name}_step(&controller, &sensors, &command, &targets);
        if (status < 0 || status > 16 || (status > 7 && status != 8 && status != 16))
            return 2;
        count[status]++;
        for (int joint = 0; joint < 12; joint++) {{
            if (!isfinite(targets.joint_position[joint]))
                return 3;
            if ((status & 3) && controller.action[joint] != before.action[joint])
                return 4;
        }}
        if (status >= 8 && memcmp(&controller, &before, sizeof before))
            return 5;
        if (targets_beyond(&targets))
            return 6;
        if (status >= 8 || rand() % 200 == 0)
            {name}_init(&controller);
    }}
    printf("%d %d %d %d", count[0] + count[4], count[1], count[8], count[16]);
    return 0;
}}
"""


def written(gait, kind):
    names = {"name": f"{gait}_{kind}", "policy_name": kind, "version": "0"}
    expert = load_expert(gait)
    policy = expert if kind == "expert" else load_student(gait, kind)
    return write_controller(load_gait(gait), alone(policy, expert), **names)


def sound_and_bad(source, folder):
    """Takes steps with input and memory of any kind.

    Returns:
        Counts of steps that were sound, of bad input, of lost and of bad memory.
    """
    path = write_source(source, folder)
    driver, program = folder / "driver.c", folder / "driver"
    limited = int(source.joint_law.limited)
    driver.write_text(DRIVER.format(name=source.name, limited=limited))
    try:
        compile_c(driver, program, (*SANITIZED, SANITIZERS, str(path)))
    except InputError as error:
        if "san" in str(error):
            pytest.skip("the compiler has no sanitizers")
        raise
    done = subprocess.run([program], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return map(int, done.stdout.split())


@pytest.mark.slow
@pytest.mark.parametrize("kind", SHIPPED)
def test_no_input_leads_to_undefined_behaviour(kind, tmp_path):
    sound, bad, lost, damaged = sound_and_bad(written("trot", kind), tmp_path)
    assert sound > 5000
    assert bad > 2500
    assert lost > 0
    assert damaged > 0


@pytest.mark.parametrize(
    "kind", ["linear_per_state", *(pytest.param(kind, marks=pytest.mark.slow) for kind in SHIPPED)]
)
def test_it_allocates_nothing_and_has_no_mutable_state(kind, tmp_path):
    source = written("trot", kind)
    if shutil.which("nm") is None:
        pytest.skip("needs nm")
    path = write_source(source, tmp_path)
    compile_c(path, tmp_path / "own.o", ("-O2", "-std=c99", "-c"))
    reported = subprocess.run(
        ["nm", tmp_path / "own.o"], check=True, capture_output=True, text=True
    )
    symbols = [line.split()[-2:] for line in reported.stdout.splitlines()]
    shared = {name for kind, name in symbols if kind == "T"}
    assert shared == {f"{source.name}_init", f"{source.name}_step"}
    needed = {name for kind, name in symbols if kind == "U"} - {"_GLOBAL_OFFSET_TABLE_"}
    assert not needed & {"malloc", "calloc", "realloc", "free", "aligned_alloc", "alloca"}
    # gcc may call for what clears or copies memory, and for a stack that is overrun.
    own = {"memset", "memcpy", "__stack_chk_fail"}
    assert needed - own <= {"expm1", "tanh", "sin", "cos", "sincos", "sqrt"}
    assert not {kind for kind, _ in symbols} & set("bBdDcC")


def test_the_header_serves_c_plus_plus(written_page, tmp_path):
    if shutil.which("c++") is None:
        pytest.skip("needs a C++ compiler, c++")
    path = write_source(written_page, tmp_path)
    compile_c(path, tmp_path / "own.o", ("-O2", "-std=c99", "-c"))
    program = tmp_path / "program.cpp"
    program.write_text(
        '#include "trot_formulas.h"\n#include "trot_formulas.h"\n'
        "int main() { trot_formulas_controller c; trot_formulas_sensors s = {};\n"
        "trot_formulas_targets t;\n"
        "const trot_formulas_command m = {0.5, 0.0, TROT_FORMULAS_MIN_DWELL};\n"
        "trot_formulas_init(&c); return trot_formulas_step(&c, &s, &m, &t); }\n"
    )
    command = ["c++", "-Wall", "-Wextra", "-Werror", "-pedantic", program, tmp_path / "own.o"]
    subprocess.run([*command, "-lm", "-o", tmp_path / "program"], check=True)
    assert subprocess.run([tmp_path / "program"], check=False).returncode == 0


def same(one, other):
    """Returns whether two memories are equal, NaN included."""
    return all(np.array_equal(one[name], other[name], equal_nan=True) for name in one.dtype.names)


@pytest.fixture
def moving(compiled_page, trot):
    """What a controller remembers in the midst of a sequence, and what it then reads."""
    memory = compiled_page.initial()
    *before, now = random_sequences(A1, trot, 10, 4)[0]
    for moment in before:
        memory = compiled_page.step(memory, *moment).memory
    return memory, now.sensors, now.command


@pytest.mark.parametrize("value", [np.nan, -np.inf, 1.1e6])
@pytest.mark.parametrize(
    ("part", "place"),
    [("joint_position", 11), ("joint_velocity", 0), ("imu", 2), ("imu", 5), ("imu", 8)],
)
def test_bad_input_changes_nothing_and_is_reported(value, part, place, moving, compiled_page):
    memory, sensors, command = moving
    broken = getattr(sensors, part).copy()
    broken[place] = value
    step = compiled_page.step(memory, sensors._replace(**{part: broken}), command)
    assert step.status == BAD_INPUT
    assert same(step.memory, memory)
    kept = A1.joint_targets(memory["action"], limited=True)
    np.testing.assert_array_equal(step.targets, kept)


WILD = np.array([np.nan, np.inf, -np.inf, 1e300, -1e300, 1.1e6, 9e5, 1e-320])


@pytest.mark.parametrize(
    "kind", [pytest.param(kind, marks=pytest.mark.slow) for kind in SHIPPED] + ["linear_per_state"]
)
def test_c_and_python_agree_on_wild_sensors(kind, generator, trot, tmp_path):
    policy = load_expert("trot") if kind == "expert" else load_student("trot", kind)
    controller, wild = alone(policy, load_expert("trot")), []
    for moment in random_sequences(A1, trot, 400, 2)[0]:
        parts = [part.astype(float).copy() for part in moment.sensors]
        for part in (parts[place] for place in generator.permutation([0, 1, 3])[:1]):
            if not wild or generator.random() < 0.3:
                part[generator.integers(len(part))] = generator.choice(WILD)
        parts[2] = moment.sensors.touching
        wild.append(moment._replace(sensors=Sensors(*parts)))
    compiled = load_controller(written("trot", kind), tmp_path)
    found = compare_controllers(trot, controller, compiled, [wild])
    assert found.machine == 0
    assert found.target < 1e-9


def test_a_controller_that_was_not_initialised_says_so_and_stands(moving, compiled_page):
    memory, sensors, command = moving
    for byte in range(256):
        garbage = np.frombuffer(bytes([byte]) * memory.nbytes, memory.dtype).reshape(())
        step = compiled_page.step(garbage, sensors, command)
        assert step.status == NOT_INITIALISED
        np.testing.assert_array_equal(step.targets, A1.default_stance)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("action", np.nan),
        ("action", 1e7),
        ("foot_height", np.inf),
        ("footholds", np.nan),
        ("turning", np.inf),
        ("unchanged", -1),
        ("state", -1),
        ("state", 2),
        ("iterations", -3),
        ("age", 2_000_000_000),
    ],
)
def test_memory_that_no_step_leaves_is_refused_and_kept(field, value, moving, compiled_page):
    memory, sensors, command = moving
    damaged = memory.copy()
    damaged[field][(-1,) * damaged[field].ndim] = value
    step = compiled_page.step(damaged, sensors, command)
    assert step.status == BAD_MEMORY
    assert same(step.memory, damaged)
    np.testing.assert_array_equal(step.targets, A1.default_stance)


def test_commands_beyond_the_gaits_range_are_limited(moving, compiled_page):
    memory, sensors, _ = moving
    beyond = compiled_page.step(memory, sensors, Command(np.array([3.0, -9.0]), np.array(2.0)))
    limit = compiled_page.step(memory, sensors, Command(np.array([1.0, -1.0]), np.array(6.0)))
    assert (beyond.status, limit.status) == (COMMAND_LIMITED, 0)
    np.testing.assert_array_equal(beyond.targets, limit.targets)


@pytest.mark.parametrize("value", [np.nan, np.inf])
@pytest.mark.parametrize("place", [0, 1, 2])
def test_a_command_that_is_not_finite_is_to_step_on_the_spot(
    value, place, moving, compiled_page, trot
):
    memory, sensors, _ = moving
    numbers = np.array([0.5, 0.2, 8.0])
    numbers[place] = value
    bad = Command(numbers[:2], numbers[2])
    step = compiled_page.step(memory, sensors, bad)
    spot = compiled_page.step(memory, sensors, on_the_spot(trot))
    assert (step.status, spot.status) == (COMMAND_LIMITED, 0)
    assert same(step.memory, spot.memory) and not same(step.memory, memory)
    # Python takes such a command for the same one.
    for part, wanted in zip(sound_command(trot, bad), on_the_spot(trot), strict=True):
        np.testing.assert_array_equal(part, wanted)


def test_a_target_that_is_not_finite_is_held_and_reported(trot, tmp_path):
    lines = [f"{joint} = 0.1*q.{joint}" for joint in quadruped.JOINTS]
    lines[5] += " + 1/(cmd.v - 0.5)"
    text = "format: 2\ngait: trot\nstates: 2\nsenses: imu\nevery state\n" + "\n".join(lines)
    policy = FormulaPolicy.from_file(read_formulas(text))
    names = {"name": "pole", "policy_name": "pole", "version": "0"}
    source = write_controller(trot, alone(policy, load_expert("trot")), **names)
    compiled = load_controller(source, tmp_path)
    sensors = random_sequences(A1, trot, 1, 0)[0][0].sensors
    beside, pole = (Command(np.array([speed, 0.0]), np.array(8.0)) for speed in (0.6, 0.5))
    before = compiled.step(compiled.initial(), sensors, beside)
    step = compiled.step(before.memory, sensors, pole)
    assert (before.status, step.status) == (0, BAD_TARGET)
    # Time goes on.
    assert step.memory["age"] == before.memory["age"] + 1
    np.testing.assert_array_equal(step.targets, before.targets)


def test_it_is_not_compiled_without_checks_for_nan(written_page, tmp_path):
    source = write_source(written_page, tmp_path)
    with pytest.raises(InputError, match='#error "-ff'):
        compile_c(source, tmp_path / "own.o", ("-std=c99", "-ffast-math", "-c"))

"""`glassgait export` of several gaits: one C file, checked, and rolled out in Drake."""

import json
import re
import subprocess
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from glassgait.models.export.binding import BAD_INPUT, Sensors
from glassgait.models.export.reference import PythonSwitchingController
from glassgait.models.export.switching_controller import write_switching_controller
from glassgait.models.policies.library import STUDENT_DIRECTORY
from glassgait.models.robots.robot import load_robot
from glassgait.models.task.command import Command
from glassgait.studies.cli import main
from glassgait.studies.deployment.export import switching_loop
from glassgait.studies.deployment.export.agreement import compare_controllers
from glassgait.studies.deployment.export.compiler import (
    FLAGS,
    compile_c,
    has_compiler,
    write_source,
)
from glassgait.studies.deployment.export.switching_agreement import (
    drawn_requests,
    random_switching_sequences,
    recorded_switching_sequences,
)
from glassgait.studies.deployment.export.switching_loop import change_both

A1 = load_robot()


pytestmark = pytest.mark.skipif(not has_compiler(), reason="needs a C compiler, cc")

PAGE = Path(__file__).parents[2] / "studies" / "deployment" / "README.md"


@pytest.mark.slow
def test_ten_thousand_steps_agree_to_the_last_digits(switched_pages, compiled_pages):
    sequences = recorded_switching_sequences(switched_pages, 5000, 1)
    sequences += random_switching_sequences(A1, switched_pages.switch, 5000, 2)
    found = compare_controllers(
        PythonSwitchingController(switched_pages), compiled_pages, sequences
    )
    assert found.steps == 10_000
    assert found.machine == 0
    assert found.gaits is not None
    assert found.gaits > 200
    assert found.target < 1e-12


def test_recorded_robots_change_their_gaits_and_agree(switched_pages, compiled_pages):
    sequences = recorded_switching_sequences(switched_pages, 260, 1)
    found = compare_controllers(
        PythonSwitchingController(switched_pages), compiled_pages, sequences
    )
    assert (found.steps, found.machine, found.gaits) == (260, 0, 2)
    assert found.target < 1e-12


def test_requests_are_for_another_gait_each_time(switched_pages):
    requested = drawn_requests(switched_pages.switch, 40, 95, 10, 3)
    assert requested.shape == (95, 40)
    assert not requested[:10].any()
    asked = requested[::10]
    assert np.all(asked[1:] != asked[:-1])
    assert np.all(np.diff(requested, axis=0)[np.arange(94) % 10 != 9] == 0)
    assert set(requested.ravel()) == {0, 1, 2}


@pytest.mark.skipif(find_spec("mujoco") is None, reason="needs MuJoCo")
def test_robots_change_their_gaits_alike_by_python_and_by_c(
    switched_pages, compiled_pages, monkeypatch
):
    monkeypatch.setattr(switching_loop, "REQUEST_STEPS", 30)
    table = change_both(switched_pages, compiled_pages, n_robots=3, n_steps=90, seed=3)
    assert table["engine"].tolist() == ["Drake", "MuJoCo"]
    assert (table["return, Python"] > 0).all()
    assert (table["apart, robot (%)"] < 1e-3).all()
    assert (table["changes, Python"] >= 4).all()
    for what in ("falls", "changes"):
        assert table[f"{what}, C"].tolist() == table[f"{what}, Python"].tolist()
    assert not table["robots, RM state apart"].any()


def test_robots_that_move_otherwise_are_seen_to(switched_pages, compiled_pages, monkeypatch):
    """Else the comparison could not fail: C is asked for the first gait alone."""
    monkeypatch.setattr(switching_loop, "REQUEST_STEPS", 30)
    monkeypatch.setattr(switching_loop, "WORLDS", {"Drake": "training"})
    step = compiled_pages.step
    monkeypatch.setattr(
        compiled_pages, "step", lambda memory, sensors, command, _: step(memory, sensors, command)
    )
    table = change_both(switched_pages, compiled_pages, n_robots=2, n_steps=70, seed=3)
    assert (table["apart, robot (%)"] > 0.01).all()


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


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ["--gait", "trot", "walk", "--format", "onnx"],
            "an ONNX file holds the policy of one gait",
        ),
        (["--gait", "trot", "trot"], "gait is ('trot', 'trot')"),
        (["--gait", "trot", "gallop"], "unknown gait 'gallop'"),
        (
            ["--gait", "trot", "three_one", "--policy", "sparse_formula"],
            "--policy 'sparse_formula'",
        ),
        (["--gait", "trot", "walk", "--source", "mine"], "no files of your own"),
        (
            [
                "--gait",
                "trot",
                "walk",
                "--policy",
                str(STUDENT_DIRECTORY / "trot" / "sparse_formula.formulas"),
            ],
            "no files of your own",
        ),
        (["--gait", "trot", "walk", "--name", "Mine"], "the controller's name is 'Mine'"),
    ],
)
def test_what_does_not_go_together_is_refused_and_nothing_is_written(
    arguments, message, tmp_path, monkeypatch, refused
):
    monkeypatch.chdir(tmp_path)
    assert message in refused(["export", *arguments])
    assert list(tmp_path.iterdir()) == []


def test_the_pages_lines_change_the_gait(switched_pages, tmp_path):
    """They stand in a program that is left out there."""
    text = PAGE.read_text().partition("## Several gaits")[2]
    (lines,) = re.findall(r"^```c\n(.*?)^```", text, flags=re.DOTALL | re.MULTILINE)
    name = "walk_trot_pace_bound_sparse_formula"
    renamed = lines.replace(name, "pages").replace(name.upper(), "PAGES")
    names = {"name": "pages", "policy_name": "sparse_formula", "version": "0"}
    source = write_source(write_switching_controller(switched_pages, **names), tmp_path)
    program = tmp_path / "program.c"
    program.write_text(
        f"""#include "pages.h"
        #include <stdio.h>
        static pages_sensors read_sensors(void)
        {{
            const pages_sensors standing = {{
                .joint_position = {{{", ".join(map(str, A1.default_stance))}}},
                .foot_contact = {{1, 1, 1, 1}}}};
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
    sensors = Sensors(A1.default_stance, np.zeros(12), np.ones(4, dtype=bool))
    command = Command(np.array([0.3, 0.0]), np.array(8.0))
    memory, ran = compiled_pages.initial(), []
    for _ in range(20):
        memory = compiled_pages.step(memory, sensors, command, 1).memory
        ran.append(switched_pages.switch.gaits[compiled_pages.gait_of(memory)].name)
    assert ran == ["walk"] * 15 + ["trot"] * 5

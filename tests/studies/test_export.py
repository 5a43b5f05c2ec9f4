"""`glassgait export`: the files that it writes are the policy."""

import json

import pytest

from glassgait.models.errors import InputError
from glassgait.models.export.binding import has_compiler, load_controller
from glassgait.models.export.c_source import write_controller
from glassgait.models.export.contract import CONTRACT, read_contract
from glassgait.models.policies.controller import alone
from glassgait.models.policies.library import STUDENT_DIRECTORY, load_expert, load_student
from glassgait.models.robots.library import load_robot
from glassgait.models.task.gait import load_gait
from glassgait.models.task.symmetry import mirrored_states
from glassgait.studies.cli import main
from glassgait.studies.export import command
from glassgait.studies.export.agreement import (
    agreement_table,
    compare_controllers,
    random_sequences,
    recorded_sequences,
)

A1 = load_robot()
WRITTEN = {"name": "tested", "policy_name": "tested", "version": "0"}

needs_compiler = pytest.mark.skipif(not has_compiler(), reason="needs a C compiler, cc")


def loaded(gait, kind, folder):
    """Returns a shipped controller in Python, and in C."""
    expert = load_expert(gait)
    controller = alone(expert if kind == "expert" else load_student(gait, kind), expert)
    source = write_controller(load_gait(gait), controller, **WRITTEN)
    return controller, load_controller(source, folder)


@needs_compiler
@pytest.mark.slow
@pytest.mark.parametrize(
    ("gait", "kind"),
    [
        ("trot", "expert"),
        ("trot", "linear_per_state"),
        ("trot", "gbm"),
        ("bound", "formulas"),
        ("bound", "ebm"),
    ],
)
def test_shipped_policies_agree(gait, kind, tmp_path):
    controller, compiled = loaded(gait, kind, tmp_path)
    machine = load_gait(gait)
    sequences = random_sequences(A1, machine, n_steps=500, seed=0)
    found = compare_controllers(machine, controller, compiled, sequences)
    assert found.machine == 0
    assert found.target < 1e-12


@needs_compiler
def test_recorded_robots_agree_over_many_strides(trot, compiled_page):
    controller = alone(load_student("trot", "formulas"), load_expert("trot"))
    sequences = recorded_sequences(trot, controller, 300, seed=0)
    found = compare_controllers(trot, controller, compiled_page, sequences)
    assert (found.steps, found.machine) == (300, 0)
    assert found.changes > 10
    assert found.target < 1e-12


@needs_compiler
def test_another_controller_in_c_is_noticed(trot, compiled_page):
    other = alone(load_student("trot", "gbm"), load_expert("trot"))
    with pytest.raises(InputError, match="differs from Python's"):
        agreement_table(trot, other, compiled_page, n_steps=20, seed=0)


@needs_compiler
def test_the_command_writes_a_checked_file(tmp_path, capsys):
    folder = tmp_path / "run"
    main(["export", "--n-steps", "60", "--output", str(folder), "--name", "mine"])
    metrics = json.loads((folder / "metrics.json").read_text())
    assert [row["steps"] for row in metrics["agreement"]] == [30, 30]
    assert all(row["target"] < 1e-12 for row in metrics["agreement"])
    assert metrics["bytes"] == (folder / "mine.c").stat().st_size
    assert read_contract(folder / CONTRACT)["file"] == "mine.c"
    assert "mine.c" in capsys.readouterr().out


def test_without_a_compiler_the_file_is_written_unchecked(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(command, "has_compiler", lambda: False)
    main(["export", "--output", str(tmp_path / "run")])
    assert (tmp_path / "run" / "trot_formulas.c").exists()
    assert "not compared with Python" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--policy", "oracle"], "unknown policy 'oracle'"),
        (["--policy", "mine.formulas"], "no such file"),
        (["--name", "Mine"], "name is 'Mine'"),
        (["--gait", "gallop"], "gait 'gallop'"),
        (["--n-steps", "0"], "n_steps"),
        (
            ["--policy", str(STUDENT_DIRECTORY / "bound" / "formulas.formulas")],
            "made for gait 'bound', not 'trot'",
        ),
    ],
)
def test_bad_arguments_are_refused_and_nothing_is_written(
    arguments, said, tmp_path, monkeypatch, refused
):
    monkeypatch.chdir(tmp_path)
    assert said in refused(["export", *arguments])
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("real", ["double", "float"])
@pytest.mark.parametrize("kind", ["odometry", "estimator", "mirrored"])
def test_a_graph_acts_as_its_network(kind, real, trot, learned_expert):
    pytest.importorskip("onnxruntime")
    import onnx  # noqa: PLC0415

    from glassgait.studies.export.onnx_network import compare_graph, graph_bytes  # noqa: PLC0415

    expert = load_expert("trot") if kind == "odometry" else learned_expert
    if kind == "mirrored":
        actor, estimator = learned_expert._networks.values()
        states = mirrored_states(trot)
        expert = type(expert)("trot", expert.observation_names, actor, estimator, states)
    model = graph_bytes(trot, alone(expert), "0", real)
    table = compare_graph(model, trot, alone(expert), n_rows=40, seed=0)
    assert table["observations"].item() == 40
    assert table["target"].item() < (1e-12 if real == "double" else 1e-6)
    graph = onnx.load_from_string(model)
    assert len(graph.graph.input) == (2 if kind == "odometry" else 1)
    if kind == "mirrored":
        with pytest.raises(InputError, match="differs from Python"):
            compare_graph(model, trot, alone(learned_expert), n_rows=10, seed=0)


def test_the_command_writes_a_checked_graph(tmp_path, refused):
    pytest.importorskip("onnxruntime")
    folder = tmp_path / "run"
    export = ["export", "--format", "onnx", "--n-steps", "20"]
    main([*export, "--policy", "expert", "--output", str(folder)])
    assert (folder / "trot_expert.onnx").exists()
    assert read_contract(folder / CONTRACT)["file"] == "trot_expert.onnx"
    assert "use --format c" in refused([*export, "--output", str(tmp_path / "other")])

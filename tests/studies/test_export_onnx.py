"""`glassgait export --format onnx`: files that act as the policy does, or none."""

import builtins
import json
from dataclasses import replace

import numpy as np
import pytest

from glassgait.models.errors import InputError
from glassgait.models.policies.controller import alone
from glassgait.models.policies.library import load_expert, load_student
from glassgait.models.robots.library import load_robot
from glassgait.models.task.gait import load_gait
from glassgait.models.task.observation import ObservationLayout
from glassgait.studies.cli import main

A1 = load_robot()


onnx = pytest.importorskip("onnx")
pytest.importorskip("onnxruntime")

from glassgait.models.export.graphs.runtime import LoadedGraph  # noqa: E402
from glassgait.studies.export import onnx_file  # noqa: E402
from glassgait.studies.export.closed_loop import by_graph, walk_both  # noqa: E402
from glassgait.studies.export.files import Deployment  # noqa: E402
from glassgait.studies.export.onnx_file import (  # noqa: E402
    OnnxFile,
    check_graph,
    compare_graph,
    random_rows,
    recorded_rows,
)

EXPORT = ["export", "--format", "onnx"]

OF_SHIPPED = {"imu": True, "estimate": True}
"""What graphs of the policies that ship read: an IMU, and what odometry estimates."""


def loaded(gait, kind, real="double"):
    machine, expert = load_gait(gait), load_expert(gait)
    policy = expert if kind == "expert" else load_student(gait, kind)
    file = OnnxFile(Deployment(machine, alone(policy, expert), f"{gait}_{kind}", kind), real)
    return LoadedGraph(file.model), policy, expert


@pytest.mark.parametrize(
    ("gait", "kind"),
    [
        ("trot", "expert"),
        ("trot", "statewise_linear"),
        ("trot", "symbolic"),
        ("bound", "sparse_formula"),
        pytest.param("half_bound", "statewise_symbolic", marks=pytest.mark.slow),
        ("three_one", "ebm"),
        pytest.param("walk", "gbm", marks=pytest.mark.slow),
    ],
)
def test_shipped_policies_agree(gait, kind):
    graph, policy, expert = loaded(gait, kind)
    rows = random_rows(A1, load_gait(gait), 500, 1, **OF_SHIPPED)
    found = compare_graph(graph, policy, expert, rows)
    assert found.rows == 500
    assert max(found.target, found.estimate) < 1e-12


def test_single_precision_agrees_but_for_rounding():
    graph, policy, expert = loaded("trot", "ebm", "float")
    rows = recorded_rows(load_gait("trot"), alone(policy, expert), 60, 1)
    found = compare_graph(graph, policy, expert, rows)
    assert found.rows == 60
    assert 0.0 < found.target < 1e-6


def test_random_rows_are_of_robots_within_their_ranges(trot):
    rows = random_rows(A1, trot, 400, 0)
    layout = ObservationLayout(trot.n_states)
    assert rows.shape == (400, layout.n_proprioceptive)
    named = dict(zip(layout.names, rows.T, strict=False))
    assert np.abs(named["DoF Vel RR Calf"]).max() <= 21.0 * 0.05
    assert np.ptp(named["DoF Pos FL Hip"]) > 1.4
    assert set(named["RM State 0"] + named["RM State 1"]) == {1.0}
    assert (named["RM Iters"] <= named["RM Iters"].max()).all()
    assert np.unique(named["RM Iters"]).size == trot.dwell[1] + 3


def test_the_command_writes_a_checked_file(tmp_path, capsys):
    folder = tmp_path / "run"
    arguments = [*EXPORT, "--n-steps", "60", "--output", str(folder), "--name", "mine"]
    main(arguments)
    metrics = json.loads((folder / "metrics.json").read_text())
    assert [row["rows"] for row in metrics["agreement"]] == [30, 30]
    assert all(row["target"] < 1e-12 for row in metrics["agreement"])
    path = folder / "mine.onnx"
    assert metrics["bytes"] == path.stat().st_size
    assert "mine.onnx" in capsys.readouterr().out
    onnx.checker.check_model(str(path), full_check=True)
    assert LoadedGraph(path.read_bytes()).metadata["policy"] == "sparse_formula"
    main([*arguments, "--resume"])


def test_robots_walk_alike_by_python_and_by_the_graph(trot):
    graph, policy, expert = loaded("trot", "sparse_formula")
    table = walk_both(
        trot, alone(policy, expert), by_graph(graph), title="ONNX", n_robots=2, n_steps=40, seed=3
    )
    assert table["engine"].tolist() == ["Drake", "MuJoCo"]
    assert (table["apart, robot (%)"] < 1e-3).all()
    assert table["falls, ONNX"].tolist() == table["falls, Python"].tolist()


def test_a_graph_that_acts_otherwise_is_not_written(tmp_path, monkeypatch, refused):
    monkeypatch.setattr(onnx_file, "MOST", 0.0)
    message = refused([*EXPORT, "--n-steps", "20", "--output", str(tmp_path / "run")])
    assert "differs from Python by" in message
    assert list(tmp_path.iterdir()) == []


def test_another_policy_is_message_apart(trot):
    graph, policy, expert = loaded("trot", "sparse_formula")
    rows = {"random": random_rows(A1, trot, 50, 0, **OF_SHIPPED)}
    assert len(check_graph(graph, policy, expert, rows)) == 1
    with pytest.raises(InputError, match="nothing was written"):
        check_graph(graph, load_student("trot", "symbolic"), expert, rows)


def test_what_is_not_finite_on_one_side_alone_is_message(trot):
    graph, policy, expert = loaded("trot", "statewise_linear")
    rows = random_rows(A1, trot, 5, 0, **OF_SHIPPED)

    def broken(observation):
        action = policy(observation)
        action[2, 3] = np.nan
        return action

    assert compare_graph(graph, broken, expert, rows).target > 1e300

    def both(own, estimate):
        acted = graph(own, estimate)
        acted.action[2, 3] = np.inf
        return acted

    both.dtype, both.reads_estimate = graph.dtype, graph.reads_estimate
    assert compare_graph(both, broken, expert, rows).target < 1e-12


def test_without_onnx_a_sentence_names_what_to_install(tmp_path, monkeypatch, refused):
    imported = builtins.__import__

    def without(name, *arguments, **options):
        if name.startswith("glassgait.studies.export.onnx_file"):
            raise ImportError("No module named 'onnx'")
        return imported(name, *arguments, **options)

    monkeypatch.setattr(builtins, "__import__", without)
    message = refused([*EXPORT, "--output", str(tmp_path / "run")])
    assert "pip install 'glassgait[onnx]'" in message
    assert list(tmp_path.iterdir()) == []


def test_a_gait_of_ones_own_is_exported_too(trot, make_policy, learned_expert):
    odd = replace(trot, name="hop")
    policy = make_policy(odd)
    names, networks = learned_expert.observation_names, learned_expert._networks.values()
    own = type(learned_expert)("hop", names, *networks)
    file = OnnxFile(Deployment(odd, alone(policy, own), "hop_mine", "mine"), "double")
    rows = random_rows(A1, odd, 20, 0)
    assert compare_graph(LoadedGraph(file.model), policy, own, rows).target < 1e-12

"""Policies that observe an IMU and estimate by odometry, as text, as C and as graphs."""

import copy
import re
from dataclasses import replace
from importlib.util import find_spec

import numpy as np
import pytest

from glassgait.models.errors import InputError
from glassgait.models.export.binding import BAD_INPUT, BAD_MEMORY, ODOMETRY, OK
from glassgait.models.export.controller import write_controller
from glassgait.models.export.reference import PythonController
from glassgait.models.formulas.reader import read_formulas
from glassgait.models.policies.controller import AlternatingController, alone
from glassgait.models.policies.library import load_expert, load_policy, load_student
from glassgait.models.policies.switched import SwitchedPolicy
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.models.robots import quadruped
from glassgait.models.robots.library import load_robot
from glassgait.models.task.gait import load_gait
from glassgait.models.task.gait_switch import GaitSwitch
from glassgait.models.task.odometry import Odometry
from glassgait.models.task.symmetry import REFLECT_JOINTS, reflect_observation
from glassgait.studies.export.agreement import (
    compare_controllers,
    random_sequences,
    recorded_sequences,
)
from glassgait.studies.export.files import has_compiler, load_controller

A1 = load_robot()
WRITTEN = {"name": "tested", "policy_name": "tested", "version": "0"}

needs_compiler = pytest.mark.skipif(not has_compiler(), reason="needs a C compiler, cc")


def page(gait="trot", gain=0.15):
    """The gait's page, with odometry in place of the expert's network."""
    own = copy.copy(load_student(gait, "sparse_formula"))
    own.observes_by, own._estimator = None, Odometry(gain=gain)
    return own


def text_of(gait, *, imu=True, mirror=""):
    """A formula file of a gait whose formulas hold what the IMU measures."""
    stance = zip(quadruped.JOINTS, A1.default_stance, strict=True)
    of_imu = " + 0.1*g.x - 0.02*w.y*g.z" if imu else ""
    formulas = [f"{joint} = {angle} + 0.1*v.x - 0.05*h.FL{of_imu}" for joint, angle in stance]
    header = [f"gait: {gait.name}", f"states: {gait.n_states}"]
    header += ["senses: imu"] if imu else []
    return "\n".join(
        ["format: 1", *header, *([mirror] if mirror else []), "every state", *formulas]
    )


def formulas(gait):
    """Formulas of what an IMU measures, with odometry."""
    own = FormulaPolicy.from_file(read_formulas(text_of(gait)))
    own._estimator = Odometry()
    return own


def policy(kind, gait, small_expert):
    """A policy that observes an IMU, most of them by odometry."""
    if kind == "formulas":
        return formulas(gait)
    odometry = None if kind.startswith("learned") else Odometry(gain=0.3)
    return small_expert(gait, mirrored="mirrored" in kind, imu=True, odometry=odometry)


@needs_compiler
@pytest.mark.parametrize("kind", ["formulas", "network", "mirrored", "learned", "learned mirrored"])
def test_c_that_reads_an_imu_does_what_python_does(kind, trot, small_expert, tmp_path):
    controller = alone(policy(kind, trot, small_expert))
    compiled = load_controller(write_controller(trot, controller, **WRITTEN), tmp_path)
    python = PythonController(trot, controller)
    found = compare_controllers(python, compiled, random_sequences(A1, trot, 400, 3))
    assert (found.steps, found.machine) == (400, 0)
    assert found.changes > 0
    assert found.target < 1e-12


@needs_compiler
@pytest.mark.parametrize("kind", ["formulas", "network", "learned"])
def test_several_gaits_share_one_odometry(kind, small_expert, tmp_path):
    gaits = [load_gait(name) for name in ("walk", "trot")]
    own = SwitchedPolicy(
        GaitSwitch(gaits), [alone(policy(kind, gait, small_expert)) for gait in gaits]
    )
    controller = alone(own)
    written = write_controller(own.switch, controller, **WRITTEN)
    compiled, python = load_controller(written, tmp_path), PythonController(own.switch, controller)
    found = compare_controllers(python, compiled, random_sequences(A1, own.switch, 600, 3))
    assert found.machine == 0
    assert found.target < 1e-12
    assert found.gaits
    assert written.source.count("GAIN 0") == (kind != "learned")


@needs_compiler
def test_a_page_with_odometry_walks_alike_in_c_and_has_no_network_in_it(trot, tmp_path):
    controller = alone(page())
    written = write_controller(trot, controller, **WRITTEN)
    lines = written.source.splitlines()
    assert len(lines) <= 865
    assert max(map(len, lines)) <= 100
    assert not re.search("weight|elu|bias|layer|expm1|network|estimator_", written.source, re.I)
    compiled, python = load_controller(written, tmp_path), PythonController(trot, controller)
    found = compare_controllers(python, compiled, recorded_sequences(trot, controller, 500, 3))
    assert found.machine == 0
    assert found.changes > 20
    assert found.target < 1e-12


@needs_compiler
def test_odometry_is_safe_from_readings_and_memory_that_are_no_numbers(trot, tmp_path):
    compiled = load_controller(write_controller(trot, alone(page()), **WRITTEN), tmp_path)
    moments = random_sequences(A1, trot, 3, 0)[0]
    first = compiled.step(compiled.initial(), *moments[0])
    assert first.status == OK
    for entry in range(9):
        for value in (np.nan, np.inf, 1e7):
            imu = moments[1].sensors.imu.copy()
            imu[entry] = value
            broken = moments[1]._replace(sensors=replace(moments[1].sensors, imu=imu))
            held = compiled.step(first.memory, *broken)
            assert held.status == BAD_INPUT
            np.testing.assert_array_equal(held.memory, first.memory)
    for entry in range(1, 16):
        memory = first.memory.copy()
        memory[ODOMETRY.start + entry] = np.nan
        assert compiled.step(memory, *moments[1]).status == BAD_MEMORY
    blind = replace(moments[1].sensors, imu=None)
    with pytest.raises(ValueError, match="IMU"):
        compiled.step(first.memory, *moments[1]._replace(sensors=blind))


def test_a_file_holds_odometry_whose_gain_can_be_edited(tmp_path):
    own, path = page(), tmp_path / "page.formulas"
    own.save(path)
    text = path.read_text()
    assert "\nodometry\n" in text
    assert load_policy(path).digest() == own.digest()
    assert load_policy(path).to_text() == text
    path.write_text(text.replace("0.15*(measured", "0.4*(measured"))
    edited = load_policy(path)
    assert edited.estimator == Odometry(gain=0.4)
    assert edited.digest() != own.digest()
    # It observes by its own where it acts alone, whatever the expert does.
    expert = load_expert("trot")
    assert alone(edited, expert).estimator == Odometry(gain=0.4)
    with pytest.raises(InputError, match="odometry of its own"):
        AlternatingController(expert, edited, period=4)


@pytest.mark.parametrize(
    ("old", "new", "place"),
    [
        ("0.15*(measured", "2*(measured", "line 44, column 17: the gain"),
        ("0.15*(measured", "nan*(measured", "line 44, column 17: the gain"),
        ("0.02*9.81", "0.02*9.8", "line 38, column 46: odometry is one program"),
        ("normal = unit(", "normal = (", "line 46, column 10: odometry is one program"),
        ("stood = touching", "# stood = touching", "line 41, column 1: odometry is one"),
        ("h = dot(normal", "# h = dot(normal", "line 49, column 1: odometry lacks"),
        ("\nmachine", "\nh = 2\n\nmachine", "line 49, column 1: odometry ends"),
        (
            "\nmachine",
            "\nodometry\n\nmachine",
            "line 49, column 1: 'odometry' stands",
        ),
        ("senses: imu", "senses: sonar", "line 4, column 1: senses"),
    ],
)
def test_odometry_that_is_another_program_is_refused(old, new, place):
    text = page().to_text()
    # Spaces and comments make no other program.
    spaced = text.replace("v - 0.02*cross(w, v)", "v   -  0.02 * cross( w,v )")
    assert read_formulas(spaced.replace("# m/s, of the trunk", "# note")).odometry == Odometry()
    assert old in text
    with pytest.raises(InputError) as refused:
        read_formulas(text.replace(old, new, 1))
    assert str(refused.value).startswith(place)


def test_formulas_of_what_an_imu_measures_keep_their_file_and_their_mirror(trot, generator):
    lopsided = FormulaPolicy.from_file(read_formulas(text_of(trot)))
    assert lopsided.layout.imu
    assert FormulaPolicy.from_file(read_formulas(lopsided.to_text())).digest() == lopsided.digest()
    half = text_of(trot, mirror="mirror: 1 0").split("\n")
    whole = [line for line in half if not line.startswith(("FR", "RR"))]
    own = FormulaPolicy.from_file(read_formulas("\n".join(whole)))
    reflect = reflect_observation(own.observation_names, (1, 0))
    observed = generator.normal(size=(20, own.layout.size))
    np.testing.assert_allclose(own(reflect(observed)), REFLECT_JOINTS(own(observed)), atol=1e-12)
    with pytest.raises(InputError, match=r"g\.x"):
        read_formulas(text_of(trot).replace("senses: imu\n", ""))


@pytest.mark.skipif(find_spec("onnxruntime") is None, reason="needs ONNX")
@pytest.mark.parametrize("kind", ["formulas", "network", "learned"])
@pytest.mark.parametrize("real", ["double", "float"])
def test_a_graph_reads_the_estimate_that_odometry_makes(kind, real, trot, small_expert):
    from glassgait.models.export.graphs.runtime import LoadedGraph  # noqa: PLC0415
    from glassgait.studies.export.files import Deployment  # noqa: PLC0415
    from glassgait.studies.export.onnx_file import (  # noqa: PLC0415
        OnnxFile,
        compare_graph,
        random_rows,
        recorded_rows,
    )

    own = policy(kind, trot, small_expert)
    controller = alone(own)
    graph = LoadedGraph(OnnxFile(Deployment(trot, controller, "mine", "mine"), real).model)
    assert graph.reads_estimate == (kind != "learned")
    rows = random_rows(A1, trot, 50, 0, imu=True, estimate=graph.reads_estimate)
    most = 1e-12 if real == "double" else 1e-5
    assert compare_graph(graph, own, own, rows).target < most
    if real == "double":
        recorded = recorded_rows(trot, controller, 30, 1)
        assert compare_graph(graph, own, own, recorded).target < most
    said = graph.metadata
    assert "projected_gravity,base_ang_vel" in said["observation_names"]
    assert ("GAIN" in said, "odometry" in said) == (False, graph.reads_estimate)
    if graph.reads_estimate:
        assert said["estimate_units"] == "m/s,m/s,m/s,m,m,m,m"
        assert "(measured - predicted)" in said["odometry"]

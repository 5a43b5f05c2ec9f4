"""Fixtures of all tests: gaits, policies that need no training, and helpers for leaf systems."""

import os
import signal
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import settings
from pydrake.geometry import Meshcat
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, LeafSystem

from glassgait.diagrams.visualization import open_meshcat
from glassgait.models.arrays import Array
from glassgait.models.estimation.odometry import Odometry
from glassgait.models.export.binding import LoadedController, has_compiler, load_controller
from glassgait.models.export.c_source import ControllerSource, write_controller
from glassgait.models.policies.controller import alone
from glassgait.models.policies.library import load_expert, load_student
from glassgait.models.policies.linear import LinearPolicy
from glassgait.models.policies.neural import Network, NeuralPolicy
from glassgait.models.robots import kinematics, quadruped
from glassgait.models.robots.library import load_robot
from glassgait.models.robots.robot import ROBOT_DIRECTORY
from glassgait.models.task.gait import Gait, Transition, load_gait, parse_formula
from glassgait.models.task.observation import ObservationLayout
from glassgait.studies.cli import main
from glassgait.studies.common.console import BAD_INPUT

A1 = load_robot()


# Deadlines would fail on a busy machine.
settings.register_profile("fast", deadline=None, max_examples=50)
settings.register_profile("thorough", deadline=None, max_examples=300)

if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
    # Background jobs of a shell ignore Ctrl-C, and so would every process that a test starts.
    signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_configure(config: pytest.Config) -> None:
    settings.load_profile("fast" if config.option.markexpr == "not slow" else "thorough")


def pytest_xdist_auto_num_workers(config: pytest.Config) -> int:
    """Runs folders in two processes, and single files in this one."""
    if config.args and all(Path(name.partition("::")[0]).is_file() for name in config.args):
        return 0
    # One thread each, except for Drake's batches: the processes share the cores.
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    os.environ.setdefault("DRAKE_NUM_THREADS", "2")
    return min(2, os.cpu_count() or 1)


@pytest.fixture
def trot() -> Gait:
    return load_gait("trot")


@pytest.fixture
def unforgiving() -> Gait:
    """The trot, but a foot that should swing leads into a sink once the episode has begun."""
    gait = load_gait("trot")
    wrong = {"q0": "FR", "q1": "FL"}
    missed = tuple(
        Transition(source, "missed", parse_formula(feet), dwell=0.0, grace=20)
        for source, feet in wrong.items()
    )
    return replace(
        gait,
        name="unforgiving",
        states=(*gait.states, "missed"),
        faults=("missed",),
        transitions=(*gait.transitions, *missed),
    )


@pytest.fixture
def forgiving(unforgiving) -> Gait:
    """The same with a way back: the robot starts the trot anew from a stance on all feet."""
    back = Transition("missed", "q0", parse_formula("FL & FR & RL & RR"))
    return replace(unforgiving, name="forgiving", transitions=(*unforgiving.transitions, back))


@pytest.fixture
def write_robot(tmp_path: Path) -> Callable[..., Path]:
    """Writes a robot that ships under another name, some words of one file replaced."""

    def write(file: str = "", old: str = "", new: str = "", *, like: str = "a1") -> Path:
        for source in (ROBOT_DIRECTORY / like).iterdir():
            text = source.read_text().replace(f"name: {like}", "name: dog", 1)
            assert source.name != file or old in text
            text = text.replace(old, new, 1) if source.name == file else text
            (tmp_path / source.name).write_text(text)
        return tmp_path / "robot.yaml"

    return write


@pytest.fixture
def generator() -> np.random.Generator:
    return np.random.default_rng(7)


@pytest.fixture
def standing() -> Array:
    """The plant's state of a robot that stands at rest."""
    return kinematics.standing_state(A1)


@pytest.fixture
def random_states() -> Callable[[int], Array]:
    """Draws plant states with any attitude and joints inside their limits."""

    def draw(count: int) -> Array:
        generator = np.random.default_rng(11)
        state = generator.normal(size=(count, quadruped.N_POSITIONS + quadruped.N_VELOCITIES))
        state[:, :4] /= np.linalg.norm(state[:, :4], axis=1, keepdims=True)
        state[:, quadruped.JOINT_POSITION] = generator.uniform(
            A1.lower_limits, A1.upper_limits, size=(count, quadruped.N_JOINTS)
        )
        return state

    return draw


@pytest.fixture
def make_policy() -> Callable[..., LinearPolicy]:
    """Makes small random linear policies: they move all joints and need no training."""

    def make(gait: Gait, seed: int = 3) -> LinearPolicy:
        names = ObservationLayout(gait.n_states).names
        weights = 0.1 * np.random.default_rng(seed).normal(size=(quadruped.N_JOINTS, len(names)))
        return LinearPolicy(gait.name, names, weights, np.zeros(quadruped.N_JOINTS))

    return make


def small_network(generator: np.random.Generator, *widths: int) -> Network:
    """Draws a network of small weights."""
    sizes = [(after, before) for before, after in pairwise(widths)]
    weights = tuple(0.1 * generator.normal(size=size) for size in sizes)
    return Network(weights, tuple(np.zeros(size[0]) for size in sizes))


@pytest.fixture(scope="session")
def imu_expert() -> NeuralPolicy:
    """A network of small random weights that observes an IMU, and moves all joints of a trot."""
    layout = ObservationLayout(2, imu=True)
    actor = small_network(np.random.default_rng(2), layout.size, 32, quadruped.N_JOINTS)
    return NeuralPolicy("trot", layout.names, actor, Odometry(gain=0.3))


@pytest.fixture(scope="session")
def learned_expert() -> NeuralPolicy:
    """Networks of small random weights: an estimator, and an actor that moves all joints."""
    layout, generator = ObservationLayout(2), np.random.default_rng(2)
    actor = small_network(generator, layout.size, 32, quadruped.N_JOINTS)
    estimator = small_network(generator, layout.n_proprioceptive, 32, 7)
    return NeuralPolicy("trot", layout.names, actor, estimator)


@pytest.fixture(scope="session")
def written_page() -> ControllerSource:
    """The C of the trot's page of formulas."""
    gait, expert = load_gait("trot"), load_expert("trot")
    policy = load_student("trot", "formulas")
    names = {"name": "trot_formulas", "policy_name": "formulas", "version": "0"}
    return write_controller(gait, alone(policy, expert), **names)


@pytest.fixture(scope="session")
def compiled_page(
    written_page: ControllerSource, tmp_path_factory: pytest.TempPathFactory
) -> LoadedController:
    """The same, compiled; skips where there is no C compiler."""
    if not has_compiler():
        pytest.skip("needs a C compiler, cc")
    return load_controller(written_page, tmp_path_factory.mktemp("page"))


DESCRIPTION = """
robot: go2
weights: tiny.onnx
joints: [FR_hip, FR_thigh, FR_calf, FL_hip, FL_thigh, FL_calf,
         RR_hip, RR_thigh, RR_calf, RL_hip, RL_thigh, RL_calf]
observation:
  - {term: angular_velocity, scale: 0.25}
  - {term: gravity}
  - {term: command, scale: [2.0, 2.0, 0.25]}
  - {term: joint_position}
  - {term: joint_velocity, scale: 0.05}
  - {term: last_action}
  - {term: clock, period: 0.5}
history: {length: 3, order: newest_first, by: term, start: zeros}
clip: {observation: 10.0, action: 4.0}
default: {hip: 0.0, thigh: 0.8, calf: -1.5}
action_scale: {hip: 0.125, thigh: 0.25, calf: 0.25}
gains: {stiffness: 30.0, damping: 0.7}
commands: {forward: [-0.6, 1.0], yaw: [-1.0, 1.0]}
"""
"""A description of a network for the Go2, with 47 numbers a frame."""


@pytest.fixture
def describe(tmp_path: Path) -> Callable[..., Path]:
    """Writes a description, some words replaced, with the ONNX file of a linear network."""
    onnx = pytest.importorskip("onnx")
    pytest.importorskip("onnxruntime")

    def write(*changes: tuple[str, str], weights: Array | None = None, size: int = 141) -> Path:
        if weights is None:
            weights = 0.05 * np.random.default_rng(5).normal(size=(size, quadruped.N_JOINTS))
        shapes = [
            onnx.helper.make_tensor_value_info(name, onnx.TensorProto.FLOAT, ["n", count])
            for name, count in zip(("given", "answer"), weights.shape, strict=True)
        ]
        graph = onnx.helper.make_graph(
            [onnx.helper.make_node("MatMul", ["given", "weights"], ["answer"])],
            "tiny",
            shapes[:1],
            shapes[1:],
            [onnx.numpy_helper.from_array(weights.astype(np.float32), "weights")],
        )
        model = onnx.helper.make_model(graph, opset_imports=[onnx.helper.make_opsetid("", 17)])
        model.ir_version = 8
        onnx.save(model, tmp_path / "tiny.onnx")
        text = DESCRIPTION
        for old, new in changes:
            assert old in text
            text = text.replace(old, new)
        path = tmp_path / "mine.yaml"
        path.write_text(text)
        return path

    return write


@pytest.fixture
def fix_inputs() -> Callable[..., Context]:
    """Makes a context whose input ports hold the given values."""

    def fix(system: LeafSystem, context: Context | None = None, **values: Array) -> Context:
        context = context or system.CreateDefaultContext()
        for name, value in values.items():
            system.GetInputPort(name).FixValue(context, np.atleast_1d(value).astype(float))
        return context

    return fix


@pytest.fixture
def latch() -> Callable[[LeafSystem, Context], None]:
    """Runs the update that is due now, and goes on to the next control instant."""

    def run(system: LeafSystem, context: Context) -> None:
        steps = round(context.get_time() / 0.02)
        Simulator(system, context).AdvanceTo((steps + 1) * 0.02)

    return run


@pytest.fixture
def refused(capsys: pytest.CaptureFixture[str]) -> Callable[[list[str]], str]:
    """Runs a command that must be refused in one sentence, and returns the sentence."""

    def run(arguments: list[str]) -> str:
        with pytest.raises(SystemExit) as ended:
            main(arguments)
        assert ended.value.code == BAD_INPUT
        lines = capsys.readouterr().err.strip().splitlines()
        # Notes say where policies are from.
        (message,) = (line for line in lines if not line.startswith("· "))
        assert message.startswith("glassgait: ")
        return message

    return run


@pytest.fixture(scope="module")
def server() -> Meshcat:
    """A Meshcat that several tests share."""
    return open_meshcat()


@pytest.fixture
def meshcat(server: Meshcat) -> Iterator[Meshcat]:
    """The same, without controls at a test's beginning."""
    yield server
    server.DeleteAddedControls()

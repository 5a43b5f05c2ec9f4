"""A robot's whole day: diagram and batch agree, and what goes wrong ends damped."""

from dataclasses import replace

import numpy as np
import pytest

from glassgait.diagrams.batch import BatchSimulator
from glassgait.diagrams.commands import FixedCommand
from glassgait.diagrams.engines import make_physics
from glassgait.diagrams.locomotion import MakeLocomotion
from glassgait.diagrams.rollout import make_simulator, record
from glassgait.diagrams.scenario import Scenario
from glassgait.diagrams.station import StationConfig
from glassgait.diagrams.switching_batch import SwitchingSimulator
from glassgait.diagrams.task_config import TaskConfig
from glassgait.models.errors import InputError
from glassgait.models.policies.controller import alone
from glassgait.models.policies.library import load_expert, load_student
from glassgait.models.policies.linear import LinearPolicy
from glassgait.models.policies.switched import SwitchedPolicy
from glassgait.models.robots import quadruped
from glassgait.models.robots.library import load_robot
from glassgait.models.task.command import Command
from glassgait.models.task.day import REQUESTS, load_day, lying_state
from glassgait.models.task.gait import load_gait
from glassgait.models.task.gait_switch import GaitSwitch
from glassgait.models.task.mode_machine import ModeMachine
from glassgait.models.task.observation import ObservationLayout

A1, DAY, TROT = load_robot(), load_day(), load_gait("trot")
CALM = Scenario(sensor_noise=0.0, command=FixedCommand(speed=0.0, dwell=8))
DWELL = 8.0
MUJOCO = StationConfig(engine="mujoco", time_step=0.002)

PARTS = (
    # Control steps, request, commanded velocity: rise and stand, walk, stand, walk, lie down.
    (30, "sit", (0.0, 0.0)),
    (220, "stand", (0.0, 0.0)),
    (120, "walk", (0.4, 0.2)),
    (70, "walk", (0.0, 0.0)),
    (60, "walk", (0.3, -0.2)),
    (150, "sit", (0.3, -0.2)),
)


def lying(robot):
    """Returns the state of a robot whose legs are folded, which it sinks on."""
    return lying_state(robot, DAY, np.zeros((1, quadruped.N_JOINTS)))[0]


def batch(controller, scenario, gait=TROT, n_robots=1):
    """Makes robots that lie."""
    robot = controller.robot
    shared = {
        "n_robots": n_robots,
        "generator": np.random.default_rng(0),
        "estimator": controller.estimator,
        "day": ModeMachine(DAY, robot, controller.joint_law.limits),
    }
    physics = make_physics(robot, scenario.station_of(controller))
    if isinstance(gait, GaitSwitch):
        simulator = SwitchingSimulator(gait, scenario, physics, policy=controller, **shared)
    else:
        task = TaskConfig.of_scenario(gait, scenario, controller)
        simulator = BatchSimulator(task, physics, **shared)
    command = Command(np.zeros((n_robots, 2)), np.full(n_robots, DWELL))
    simulator.start_at(np.tile(lying(robot), (n_robots, 1)), command)
    return simulator


def request(simulator, name, velocity=(0.0, 0.0)):
    n = simulator.n_robots
    simulator.set_command(Command(np.tile(velocity, (n, 1)), np.full(n, DWELL)))
    simulator.request_mode(np.full(n, REQUESTS.index(name)))


def advance(simulator, controller, n_steps):
    for step in range(n_steps):
        simulator.step(controller.advance(step, simulator.observe(), None).action)


def modes(simulator):
    return [DAY.names[mode] for mode in simulator.modes.mode]


def page():
    return alone(load_student("trot", "sparse_formula"), load_expert("trot"))


def standing_policy(robot):
    """A policy that asks for the stance, of a robot that has none that walks."""
    names = ObservationLayout(TROT.n_states).names
    weights = np.zeros((quadruped.N_JOINTS, len(names)))
    return alone(LinearPolicy("trot", names, weights, weights[:, 0], robot=robot))


@pytest.mark.parametrize(
    "make",
    [
        pytest.param(page, id="page"),
        pytest.param(lambda: alone(load_expert("trot")), id="expert", marks=pytest.mark.slow),
    ],
)
def test_diagram_and_batch_agree_over_a_whole_day(make):
    controller = make()
    simulator = batch(controller, CALM)
    diagram = MakeLocomotion(TROT, CALM, policy=controller, day=DAY)
    robot = make_simulator(diagram, state=lying(A1))
    context = robot.get_mutable_context()
    visited = []
    for n_steps, name, velocity in PARTS:
        request(simulator, name, velocity)
        diagram.GetInputPort("requested_mode").FixValue(context, [float(REQUESTS.index(name))])
        diagram.GetInputPort("command").FixValue(context, velocity)
        diagram.GetInputPort("commanded_dwell").FixValue(context, [DWELL])
        found = record(robot, n_steps, stop_on_failure=False)
        for step in range(n_steps):
            state = simulator.state
            close = {"state": state.plant[0], "observations": simulator.observe()[0]}
            close["rm_state"] = simulator.machine.one_hot(state.machine.state)[0]
            advance(simulator, controller, 1)
            close["mode"] = simulator.modes.mode
            close["damped"] = simulator.mode_step.damped
            close["actions"] = simulator.state.action[0]
            for port, own in close.items():
                text = f"{port} at step {step} of {name}"
                np.testing.assert_allclose(found[port][step], own, atol=1e-9, err_msg=text)
            visited += modes(simulator)
    order = [mode for i, mode in enumerate(visited) if i == 0 or mode != visited[i - 1]]
    assert order == [
        *("rest", "fold", "rise", "stand", "walk", "stand", "walk", "stand", "sit", "rest")
    ]


@pytest.mark.parametrize(
    ("name", "station"),
    [
        pytest.param("a1", StationConfig(), id="a1-drake"),
        pytest.param("a1", MUJOCO, id="a1-mujoco", marks=pytest.mark.slow),
        pytest.param("go2", StationConfig(), id="go2-drake", marks=pytest.mark.slow),
        pytest.param("go2", MUJOCO, id="go2-mujoco"),
    ],
)
def test_each_robot_rises_from_its_belly_stands_still_and_lies_down(name, station):
    controller = standing_policy(load_robot(name))
    simulator = batch(controller, replace(CALM, station=station, true_body_state=True), n_robots=2)
    advance(simulator, controller, 60)
    assert modes(simulator) == ["rest"] * 2
    low = simulator.state.plant[:, 6]
    assert (low < 0.06).all()
    request(simulator, "stand")
    advance(simulator, controller, 170)
    assert modes(simulator) == ["stand"] * 2
    assert (simulator.state.plant[:, 6] > low + 0.2).all()
    before = simulator.state.plant
    for _ in range(20):
        advance(simulator, controller, 1)
        assert simulator.state.touching.all()
    np.testing.assert_allclose(simulator.state.plant[:, :19], before[:, :19], atol=0.01)
    request(simulator, "sit")
    advance(simulator, controller, 130)
    assert modes(simulator) == ["rest"] * 2
    assert (simulator.state.plant[:, 6] < 0.06).all()


def test_a_robot_that_is_turned_over_ends_damped_until_it_lies_and_the_operator_sits():
    controller = page()
    simulator = batch(controller, CALM)
    request(simulator, "stand")
    advance(simulator, controller, 200)
    tipped = simulator.state.plant.copy()
    tipped[:, :4] = [np.cos(np.radians(25.0)), np.sin(np.radians(25.0)), 0.0, 0.0]
    simulator.restore(replace(simulator.state, plant=tipped))
    advance(simulator, controller, 2)
    assert modes(simulator) == ["damped"]
    # Joints are sent to where they are.
    position, _ = simulator.state.measured_joints()
    advance(simulator, controller, 1)
    targets = A1.joint_targets(simulator.state.action)
    np.testing.assert_allclose(targets, position, atol=0.03)
    request(simulator, "walk", (0.4, 0.0))
    advance(simulator, controller, 100)
    assert modes(simulator) == ["damped"]
    lies = lying(A1)[None]
    simulator.restore(replace(simulator.state, plant=lies))
    request(simulator, "sit")
    advance(simulator, controller, 50)
    assert modes(simulator) == ["rest"]


def test_a_day_goes_on_in_another_gait_on_request():
    switch = GaitSwitch([TROT, load_gait("walk")])
    parts = [alone(load_expert(gait.name)) for gait in switch.gaits]
    controller = alone(SwitchedPolicy(switch, parts))
    simulator = batch(controller, CALM, switch)
    request(simulator, "walk", (0.4, 0.0))
    advance(simulator, controller, 250)
    assert modes(simulator) == ["walk"]
    assert simulator.running.tolist() == [0]
    simulator.requested = np.array([1])
    advance(simulator, controller, 100)
    assert simulator.running.tolist() == [1]
    request(simulator, "sit")
    advance(simulator, controller, 180)
    assert modes(simulator) == ["rest"]
    assert simulator.running.tolist() == [0]


def test_a_robot_whose_day_begins_anew_rests():
    controller = page()
    simulator = batch(controller, CALM, n_robots=2)
    request(simulator, "stand")
    advance(simulator, controller, 60)
    simulator.reset(np.array([1]))
    assert modes(simulator)[1] == "rest"
    assert modes(simulator)[0] != "rest"


def test_what_is_no_day_is_refused():
    with pytest.raises(InputError, match="give a policy"):
        MakeLocomotion(TROT, CALM, day=DAY)
    simulator = BatchSimulator(
        TaskConfig.of_scenario(TROT, CALM),
        make_physics(A1, CALM.station),
        n_robots=1,
        generator=np.random.default_rng(0),
        estimator=None,
    )
    with pytest.raises(ValueError, match="plays no day"):
        simulator.request_mode(np.zeros(1, dtype=int))

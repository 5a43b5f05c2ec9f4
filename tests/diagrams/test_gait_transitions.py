"""Gaits that change in the closed loop: diagram and batch simulator agree there, too."""

from dataclasses import replace

import numpy as np
import pytest

from glassgait.diagrams.batch_physics import BatchPhysics
from glassgait.diagrams.commands import FixedCommand, SliderCommand
from glassgait.diagrams.locomotion import MakeLocomotion
from glassgait.diagrams.rollout import make_simulator, record
from glassgait.diagrams.scenario import Scenario
from glassgait.diagrams.switching_batch import SwitchingSimulator
from glassgait.diagrams.visualization import open_meshcat
from glassgait.models.errors import InputError
from glassgait.models.policies.controller import alone
from glassgait.models.policies.library import load_expert, load_student
from glassgait.models.policies.switched import SwitchedPolicy
from glassgait.models.robots.library import load_robot
from glassgait.models.task.command import Command
from glassgait.models.task.gait import load_gait
from glassgait.models.task.gait_switch import GaitSwitch
from glassgait.models.task.randomization import NOMINAL

A1 = load_robot()


COMMAND = FixedCommand(speed=0.4, yaw_rate=0.2, dwell=7)
CALM = Scenario(command=COMMAND, sensor_noise=0.0)
REQUEST, N_STEPS = 30, 80
TOLERANCE = 1e-9


def acting(gait, student):
    """The expert, or a kind of student."""
    expert = load_expert(gait)
    return alone(load_student(gait, student), expert) if student else alone(expert)


def two(source, target, student=None):
    """A switch between two gaits, with what acts in each."""
    switch = GaitSwitch([load_gait(source), load_gait(target)])
    return switch, SwitchedPolicy(switch, [acting(gait, student) for gait in (source, target)])


def batch(switch, policy, scenario, n_robots=1, seed=0):
    return SwitchingSimulator(
        switch,
        scenario,
        BatchPhysics(A1, scenario.station),
        n_robots=n_robots,
        generator=np.random.default_rng(seed),
        estimator=policy.estimator,
        policy=policy,
    )


def recorded(diagram, state, requested):
    """Rolls the diagram out, the other gait requested at `REQUEST`."""
    simulator = make_simulator(diagram, state=state)
    port = diagram.GetInputPort("requested_gait")
    value = port.FixValue(simulator.get_mutable_context(), [0.0])
    parts = [record(simulator, REQUEST, stop_on_failure=False)]
    value.GetMutableData().get_mutable_value().SetFromVector([float(requested)])
    parts.append(record(simulator, N_STEPS - REQUEST, stop_on_failure=False))
    # The instant of the request is given twice: before it, and as it is then.
    return {name: np.concatenate([parts[0][name][:-1], parts[1][name]]) for name in parts[0].values}


@pytest.mark.parametrize(
    ("source", "target", "student", "latency"),
    [
        ("walk", "trot", None, 0.0),
        ("trot", "bound", None, 0.02),
        pytest.param("trot", "bound", "sparse_formula", 0.0, marks=pytest.mark.slow),
        ("bound", "walk", "sparse_formula", 0.0),
        ("trot", "pace", None, 0.03),
    ],
)
def test_diagram_and_batch_agree_while_the_gait_changes(source, target, student, latency):
    switch, policy = two(source, target, student)
    scenario = replace(CALM, latency=latency)
    (state,) = replace(NOMINAL, observation_noise=0.0).initial_states(
        A1, 1, np.random.default_rng(5)
    )
    rollout = recorded(MakeLocomotion(switch, scenario, policy=policy), state, 1)
    simulator = batch(switch, policy, scenario)
    velocity = np.array([[COMMAND.speed, COMMAND.yaw_rate]])
    simulator.start_at(state[None], Command(velocity, np.array([float(COMMAND.dwell)])))

    def close(found, port, step):
        np.testing.assert_allclose(
            found, rollout[port][step], rtol=0, atol=TOLERANCE, err_msg=f"{port} at step {step}"
        )

    changed, outcome = [], None
    for step in range(N_STEPS + 1):
        machine, observation = simulator.state.machine, simulator.observe()
        close(simulator.state.plant[0], "state", step)
        close(observation[0], "observations", step)
        close(np.eye(switch.n_states)[machine.state[0]], "rm_state", step)
        close(machine.iterations, "rm_iterations", step)
        if outcome is not None:
            close(outcome.reward, "reward", step)
            close(outcome.served_dwell, "served_dwell", step)
            close(outcome.failures[0], "failures", step)
        action = policy(observation)
        close(simulator.limited(action)[0], "actions", step)
        # An update sees what is requested at the end of its control step.
        simulator.requested = np.array([int(step + 1 >= REQUEST)])
        changed.append(int(simulator.running[0]))
        outcome = simulator.step(action)
    assert changed[REQUEST - 1] == 0 and changed[-1] == 1


def test_robots_of_a_batch_change_each_when_it_is_asked(trot):
    switch, policy = two("trot", "walk")
    simulator = batch(switch, policy, CALM, n_robots=3)
    ran = []
    for step in range(120):
        simulator.requested = np.array([0, int(step >= 30), int(30 <= step < 80)])
        assert not simulator.step(policy(simulator.observe())).failures.any()
        ran.append(simulator.running)
    starts = [np.flatnonzero(np.diff(own)) for own in np.array(ran).T]
    assert [len(own) for own in starts] == [0, 1, 2]
    assert 30 <= starts[1][0] < 50 and 80 <= starts[2][1] < 100


def test_a_request_is_an_input_that_may_stay_open():
    switch, policy = two("trot", "pace")
    diagram = MakeLocomotion(switch, CALM, policy=policy)
    assert diagram.HasInputPort("requested_gait")
    rollout = record(make_simulator(diagram), 40)
    assert not rollout["rm_state"][:, 2:].any()
    assert rollout["rm_state"].shape == (41, 4)


def test_buttons_request_gaits_where_sliders_command():
    switch, policy = two("trot", "pace")
    scenario = replace(CALM, command=SliderCommand())
    diagram = MakeLocomotion(switch, scenario, policy=policy, meshcat=open_meshcat())
    assert not diagram.HasInputPort("requested_gait")
    assert diagram.HasSubsystemNamed("gait_request")


def test_commands_that_one_of_the_gaits_is_not_made_for_are_refused():
    switch, policy = two("trot", "walk")
    scenario = replace(CALM, command=FixedCommand(speed=0.8))
    for make in (
        lambda: MakeLocomotion(switch, scenario, policy=policy),
        lambda: batch(switch, policy, scenario),
    ):
        with pytest.raises(InputError, match="trot walk"):
            make()


def test_the_policy_of_one_gait_alone_is_refused(trot):
    switch, _ = two("trot", "walk")
    with pytest.raises(InputError, match="trot"):
        MakeLocomotion(switch, CALM, policy=load_expert("trot"))

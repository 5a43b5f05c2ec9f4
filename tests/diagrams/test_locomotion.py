"""The closed loop, and the project's keel: diagram and batch simulator agree."""

from dataclasses import replace

import numpy as np
import pytest

from diagrams.batch import BatchSimulator, TaskConfig
from diagrams.batch_physics import BatchPhysics
from diagrams.locomotion import DrawnCommands, FixedCommand, LocomotionConfig, MakeLocomotion
from diagrams.rollout import make_simulator, record
from diagrams.station import StationConfig
from models.errors import InputError
from models.policies.library import EXPERT_DIRECTORY, load_expert
from models.task.command import Command
from models.task.gait import gait_names, load_gait
from models.task.randomization import NOMINAL

QUIET = replace(NOMINAL, observation_noise=0.0)
N_STEPS = 200
TOLERANCE = 1e-9


def batch_of_one(gait, state, command):
    simulator = BatchSimulator(
        TaskConfig(gait, QUIET),
        BatchPhysics(StationConfig()),
        n_robots=1,
        generator=np.random.default_rng(0),
    )
    simulator.start_at(
        state[None],
        Command(np.array([[command.speed, command.yaw_rate]]), np.array([float(command.dwell)])),
    )
    return simulator


def assert_agreement(gait, policy, estimator):
    command = FixedCommand(speed=0.4, yaw_rate=0.2, dwell=7)
    (state,) = QUIET.initial_states(1, np.random.default_rng(5))
    config = LocomotionConfig(command=command)
    diagram = MakeLocomotion(gait, config, expert=policy, estimator=estimator)
    rollout = record(make_simulator(diagram, state=state), N_STEPS, stop_on_failure=False)
    simulator = batch_of_one(gait, state, command)

    def close(found, port, step):
        np.testing.assert_allclose(
            found, rollout[port][step], rtol=0, atol=TOLERANCE, err_msg=f"{port} at step {step}"
        )

    fired, outcome = 0, None
    for step in range(N_STEPS + 1):
        machine = simulator.state.machine
        observation = simulator.observe(estimator)
        close(simulator.state.plant[0], "state", step)
        close(observation[0], "observations", step)
        close(simulator.machine.one_hot(machine.state)[0], "rm_state", step)
        close(machine.iterations, "rm_iterations", step)
        if outcome is not None:
            close(outcome.reward, "reward", step)
            close(outcome.plain_reward, "plain_reward", step)
            close(outcome.terms[0], "reward_terms", step)
            close(outcome.failures[0], "failures", step)
            fired += int(outcome.fired[0])
        action = policy(observation)
        close(action[0], "actions", step)
        outcome = simulator.step(action)
    return fired


@pytest.mark.parametrize("name", gait_names())
def test_diagram_and_batch_agree_at_every_control_step(name, make_policy):
    gait = load_gait(name)
    assert_agreement(gait, make_policy(gait), estimator=None)


EXPERTS = sorted(path.stem for path in EXPERT_DIRECTORY.glob("*.safetensors"))


@pytest.mark.parametrize("name", EXPERTS)
def test_they_agree_with_the_expert_while_its_gait_runs(name):
    expert = load_expert(name)
    assert assert_agreement(load_gait(name), expert, expert.estimator) > 10


def test_an_action_acts_at_the_instant_it_is_computed(trot, make_policy):
    # Were it a plant step late, the joints would follow their old targets for one step more.
    diagram = MakeLocomotion(trot, LocomotionConfig(station=StationConfig(time_step=0.02)))
    simulator = make_simulator(diagram)
    context = simulator.get_context()
    diagram.GetInputPort("actions").FixValue(simulator.get_mutable_context(), np.full(12, 2.0))
    before = diagram.GetOutputPort("state").Eval(context)[7:19]
    simulator.AdvanceTo(0.02)
    after = diagram.GetOutputPort("state").Eval(context)[7:19]
    assert np.all(after - before > 0.02)


def test_exported_ports(trot, make_policy):
    diagram = MakeLocomotion(trot, LocomotionConfig(), expert=make_policy(trot))
    sizes = {
        diagram.get_output_port(i).get_name(): diagram.get_output_port(i).size()
        for i in range(diagram.num_output_ports())
    }
    assert sizes == {
        "actions": 12,
        "observations": 49,
        "reward": 1,
        "plain_reward": 1,
        "reward_terms": 9,
        "rm_state": 2,
        "rm_iterations": 1,
        "foot_contact": 4,
        "foot_height": 4,
        "failures": 6,
        "command": 2,
        "commanded_dwell": 1,
        "state": 37,
    }
    assert diagram.num_input_ports() == 0


@pytest.mark.parametrize("period", [1, 3, 0])
def test_alternation_lets_the_right_policy_act(trot, make_policy, period):
    expert, student = make_policy(trot, seed=1), make_policy(trot, seed=2)
    diagram = MakeLocomotion(
        trot, LocomotionConfig(alternation_period=period), expert=expert, student=student
    )
    rollout = record(make_simulator(diagram), 12, stop_on_failure=False)
    for step in range(13):
        acts = expert if period and step % period == 0 else student
        np.testing.assert_allclose(
            rollout["actions"][step], acts(rollout["observations"][step]), atol=1e-12
        )


def test_noise_changes_observations_and_repeats_with_its_seed(trot, make_policy):
    diagram = MakeLocomotion(trot, LocomotionConfig(sensor_noise=True), expert=make_policy(trot))
    first, again, other = (
        record(make_simulator(diagram, seed=seed), 20, stop_on_failure=False)["observations"]
        for seed in (1, 1, 2)
    )
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other)


def test_drawn_commands_reach_the_observation(trot, make_policy):
    config = LocomotionConfig(command=DrawnCommands())
    diagram = MakeLocomotion(trot, config, expert=make_policy(trot))
    rollout, other = (record(make_simulator(diagram, seed=seed), 5) for seed in (4, 5))
    np.testing.assert_array_equal(rollout["observations"][:, :2], rollout["command"])
    assert not np.array_equal(rollout["command"], other["command"])


def test_policies_of_another_gait_are_refused(trot, make_policy):
    with pytest.raises(InputError, match="made for gait 'pace', not 'trot'"):
        MakeLocomotion(trot, LocomotionConfig(), expert=make_policy(load_gait("pace")))


def test_an_alternation_without_its_policy_is_refused(trot, make_policy):
    config = LocomotionConfig(alternation_period=2)
    with pytest.raises(ValueError, match="needs a student"):
        MakeLocomotion(trot, config, expert=make_policy(trot))
    with pytest.raises(ValueError, match="needs an expert"):
        MakeLocomotion(trot, config, student=make_policy(trot))

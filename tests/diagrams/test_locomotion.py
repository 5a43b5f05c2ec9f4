"""The closed loop, and the project's keel: diagram and batch simulator agree."""

from dataclasses import replace

import numpy as np
import pytest
from pydrake.common import RandomGenerator
from pydrake.gym import DrakeGymEnv
from pydrake.systems.analysis import MonteCarloSimulation, Simulator
from pydrake.systems.framework import DiagramBuilder

from glassgait.diagrams.batch import BatchSimulator
from glassgait.diagrams.batch_physics import BatchPhysics
from glassgait.diagrams.commands import DrawnCommands, FixedCommand, SliderCommand
from glassgait.diagrams.gym import action_space, observation_space
from glassgait.diagrams.locomotion import MakeLocomotion
from glassgait.diagrams.plant_state import (
    find_locomotion,
    normalize_attitude,
    push,
    set_plant_state,
)
from glassgait.diagrams.rollout import make_simulator, record
from glassgait.diagrams.scenario import Scenario
from glassgait.diagrams.station import MakeA1Station, StationConfig
from glassgait.diagrams.task_config import TaskConfig
from glassgait.models.a1 import kinematics, robot
from glassgait.models.errors import InputError
from glassgait.models.policies.alternating import AlternatingPolicy
from glassgait.models.policies.library import EXPERT_DIRECTORY, load_expert
from glassgait.models.task.command import Command
from glassgait.models.task.gait import gait_names, load_gait, parse_gait
from glassgait.models.task.randomization import NOMINAL

QUIET = replace(NOMINAL, observation_noise=0.0)
CALM = Scenario(command=FixedCommand(), sensor_noise=0.0)
DRAWN = replace(CALM, command=DrawnCommands())
N_STEPS = 200
LOOPED = """
description: A machine with edges side by side and one that returns to its state.
max_speed: 1.0
max_yaw_rate: 1.0
dwell: [6, 11]
clearance: 0.03
states: [q0, q1]
initial: q0
transitions:
  - {from: q0, to: q1, when: FL & FR & RL & RR, dwell: 0.5}
  - {from: q0, to: q1, when: FL & RR & ~FR & ~RL}
  - {from: q1, to: q1, when: FL & FR & RL & RR, dwell: 0.3}
  - {from: q1, to: q0, when: ~FL | ~FR | ~RL | ~RR, dwell: 0}
"""
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
    diagram = MakeLocomotion(gait, replace(CALM, command=command), policy=policy)
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
            close(outcome.served_dwell, "served_dwell", step)
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


def test_they_agree_on_edges_side_by_side_and_on_edges_to_the_same_state(make_policy):
    gait = parse_gait(LOOPED, name="looped")
    assert assert_agreement(gait, make_policy(gait), estimator=None) > 20


EXPERTS = sorted(path.stem for path in EXPERT_DIRECTORY.glob("*.safetensors"))


@pytest.mark.parametrize("name", EXPERTS)
def test_they_agree_with_the_expert_while_its_gait_runs(name):
    expert = load_expert(name)
    assert assert_agreement(load_gait(name), expert, expert.estimator) > 10


def test_an_action_acts_at_the_instant_it_is_computed(trot, make_policy):
    # Were it a plant step late, the joints would follow their old targets for one step more.
    diagram = MakeLocomotion(trot, replace(CALM, station=StationConfig(time_step=0.02)))
    simulator = make_simulator(diagram)
    context = simulator.get_context()
    diagram.GetInputPort("actions").FixValue(simulator.get_mutable_context(), np.full(12, 2.0))
    before = diagram.GetOutputPort("state").Eval(context)[7:19]
    simulator.AdvanceTo(0.02)
    after = diagram.GetOutputPort("state").Eval(context)[7:19]
    assert np.all(after - before > 0.02)


def test_exported_ports(trot, make_policy):
    diagram = MakeLocomotion(trot, CALM, policy=make_policy(trot))
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
        "served_dwell": 1,
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
    diagram = MakeLocomotion(trot, CALM, policy=AlternatingPolicy(expert, student, period))
    rollout = record(make_simulator(diagram), 12, stop_on_failure=False)
    for step in range(13):
        acts = expert if period and step % period == 0 else student
        np.testing.assert_allclose(
            rollout["actions"][step], acts(rollout["observations"][step]), atol=1e-12
        )


def test_noise_changes_observations_and_repeats_with_its_seed(trot, make_policy):
    diagram = MakeLocomotion(trot, replace(CALM, sensor_noise=1.0), policy=make_policy(trot))
    first, again, other = (
        record(make_simulator(diagram, seed=seed), 20, stop_on_failure=False)["observations"]
        for seed in (1, 1, 2)
    )
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other)


def test_noise_has_a_factor(trot):
    first = {
        factor: record(make_simulator(MakeLocomotion(trot, config), seed=1), 0)["observations"][0]
        for factor in (0.0, 1.0, 2.5)
        for config in [replace(CALM, sensor_noise=factor)]
    }
    noise = first[1.0] - first[0.0]
    assert np.abs(noise).max() > 0.01
    np.testing.assert_allclose(first[2.5] - first[0.0], 2.5 * noise, atol=1e-12)


def test_drawn_commands_reach_the_observation(trot, make_policy):
    diagram = MakeLocomotion(trot, DRAWN, policy=make_policy(trot))
    rollout, other = (record(make_simulator(diagram, seed=seed), 5) for seed in (4, 5))
    np.testing.assert_array_equal(rollout["observations"][:, :2], rollout["command"])
    assert not np.array_equal(rollout["command"], other["command"])


def test_policies_of_another_gait_are_refused(trot, make_policy):
    with pytest.raises(InputError, match="made for gait 'pace', not 'trot'"):
        MakeLocomotion(trot, CALM, policy=make_policy(load_gait("pace")))


def test_the_true_body_state_is_observed_where_the_scenario_says_so(trot):
    expert = load_expert("trot")
    first = {
        truth: record(make_simulator(MakeLocomotion(trot, scenario, policy=expert)), 0)
        for truth in (False, True)
        for scenario in [replace(CALM, true_body_state=truth)]
    }
    np.testing.assert_array_equal(first[True]["observations"][0, -7:-4], np.zeros(3))
    own = first[True]["observations"][0, :-7]
    np.testing.assert_array_equal(first[False]["observations"][0, -7:], expert.estimator(own))


def test_a_simulator_made_by_hand_starts_on_its_feet(trot):
    diagram = MakeLocomotion(trot, CALM, policy=load_expert("trot"))
    simulator = Simulator(diagram)
    context = simulator.get_context()
    before = diagram.GetOutputPort("state").Eval(context).copy()
    simulator.AdvanceTo(2.0)
    after = diagram.GetOutputPort("state").Eval(context)
    assert not diagram.GetOutputPort("failures").Eval(context).any()
    assert after[4] - before[4] > 0.5


@pytest.mark.parametrize(
    ("values", "told"),
    [
        ({"speed": 1.5}, "speed is 1.5; give -1 to 1, the range of gait 'trot'"),
        ({"yaw_rate": -2.0}, "yaw_rate is -2.0; give -1 to 1"),
        ({"dwell": 5}, "dwell is 5; give 6 to 11"),
        ({"dwell": 0}, "dwell is 0; it must be 1 or more"),
        ({"speed": float("nan")}, "speed is nan; it must be a finite number"),
        ({"dwell": 8.5}, "dwell is 8.5; it must be a whole number"),
    ],
)
def test_commands_that_the_gait_is_not_made_for_are_refused(trot, values, told):
    with pytest.raises(InputError, match=f"command: {told}"):
        MakeLocomotion(trot, replace(CALM, command=FixedCommand(**values)))


def test_drawn_speeds_that_the_gait_is_not_made_for_are_refused(trot):
    scenario = replace(CALM, command=DrawnCommands((0.0, 1.5)))
    with pytest.raises(
        InputError, match=r"speed_range is \(0\.0, 1\.5\); name speeds from -1 to 1"
    ):
        MakeLocomotion(trot, scenario)


def test_sliders_need_a_meshcat(trot):
    with pytest.raises(ValueError, match="need a Meshcat"):
        MakeLocomotion(trot, replace(CALM, command=SliderCommand()))


def test_a_reversed_range_of_speeds_is_refused():
    with pytest.raises(InputError, match="the least, then the greatest"):
        DrawnCommands(speed_range=(0.5, 0.1))


def start_of(diagram, context):
    ports = ("command", "commanded_dwell", "state")
    return np.concatenate([diagram.GetOutputPort(port).Eval(context) for port in ports])


def test_monte_carlo_draws_command_and_pose_for_every_simulation(trot, make_policy):
    diagram = MakeLocomotion(trot, DRAWN, policy=make_policy(trot))

    def drawn(seed):
        starts = []

        def output(system, context):
            starts.append(start_of(system, context))
            return 0.0

        MonteCarloSimulation(
            make_simulator=lambda generator: Simulator(diagram),
            output=output,
            final_time=0.0,
            num_samples=6,
            generator=RandomGenerator(seed),
        )
        return np.array(starts)

    first = drawn(1)
    np.testing.assert_array_equal(first, drawn(1))
    assert not np.array_equal(first, drawn(2))
    yaw_rate, first_joint, last_joint = 1, 3 + 7, 3 + 18
    for column in (yaw_rate, first_joint, last_joint):
        assert len(set(first[:, column])) == 6
    assert len(set(first[:, 2])) > 1


def test_drakes_gym_environment_draws_command_and_pose_for_every_seed(trot):
    diagram = MakeLocomotion(trot, DRAWN)
    env = DrakeGymEnv(
        simulator=Simulator(diagram),
        time_step=0.02,
        action_space=action_space(),
        observation_space=observation_space(trot),
        reward="reward",
        action_port_id="actions",
        observation_port_id="observations",
    )
    first, again, other = (env.reset(seed=seed)[0] for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    commands, joints = slice(0, 2), slice(2, 14)
    for part in (commands, joints):
        assert not np.any(first[part] == other[part])
    observation, *_ = env.step(np.zeros(12))
    np.testing.assert_array_equal(observation[commands], other[commands])


def test_commands_change_with_time_but_not_with_the_updates(trot, make_policy):
    diagram = MakeLocomotion(trot, DRAWN, policy=make_policy(trot))
    simulator = make_simulator(diagram, seed=3)
    commands = record(simulator, 510, stop_on_failure=False)["command"]
    assert len(np.unique(commands[:500], axis=0)) == 1
    assert len(np.unique(commands[500:], axis=0)) == 1
    assert np.all(commands[499] != commands[500])


def nested(diagram, depth=2):
    for level in range(depth):
        builder = DiagramBuilder()
        builder.AddNamedSystem(f"level {level}", diagram)
        diagram = builder.Build()
    return diagram


def test_the_robot_is_placed_and_pushed_in_any_context_that_holds_it(trot, make_policy, standing):
    diagram = MakeLocomotion(trot, CALM, policy=make_policy(trot))
    whole = nested(diagram)
    assert find_locomotion(whole) is diagram
    root = whole.CreateDefaultContext()
    own = diagram.GetMyMutableContextFromRoot(root)
    for i, (part, context) in enumerate([(whole, root), (diagram, root), (diagram, own)]):
        standing[4] = i
        set_plant_state(part, context, standing)
        push(part, context, np.array([0.5, 0.0, i]))
        state = diagram.GetOutputPort("state").Eval(own)
        np.testing.assert_array_equal(state[: robot.LINEAR_VELOCITY.start], standing[:22])
        np.testing.assert_array_equal(state[robot.LINEAR_VELOCITY], [0.5, 0.0, i])


def test_contexts_of_other_diagrams_are_refused(trot, make_policy):
    diagram, other = (MakeLocomotion(trot, CALM, policy=make_policy(trot)) for _ in range(2))
    with pytest.raises(InputError, match="the context is not of diagram 'Locomotion'"):
        set_plant_state(diagram, other.CreateDefaultContext())


@pytest.mark.parametrize("n_robots", [0, 2])
def test_diagrams_of_no_robot_or_of_two_are_refused(n_robots, trot, make_policy):
    builder = DiagramBuilder()
    builder.AddNamedSystem("station", MakeA1Station())
    for i in range(n_robots):
        diagram = MakeLocomotion(trot, CALM, policy=make_policy(trot))
        builder.AddNamedSystem(f"robot {i}", diagram)
    with pytest.raises(InputError, match=f"holds {n_robots} of what MakeLocomotion builds"):
        find_locomotion(builder.Build())


def test_an_attitude_of_another_length_is_made_a_unit_quaternion(trot):
    diagram = MakeLocomotion(trot, CALM)
    context = diagram.CreateDefaultContext()
    state = kinematics.standing_state(robot.DEFAULT_STANCE)
    longer = state.copy()
    longer[robot.QUATERNION] *= 1.1
    set_plant_state(diagram, context, longer)
    normalize_attitude(diagram, context)
    np.testing.assert_allclose(diagram.GetOutputPort("state").Eval(context), state, atol=1e-15)

"""The closed loop, and the project's keel: diagram and batch simulator agree."""

from dataclasses import replace

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from glassgait.diagrams import batch
from glassgait.diagrams.batch import BatchSimulator
from glassgait.diagrams.batch_physics import BatchPhysics
from glassgait.diagrams.commands import DrawnCommands, FixedCommand
from glassgait.diagrams.locomotion import MakeLocomotion
from glassgait.diagrams.rollout import make_simulator, record
from glassgait.diagrams.scenario import Scenario
from glassgait.diagrams.station import StationConfig
from glassgait.diagrams.task_config import TaskConfig
from glassgait.models.errors import InputError
from glassgait.models.policies.controller import AlternatingController, alone
from glassgait.models.policies.library import (
    EXPERT_DIRECTORY,
    STUDENT_DIRECTORY,
    load_expert,
    load_policy,
    load_student,
)
from glassgait.models.policies.linear import LinearPolicy
from glassgait.models.robots import quadruped
from glassgait.models.robots.joint_law import JointLaw
from glassgait.models.robots.library import load_robot
from glassgait.models.task.command import Command
from glassgait.models.task.gait import gait_names, load_gait, parse_gait
from glassgait.models.task.randomization import NOMINAL
from glassgait.models.task.reward import RewardWeights
from glassgait.models.task.terrain import Terrain
from glassgait.systems import command as command_system

A1 = load_robot()


QUIET = replace(NOMINAL, observation_noise=0.0)
CALM = Scenario(command=FixedCommand(), sensor_noise=0.0)
TRUE = replace(CALM, true_body_state=True)
"""For policies without an estimator."""
COMMAND = FixedCommand(speed=0.4, yaw_rate=0.2, dwell=7)
COMMAND_OF_ONE = Command(np.array([[0.4, 0.2]]), np.array([7.0]))
N_STEPS = 100
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


def slow_but_for(names, kept):
    """Marks those slow that differ from the kept ones by numbers alone."""
    return [pytest.param(name, marks=() if name in kept else pytest.mark.slow) for name in names]


def batch_of_one(gait, state, command, scenario, estimator, policy=None):
    """Starts one robot in a state (37) with a command."""
    task = TaskConfig.of_scenario(gait, scenario, policy)
    simulator = BatchSimulator(
        task,
        BatchPhysics(A1, scenario.station_of(policy)),
        n_robots=1,
        generator=np.random.default_rng(0),
        estimator=None if scenario.true_body_state else estimator,
    )
    simulator.start_at(state[None], command)
    return simulator


def assert_agreement(gait, policy, scenario=CALM, n_steps=N_STEPS):
    """Plays a scenario in both executions and returns how often the machine's state changed."""
    scenario = replace(scenario, command=COMMAND)
    ground = scenario.station.ground
    (state,) = QUIET.initial_states(A1, 1, np.random.default_rng(5), ground)
    diagram = MakeLocomotion(gait, scenario, policy=policy)
    rollout = record(make_simulator(diagram, state=state), n_steps, stop_on_failure=False)
    simulator = batch_of_one(gait, state, COMMAND_OF_ONE, scenario, policy.estimator, policy)
    return assert_same_steps(simulator, rollout, policy, n_steps)


def assert_same_steps(simulator, rollout, policy, n_steps=N_STEPS):
    """Steps the batch beside a recorded diagram; returns how often the machine's state changed."""

    def close(found, port, step):
        np.testing.assert_allclose(
            found, rollout[port][step], rtol=0, atol=TOLERANCE, err_msg=f"{port} at step {step}"
        )

    fired, outcome = 0, None
    for step in range(n_steps + 1):
        machine = simulator.state.machine
        observation = simulator.observe()
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
        close(simulator.limited(action)[0], "actions", step)
        outcome = simulator.step(action)
    return fired


@pytest.mark.parametrize("name", slow_but_for(gait_names(), ("walk", "bound")))
def test_diagram_and_batch_agree_at_every_control_step(name, make_policy):
    gait = load_gait(name)
    assert_agreement(gait, make_policy(gait), TRUE)


def test_they_agree_on_edges_side_by_side_and_on_edges_to_the_same_state(make_policy):
    gait = parse_gait(LOOPED, name="looped")
    assert assert_agreement(gait, make_policy(gait), TRUE) > 20


EXPERTS = sorted(path.stem for path in EXPERT_DIRECTORY.glob("*.safetensors"))


@pytest.mark.parametrize("name", slow_but_for(EXPERTS, ("trot", "walk", "bound")))
def test_they_agree_with_the_expert_while_its_gait_runs(name):
    assert assert_agreement(load_gait(name), load_expert(name)) > 10


FINE = StationConfig(time_step=0.0025)
WORLDS = {
    "true body state": replace(CALM, true_body_state=True),
    "10 ms late": replace(CALM, latency=0.01),
    "20 ms late": replace(CALM, latency=0.02),
    "7.5 ms late": replace(CALM, station=FINE, latency=0.0075),
    "20 ms late, fine": replace(CALM, station=FINE, latency=0.02),
    "weak motors": replace(CALM, station=StationConfig(motor_strength=0.8)),
    "other gains": replace(CALM, station=StationConfig(stiffness=17.0, damping=0.6)),
    "heavy rotors": replace(CALM, station=StationConfig(armature=0.01)),
    "payload": replace(CALM, station=StationConfig(payload=2, payload_position=(0.05, 0.02, 0.0))),
    "soft ground": replace(
        CALM, station=StationConfig(ground_stiffness=8000.0, relaxation_time=0.03)
    ),
    "soft ground, similar": replace(
        CALM,
        station=StationConfig(
            time_step=0.001, contact_solver="similar", ground_stiffness=8000.0, dissipation=2.0
        ),
    ),
    "slope": replace(CALM, station=StationConfig(terrain=Terrain(slope=6.0))),
    **{
        name: replace(CALM, station=StationConfig(terrain=terrain))
        for name, terrain in {
            "slope in an odd direction": Terrain(slope=6.0, direction=200.0),
            "blocks": Terrain("blocks", amplitude=0.03, cells=2),
            "steps": Terrain("steps", height=0.03, flight=1, landing=0.3),
            "steps that lead on": Terrain("steps", endless=True, height=-0.02, landing=0.1),
            "uneven, and a slope": Terrain("uneven", cells=4, slope=4.0, direction=100.0),
            "patches": Terrain(patches=0.5, patch_friction=0.3),
        }.items()
    },
    "slippery": replace(CALM, station=StationConfig(friction=0.4)),
    "limited targets": replace(CALM, limit_targets=True),
    "limited targets, 10 ms late": replace(CALM, limit_targets=True, latency=0.01),
    "every term of the reward, firm joints": replace(
        CALM,
        station=StationConfig(stiffness=30.0, damping=0.8),
        weights=RewardWeights(
            tracking_time=0.3, high_swing=-2.0, tilt=-2.0, slip=-0.1, landing=-0.1
        ),
    ),
}


ALIKE = (
    "20 ms late, fine",
    "other gains",
    "soft ground",
    "slope",
    "steps that lead on",
    "slippery",
    "limited targets",
)
"""Worlds that others hold the like of."""


@pytest.mark.parametrize("world", slow_but_for(WORLDS, WORLDS.keys() - ALIKE))
def test_they_agree_in_every_world(world):
    assert assert_agreement(load_gait("trot"), load_expert("trot"), WORLDS[world], 60) > 5


@pytest.mark.parametrize(
    ("limit_targets", "limited"),
    [(None, True), pytest.param(True, True, marks=pytest.mark.slow), (False, False)],
)
def test_they_agree_where_a_policy_asks_for_targets_beyond_the_joints_ranges(
    trot, generator, limit_targets, limited
):
    # It kicks: every joint is at an end of its range again and again.
    page = load_student("trot", "sparse_formula")
    weights = 0.4 * generator.normal(size=(12, len(page.observation_names)))
    wild = LinearPolicy("trot", page.observation_names, weights, np.ones(12))
    wild.joint_law = replace(page.joint_law, limits=None)
    scenario = replace(CALM, true_body_state=True, limit_targets=limit_targets)
    assert_agreement(trot, wild, scenario)
    diagram = MakeLocomotion(trot, scenario, policy=wild)
    rollout = record(make_simulator(diagram), 20, stop_on_failure=False)
    asked = A1.joint_targets(rollout["actions"])
    assert np.any(asked > A1.upper_limits)
    system = diagram.GetSubsystemByName("joint_targets")
    context = system.CreateDefaultContext()
    system.get_input_port().FixValue(context, rollout["actions"][-1])
    followed = system.get_output_port().Eval(context)[:12]
    assert np.array_equal(np.sort(followed), np.sort(asked[-1])) is not limited


def test_joints_have_a_policys_gains_unless_the_scenario_names_some(trot, make_policy):
    firm = make_policy(trot).with_joint_law(JointLaw((31.0, 0.9)))
    for station, gains in (
        (StationConfig(), (31.0, 0.9)),
        (StationConfig(damping=0.4), (31.0, 0.4)),
        (StationConfig(stiffness=17.0, damping=0.4), (17.0, 0.4)),
    ):
        scenario = replace(TRUE, station=station)
        plant = MakeLocomotion(trot, scenario, policy=firm).GetSubsystemByName("plant")
        own = plant.get_joint_actuator(plant.GetJointActuatorIndices()[0]).get_controller_gains()
        assert (own.p, own.d) == gains
        assert scenario.joint_law(firm).gains == gains
    assert_agreement(trot, firm, TRUE, 30)


def test_they_agree_at_the_instants_at_which_commands_change(trot, monkeypatch):
    # The rhythm changes with the command: the machine must serve the same one in both.
    every, seed = 25, 3
    for module in (batch, command_system):
        monkeypatch.setattr(module, "COMMAND_STEPS", every)
    policy = load_expert("trot")
    scenario = replace(CALM, command=DrawnCommands())
    (state,) = QUIET.initial_states(A1, 1, np.random.default_rng(5))
    diagram = MakeLocomotion(trot, scenario, policy=policy)
    rollout = record(
        make_simulator(diagram, state=state, seed=seed), N_STEPS, stop_on_failure=False
    )
    begins = range(0, N_STEPS + 1, every)
    commands, dwells = rollout["command"], rollout["commanded_dwell"]
    drawn = (Command(commands[step][None], dwells[step]) for step in begins)
    simulator = batch_of_one(trot, state, next(drawn), scenario, policy.estimator, policy)
    monkeypatch.setattr(simulator, "_draw_commands", lambda count: next(drawn))
    assert len(set(rollout["commanded_dwell"][:, 0])) > 2
    assert assert_same_steps(simulator, rollout, policy) > 10


def test_they_agree_where_a_planner_commands(trot):
    policy = load_expert("trot")
    (state,) = QUIET.initial_states(A1, 1, np.random.default_rng(5))
    diagram = MakeLocomotion(trot, replace(CALM, command=DrawnCommands()), policy=policy)
    simulator = make_simulator(diagram, state=state)
    context = simulator.get_mutable_context()
    diagram.GetInputPort("command").FixValue(context, COMMAND_OF_ONE.velocity[0])
    diagram.GetInputPort("commanded_dwell").FixValue(context, COMMAND_OF_ONE.dwell)
    rollout = record(simulator, N_STEPS, stop_on_failure=False)
    np.testing.assert_array_equal(rollout["command"], [COMMAND_OF_ONE.velocity[0]] * (N_STEPS + 1))
    np.testing.assert_array_equal(rollout["commanded_dwell"], [[7.0]] * (N_STEPS + 1))
    beside = batch_of_one(trot, state, COMMAND_OF_ONE, CALM, policy.estimator, policy)
    beside.set_command(COMMAND_OF_ONE)
    assert assert_same_steps(beside, rollout, policy) > 10


def test_they_agree_on_contact_sensors_that_are_always_wrong(trot):
    # Of a share below 1, the two executions draw which readings are wrong, each for itself.
    assert_agreement(trot, load_expert("trot"), replace(CALM, contact_flips=1.0))


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


@pytest.mark.parametrize("period", [1, 3, 0])
def test_alternation_lets_the_right_policy_act(trot, make_policy, period):
    expert, student = make_policy(trot, seed=1), make_policy(trot, seed=2)
    diagram = MakeLocomotion(trot, TRUE, policy=AlternatingController(expert, student, period))
    rollout = record(make_simulator(diagram), 12, stop_on_failure=False)
    for step in range(13):
        acts = expert if period and step % period == 0 else student
        np.testing.assert_allclose(
            rollout["actions"][step], acts(rollout["observations"][step]), atol=1e-12
        )


def test_noise_changes_observations_and_repeats_with_its_seed(trot, make_policy):
    diagram = MakeLocomotion(trot, replace(TRUE, sensor_noise=1.0), policy=make_policy(trot))
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


def test_policies_of_another_gait_are_refused(trot, make_policy):
    with pytest.raises(InputError, match="pace"):
        MakeLocomotion(trot, CALM, policy=make_policy(load_gait("pace")))


def test_the_true_body_state_is_observed_where_the_scenario_says_so(trot):
    expert = load_expert("trot")
    first = {
        truth: record(make_simulator(MakeLocomotion(trot, scenario, policy=expert)), 0)
        for truth in (False, True)
        for scenario in [replace(CALM, true_body_state=truth)]
    }
    np.testing.assert_array_equal(first[True]["observations"][0, -7:-4], np.zeros(3))
    position = quadruped.JOINT_POSITION
    begun = expert.estimator.begin(A1, first[False]["state"][0, position])
    estimate = expert.estimator.body_state(A1, begun, first[False]["state"][0, position])
    np.testing.assert_array_equal(first[False]["observations"][0, -7:], estimate)


def test_a_policy_without_an_estimator_observes_the_true_body_state_only_if_asked(trot):
    trees = load_policy(STUDENT_DIRECTORY / "trot" / "gbm.safetensors")
    with pytest.raises(InputError, match="load_student"):
        MakeLocomotion(trot, CALM, policy=trees)
    rollout = record(make_simulator(MakeLocomotion(trot, TRUE, policy=trees)), 0)
    np.testing.assert_array_equal(rollout["observations"][0, -7:-4], np.zeros(3))


def test_a_shipped_student_alone_observes_by_its_experts_estimator(trot):
    page = load_student("trot", "sparse_formula")
    assert_agreement(trot, page)
    beside = alone(page, load_expert("trot"))
    single, both = (
        record(make_simulator(MakeLocomotion(trot, CALM, policy=policy)), 20)
        for policy in (page, beside)
    )
    for name in single.values:
        np.testing.assert_array_equal(single[name], both[name])


def test_a_simulator_made_by_hand_starts_on_its_feet(trot):
    diagram = MakeLocomotion(trot, CALM, policy=load_expert("trot"))
    simulator = Simulator(diagram)
    context = simulator.get_context()
    before = diagram.GetOutputPort("state").Eval(context).copy()
    simulator.AdvanceTo(2.0)
    after = diagram.GetOutputPort("state").Eval(context)
    assert not diagram.GetOutputPort("failures").Eval(context).any()
    assert after[4] - before[4] > 0.5

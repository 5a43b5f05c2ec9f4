"""The batch simulator: resets, estimates, and robots that go wrong."""

from dataclasses import replace

import numpy as np
import pytest

from glassgait.diagrams.batch import BatchSimulator
from glassgait.diagrams.commands import DrawnCommands, FixedCommand, SliderCommand
from glassgait.diagrams.physics import make_physics
from glassgait.diagrams.scenario import Scenario
from glassgait.diagrams.station import StationConfig
from glassgait.diagrams.task import TaskConfig
from glassgait.models.errors import InputError
from glassgait.models.robots import kinematics, quadruped
from glassgait.models.robots.library import load_robot
from glassgait.models.robots.robot import JointLaw
from glassgait.models.task import COMMAND_STEPS
from glassgait.models.task.command import Command
from glassgait.models.task.observation import indices_of
from glassgait.models.task.randomization import NOMINAL, Randomization
from glassgait.models.task.reward import RewardWeights
from glassgait.models.task.termination import FAILURES, TerminationLimits

A1 = load_robot()


def make_simulator(
    gait, *, n_robots=6, randomization=NOMINAL, n_groups=1, seed=0, estimator=None, **task
):
    return BatchSimulator(
        TaskConfig(gait, randomization, **task),
        make_physics(A1, *[StationConfig()] * n_groups),
        n_robots=n_robots,
        generator=np.random.default_rng(seed),
        estimator=estimator,
    )


def test_a_lost_robot_is_reported_and_keeps_a_sound_state(trot):
    simulator = make_simulator(trot)
    action = np.zeros((6, 12))
    action[2] = np.nan
    step = simulator.step(action)
    assert step.failures[2, FAILURES.index("not_finite")]
    assert step.terminated.tolist() == [False, False, True, False, False, False]
    assert all(np.isfinite(values).all() for values in simulator.state.as_arrays().values())
    assert np.isfinite(simulator.observe()).all()


@pytest.mark.parametrize("engine", ["drake", "mujoco"])
@pytest.mark.parametrize("limited", [True, False])
def test_either_engine_follows_the_nearest_targets_within_the_joints_ranges(
    trot, engine, limited, generator
):
    task = TaskConfig(trot, NOMINAL, joint_law=JointLaw(limited=limited))
    physics = make_physics(A1, StationConfig(time_step=0.01, engine=engine))
    simulator = BatchSimulator(
        task, physics, n_robots=3, generator=np.random.default_rng(0), estimator=None
    )
    asked = generator.normal(size=(3, 12), scale=6.0)
    before = simulator.state.plant
    targets = A1.joint_targets(asked)
    assert np.any(targets > A1.upper_limits)
    if limited:
        targets = np.clip(targets, A1.lower_limits, A1.upper_limits)
    expected = physics.step(before, targets, previous_targets=targets).states
    simulator.step(asked)
    np.testing.assert_array_equal(simulator.state.plant, expected)
    # The robot is shown what its joints followed.
    own = simulator.proprioception()
    shown = indices_of("previous action", simulator.layout.names[: own.shape[1]])
    followed = A1.limited_action(asked) if limited else asked
    np.testing.assert_array_equal(own[:, list(shown)], followed)


def test_reset_starts_the_given_robots_alone(trot, generator):
    simulator = make_simulator(trot)
    for _ in range(5):
        simulator.step(0.3 * generator.normal(size=(6, 12)))
    before = simulator.state.as_arrays()
    simulator.reset(np.array([1, 4]))
    for name, values in simulator.state.as_arrays().items():
        np.testing.assert_array_equal(values[[0, 2, 3, 5]], before[name][[0, 2, 3, 5]])
    assert simulator.state.steps.tolist() == [5, 0, 5, 5, 0, 5]
    assert not simulator.state.memory.action[[1, 4]].any()


def test_commands_are_drawn_anew_every_ten_seconds(trot):
    simulator = make_simulator(trot)
    ages = np.array([COMMAND_STEPS - 1, 1, 2, 3, 4, 5])
    simulator.restore(simulator.state._replace(steps=ages))
    before = simulator.state.command.velocity
    simulator.step(np.zeros((6, 12)))
    changed = np.any(simulator.state.command.velocity != before, axis=1)
    assert changed.tolist() == [True, False, False, False, False, False]


def test_a_state_once_taken_stays_as_it_is(trot, generator):
    simulator = make_simulator(trot, randomization=Randomization(push_interval=0.02))
    ages = np.full(6, COMMAND_STEPS - 2)
    simulator.restore(simulator.state._replace(steps=ages))
    taken = []
    for _ in range(4):
        taken.append(simulator.state)
        kept = {name: values.copy() for name, values in simulator.state.as_arrays().items()}
        simulator.step(0.3 * generator.normal(size=(6, 12)))
        simulator.reset(np.array([1, 4]))
        simulator.set_command(Command(np.ones((6, 2)), np.full(6, 7.0)))
        for name, values in taken[-1].as_arrays().items():
            np.testing.assert_array_equal(values, kept[name], err_msg=name)
    with pytest.raises(AttributeError):
        simulator.state.steps = ages


def test_a_command_that_was_set_stays_and_is_what_the_machine_serves(trot):
    simulator = make_simulator(trot, randomization=Randomization(push_speed=0.0))
    simulator.restore(simulator.state._replace(steps=np.full(6, COMMAND_STEPS - 2)))
    message = Command(np.full((6, 2), 0.25), np.full(6, 11.0))
    simulator.set_command(message)
    for _ in range(4):
        simulator.step(np.zeros((6, 12)))
        np.testing.assert_array_equal(simulator.state.command.velocity, message.velocity)
        np.testing.assert_array_equal(simulator.state.command.dwell, message.dwell)


def test_a_scenario_is_played_as_it_says(trot):
    scenario = Scenario(
        station=StationConfig(friction=0.3),
        command=FixedCommand(speed=0.4, yaw_rate=0.2, dwell=7),
        sensor_noise=2.0,
        push_speed=0.7,
        push_interval=3.0,
        weights=RewardWeights(torque=-1.0),
        limits=TerminationLimits(trunk_height=0.1),
    )
    task = replace(TaskConfig.of_scenario(trot, scenario), episode_steps=9)
    assert task.randomization == replace(
        NOMINAL, friction=(0.3, 0.3), push_speed=0.7, push_interval=3.0, sensor_noise=2.0
    )
    assert (task.weights, task.limits) == (scenario.weights, scenario.limits)
    physics = make_physics(A1, scenario.station)
    simulator = BatchSimulator(
        task, physics, n_robots=3, generator=np.random.default_rng(0), estimator=None
    )
    for _ in range(2):
        np.testing.assert_array_equal(simulator.state.command.velocity, [[0.4, 0.2]] * 3)
        np.testing.assert_array_equal(simulator.state.command.dwell, [7.0] * 3)
        simulator.restore(simulator.state._replace(steps=np.full(3, COMMAND_STEPS - 1)))
        simulator.step(np.zeros((3, 12)))
    np.testing.assert_array_equal(simulator.friction_of_robots(), [0.3] * 3)


@pytest.mark.parametrize(
    ("command", "message"),
    [
        (SliderCommand(), "command uses sliders"),
        (FixedCommand(speed=3.0), "speed is 3.0; give -1 to 1"),
        (DrawnCommands((0.0, 3.0)), "speed_range is"),
    ],
)
def test_commands_that_a_batch_cannot_be_given_are_refused(trot, command, message):
    with pytest.raises(InputError, match=message):
        TaskConfig.of_scenario(trot, Scenario(command=command))


def test_pushes_add_to_the_base_velocity(trot):
    always = Randomization(push_interval=0.02, push_speed=1.0)
    pushed, quiet = (
        make_simulator(trot, randomization=randomization)
        for randomization in (always, replace(always, push_speed=0.0))
    )
    for simulator in (pushed, quiet):
        states = kinematics.standing_state(A1, np.tile(A1.default_stance, (6, 1)))
        simulator.start_at(states, Command(np.zeros((6, 2)), np.full(6, 8.0)))
        simulator.step(np.zeros((6, 12)))
    difference = (pushed.state.plant - quiet.state.plant)[:, quadruped.LINEAR_VELOCITY]
    assert np.all(np.abs(difference[:, :2]).max(axis=1) > 0.01)
    np.testing.assert_array_equal(difference[:, 2], 0)


def test_state_survives_being_taken_apart(trot):
    simulator = make_simulator(trot)
    again = simulator.state.with_arrays(simulator.state.as_arrays())
    for name, values in simulator.state.as_arrays().items():
        assert again.as_arrays()[name] is values


def test_the_estimator_fills_the_body_state(trot):
    simulator = make_simulator(trot)
    np.testing.assert_array_equal(simulator.observe()[:, -7:], simulator.body_state())
    blind = make_simulator(trot, estimator=lambda own: np.full((len(own), 7), 9.0))
    assert np.all(blind.observe()[:, -7:] == 9.0)


def test_the_machine_reads_the_heights_that_were_estimated_a_step_before(trot):
    message = []

    def estimator(own):
        message.append(np.full((len(own), 7), 0.1 * len(message)))
        return message[-1]

    simulator = make_simulator(trot, estimator=estimator)
    read = []
    step = simulator.machine.step

    def listening(*values, foot_height, **named):
        read.append(foot_height[0, 0])
        return step(*values, foot_height=foot_height, **named)

    simulator.machine.step = listening
    for _ in range(3):
        simulator.step(np.zeros((6, 12)))
    np.testing.assert_allclose(read, [0.0, 0.1, 0.2])


def test_a_sensor_is_stuck_in_the_share_of_episodes_that_was_asked_for(generator):
    assert not NOMINAL.stuck_contacts(9, generator).any()
    stuck = replace(NOMINAL, stuck_share=0.1).stuck_contacts(4000, generator)
    assert np.mean(stuck.any(axis=1)) == pytest.approx(0.1, abs=0.02)
    assert np.abs(stuck).sum(axis=1).max() == 1
    assert {(foot, own) for foot in range(4) for own in stuck[:, foot] if own} == {
        (foot, own) for foot in range(4) for own in (-1, 1)
    }
    named = replace(NOMINAL, stuck_open=("FR",)).stuck_contacts(2, generator)
    assert named.tolist() == 2 * [[0, -1, 0, 0]]


def test_a_policy_moves_its_own_robot_and_no_other(trot, make_policy):
    policy = make_policy(trot)
    policy.robot = load_robot("go2")
    assert TaskConfig.of_scenario(trot, Scenario(), policy).robot is policy.robot
    with pytest.raises(InputError, match=r"'a1'.* made for 'go2'"):
        TaskConfig.of_scenario(trot, Scenario(robot="a1"), policy)
    with pytest.raises(InputError, match="'b2'"):
        Scenario(robot="b2")

"""The two ends of the link: the same robot as in one diagram, and what it does without answers."""

import time
from dataclasses import replace

import numpy as np
import pytest
from pydrake.lcm import DrakeLcm

from glassgait.diagrams.acting import PolicyActing
from glassgait.diagrams.commands import DrawnCommands, FixedCommand
from glassgait.diagrams.link import ControllerEnd, RobotEnd
from glassgait.diagrams.linked_controller import MakeLinkedController
from glassgait.diagrams.locomotion import MakeLocomotion
from glassgait.diagrams.plant_state import push, set_plant_state
from glassgait.diagrams.rollout import make_simulator, record
from glassgait.diagrams.scenario import Scenario
from glassgait.diagrams.station import StationConfig
from glassgait.models.errors import InputError
from glassgait.models.link.channels import Channels
from glassgait.models.link.messages import command_t, sensors_t, targets_t
from glassgait.models.link.watchdog import CROUCH, Phase, Watchdog
from glassgait.models.policies.controller import AlternatingController, alone
from glassgait.models.policies.library import load_expert, load_student
from glassgait.models.robots import kinematics, quadruped
from glassgait.models.robots.joint_law import JointLaw
from glassgait.models.robots.library import load_robot
from glassgait.models.task.gait import load_gait
from glassgait.models.task.imu import ImuErrors
from glassgait.models.task.terrain import PLANE, Terrain

A1 = load_robot()


CHANNELS = Channels("TEST_")
N_STEPS = 60


@pytest.fixture(scope="module")
def page() -> AlternatingController:
    return alone(load_student("trot", "sparse_formula"), load_expert("trot"))


class Ends:
    """Both ends in one process; answers come `late` steps of the plant after their sensors."""

    def __init__(self, gait, policy, scenario, *, seed=0, late=0, day=None):
        self.lcm = DrakeLcm("memq://")
        self.robot = RobotEnd(
            gait, scenario, self.lcm, CHANNELS, watchdog=Watchdog(), session=4, seed=seed
        )
        self.controller = ControllerEnd(PolicyActing(A1, gait, policy, day), self.lcm, CHANNELS)
        self.late = late

    def step(self, *, answered=True):
        self.robot.send()
        for part in range(self.robot.n_parts):
            if answered and part == self.late:
                self.lcm.HandleSubscriptions(0)
                self.controller.answer()
            self.robot.advance(part)

    def run(self, n_steps, **settings):
        """Returns states before, and targets after each step."""
        states, targets = [], []
        for _ in range(n_steps):
            states.append(self.robot.output("state").copy())
            self.step(**settings)
            targets.append(self.robot.output("targets").copy())
        return np.array(states), np.array(targets)


@pytest.mark.parametrize(
    ("late", "time_step", "terrain"),
    [
        (0, 0.01, PLANE),
        (1, 0.01, PLANE),
        (3, 0.004, PLANE),
        (0, 0.01, Terrain("blocks", amplitude=0.01, cells=2)),
    ],
    ids=["at once", "10 ms", "12 ms", "on blocks"],
)
def test_moves_the_robot_as_one_diagram_does(trot, page, late, time_step, terrain):
    station = StationConfig(time_step=time_step, terrain=terrain)
    scenario = Scenario(command=DrawnCommands(), station=station)
    states, targets = Ends(trot, page, scenario, seed=3, late=late).run(N_STEPS)
    world = replace(scenario, latency=late * time_step)
    one = record(make_simulator(MakeLocomotion(trot, world, policy=page), seed=3), N_STEPS)
    np.testing.assert_allclose(states, one["state"][:-1], rtol=0, atol=1e-12)
    expected = A1.joint_targets(one["actions"][:-1], limited=True)
    np.testing.assert_allclose(targets, expected, rtol=0, atol=1e-12)
    # It walks: a foot was lifted.
    assert kinematics.foot_heights(A1, states).max() > 0.02


def test_odometry_runs_at_the_controllers_end(trot, odometry_expert):
    errors = {"encoder_bias": 0.02, "imu": ImuErrors(gyroscope_bias=0.1, delay=1)}
    scenario = Scenario(command=DrawnCommands(), limit_targets=True, **errors)
    states, _ = Ends(trot, alone(odometry_expert), scenario, seed=3).run(N_STEPS)
    diagram = MakeLocomotion(trot, scenario, policy=odometry_expert)
    one = record(make_simulator(diagram, seed=3), N_STEPS)
    np.testing.assert_allclose(states, one["state"][:-1], rtol=0, atol=1e-12)
    assert kinematics.foot_heights(A1, states).max() > 0.02


def test_counts_and_survives_losses(trot, page):
    ends = Ends(trot, page, Scenario(command=FixedCommand()))
    ends.run(50)
    for _ in range(10):
        ends.run(1, answered=False)
        ends.run(7)
    # What was not answered was counted on either side, when the next message came.
    assert ends.robot.tally.rows() == {"heard": 120, "late": 0, "lost": 10, "doubled": 0}
    assert ends.robot.phase is Phase.FOLLOWING
    assert not ends.robot.fallen


@pytest.mark.parametrize("n_steps", [90, pytest.param(94, marks=pytest.mark.slow)])
def test_a_robot_without_a_controller_is_lowered_and_rises_with_the_next(trot, page, n_steps):
    ends = Ends(trot, page, Scenario(command=FixedCommand()))
    ends.run(n_steps)
    walked = ends.robot.output("state")[quadruped.POSITION].copy()
    _, held = ends.run(4, answered=False)
    np.testing.assert_array_equal(held[-1], held[0])
    assert ends.robot.phase is Phase.HOLDING
    states, _ = ends.run(100, answered=False)
    assert ends.robot.phase is Phase.LOWERED
    assert states[-1][quadruped.POSITION][2] < 0.15
    assert kinematics.lean(states[:, quadruped.QUATERNION]).max() < 45.0
    assert kinematics.lean(states[-1][quadruped.QUATERNION]) < 10.0
    assert not ends.robot.fallen
    ends.run(200)
    assert ends.robot.phase is Phase.FOLLOWING
    assert not ends.robot.fallen
    assert ends.robot.output("state")[quadruped.POSITION][0] > walked[0] + 0.1


def test_a_robot_on_its_back_does_not_rise(trot, page):
    ends = Ends(trot, page, Scenario(command=FixedCommand()))
    ends.run(20)
    ends.run(70, answered=False)
    state = kinematics.standing_state(A1, CROUCH)
    state[quadruped.QUATERNION] = 0.0, 1.0, 0.0, 0.0
    state[quadruped.POSITION] = 0.0, 0.0, 0.06
    set_plant_state(ends.robot.diagram, ends.robot.simulator.get_mutable_context(), state)
    _, targets = ends.run(60)
    assert ends.robot.phase is Phase.TIPPED
    np.testing.assert_array_equal(targets[-1], CROUCH)


def test_an_answer_that_comes_after_the_next_sensors_is_late_and_taken(trot, page):
    ends = Ends(trot, page, Scenario())
    ends.run(5)
    robot_end = ends.robot
    robot_end.send()
    ends.lcm.HandleSubscriptions(0)
    for part in (0, 1, 0):
        robot_end.advance(part)
    assert robot_end.phase is Phase.HOLDING
    before = robot_end.output("targets").copy()
    ends.controller.answer()
    robot_end.advance(1)
    assert robot_end.tally.rows() == {"heard": 6, "late": 1, "lost": 0, "doubled": 0}
    assert np.any(robot_end.output("targets") != before)


def test_a_robot_that_fell_is_put_back_and_its_controller_starts_anew(trot, page):
    ends = Ends(trot, page, Scenario(command=FixedCommand()))
    ends.run(50)
    context = ends.robot.simulator.get_mutable_context()
    push(ends.robot.diagram, context, np.array([0.0, 6.0, 0.0]))
    for _ in range(100):
        ends.run(1)
        if ends.robot.fallen:
            break
    assert ends.robot.fallen
    ends.robot.put_back()
    assert ends.robot.phase is Phase.STANDING
    np.testing.assert_array_equal(ends.robot.output("state"), kinematics.standing_state(A1))
    ends.run(100)
    assert ends.robot.phase is Phase.FOLLOWING
    assert not ends.robot.fallen


def test_a_controller_starts_anew_with_each_message_until_it_is_followed(trot, page):
    ends = Ends(trot, page, Scenario(), late=5)
    machine = ends.controller.diagram.GetOutputPort("rm_state")
    for _ in range(30):
        ends.robot.send()
        ends.lcm.HandleSubscriptions(0)
        ends.controller.answer()
        # Its answers get lost.
        ends.lcm.HandleSubscriptions(0)
        ends.robot.put_back()
        for part in range(ends.robot.n_parts):
            ends.robot.advance(part)
        ends.robot.put_back()
        context = ends.controller.simulator.get_context()
        np.testing.assert_array_equal(machine.Eval(context), [1, 0])
        assert context.get_time() == pytest.approx((ends.robot.step - 1) * 0.02)


def test_answers_every_message_once(trot, page):
    ends = Ends(trot, page, Scenario())
    assert not ends.controller.answer()
    ends.robot.send()
    ends.robot.send()
    ends.lcm.HandleSubscriptions(0)
    assert ends.controller.answer()
    assert not ends.controller.answer()
    ends.robot.send()
    ends.lcm.HandleSubscriptions(0)
    assert not ends.controller.answer()
    assert ends.controller.tally.doubled == 2


def disturbed(trot, page, published, n_steps=25):
    """Returns ends whose channels carry more, and what honest ones alone do from the same seed."""
    ends, alone = (Ends(trot, page, Scenario(command=FixedCommand())) for _ in range(2))
    honest_states, honest_targets = alone.run(n_steps)
    states, targets = [], []
    for _ in range(n_steps):
        states.append(ends.robot.output("state").copy())
        ends.robot.send()
        published(ends, "sensors")
        ends.lcm.HandleSubscriptions(0)
        ends.controller.answer()
        published(ends, "targets")
        for part in range(ends.robot.n_parts):
            ends.robot.advance(part)
        targets.append(ends.robot.output("targets").copy())
    np.testing.assert_array_equal(states, honest_states)
    np.testing.assert_array_equal(targets, honest_targets)
    return ends


def test_messages_of_another_kind_are_counted_and_passed_over(trot, page):
    def published(ends, when):
        own, others = {
            "sensors": (CHANNELS.sensors, [CHANNELS.command]),
            "targets": (CHANNELS.targets, []),
        }[when]
        for channel in (own, *others):
            ends.lcm.Publish(channel, b"nonsense")
            ends.lcm.Publish(channel, b"")
        # Of the right kind at its begin, and then cut short.
        ends.lcm.Publish(own, {"sensors": sensors_t, "targets": targets_t}[when]().encode()[:50])

    ends = disturbed(trot, page, published)
    assert ends.controller.n_foreign == 25 * 5
    assert ends.robot.n_foreign == 25 * 3


def stamped(kind, session, sequence, position=0.0):
    message = kind()
    message.session, message.sequence, message.utime = (
        session,
        sequence,
        min(20_000 * sequence, 2**62),
    )
    message.joint_position = [position] * 12
    return message


USELESS = {
    "late": lambda kind, step: stamped(kind, 4, max(step - 3, 0)),
    # Before any was answered, nothing shows that this one is a remnant.
    "of another session": lambda kind, step: stamped(kind, 3 if step else 0, step + 100),
    "of nobody": lambda kind, step: stamped(kind, 0, step),
    "of a time that never comes": lambda kind, step: stamped(kind, 4, 2**62),
    "of a time before all": lambda kind, step: stamped(kind, 4, -1),
    "not finite": lambda kind, step: stamped(kind, 4, step, np.nan),
}


@pytest.mark.parametrize("useless", USELESS)
def test_a_useless_message_does_not_take_the_place_of_the_honest_one(trot, page, useless):
    def published(ends, when):
        kind = {"sensors": sensors_t, "targets": targets_t}[when]
        message = USELESS[useless](kind, ends.robot.step)
        ends.lcm.Publish(getattr(CHANNELS, when), message.encode())

    assert disturbed(trot, page, published).robot.tally.heard == 25


def test_a_command_that_was_overtaken_is_not_taken(trot, page):
    ends = Ends(trot, page, Scenario(command=FixedCommand(speed=0.5)))
    ends.run(2)
    ends.robot.send()
    late = command_t()
    late.session, late.sequence, late.speed = 4, 1, -0.5
    ends.lcm.Publish(CHANNELS.command, late.encode())
    ends.lcm.HandleSubscriptions(0)
    ends.controller.answer()
    context = ends.controller.simulator.get_context()
    observation = ends.controller.diagram.GetOutputPort("observations").Eval(context)
    assert observation[0] == 0.5


def test_a_controller_hears_a_robot_again_whose_time_leapt(trot, page):
    ends = Ends(trot, page, Scenario())
    ends.run(3)
    ends.lcm.Publish(CHANNELS.sensors, stamped(sensors_t, 4, 10**6).encode())
    ends.lcm.HandleSubscriptions(0)
    assert ends.controller.answer()
    ends.robot.send()
    ends.lcm.HandleSubscriptions(0)
    assert ends.controller.answer()
    assert ends.controller.simulator.get_context().get_time() == pytest.approx(3 * 0.02)


def test_targets_far_beyond_the_joints_ranges_are_not_followed(trot, page):
    ends = Ends(trot, page, Scenario())
    ends.run(5)
    before = ends.robot.output("targets").copy()
    ends.robot.send()
    for position in (1e308, -1e308, 5.9):
        message = stamped(targets_t, 4, ends.robot.step, position)
        ends.lcm.Publish(CHANNELS.targets, message.encode())
        ends.robot.advance(0)
        np.testing.assert_array_equal(ends.robot.output("targets"), before)
    assert not ends.robot.answered


def test_answers_to_another_session_are_not_heard(trot, page):
    ends = Ends(trot, page, Scenario())
    stale = targets_t()
    stale.session = 99
    ends.lcm.Publish(CHANNELS.targets, stale.encode())
    ends.robot.send()
    ends.robot.advance(0)
    assert ends.robot.tally.heard == 0
    assert ends.robot.phase is Phase.STANDING


@pytest.mark.parametrize(
    ("world", "reported"),
    [
        ({"latency": 0.01}, "latency"),
        ({"contact_flips": 0.01}, "contact_flips"),
        ({"stuck_open": ("FL",)}, "stuck_open"),
        ({"true_body_state": True}, "true_body_state"),
        ({"limit_targets": False}, "limit_targets"),
        ({"station": StationConfig(time_step=0.0), "accuracy": 1e-5}, "station.time_step"),
    ],
)
def test_worlds_that_are_not_made_for_two_processes_are_refused(trot, page, world, reported):
    with pytest.raises(InputError, match=f"{reported} is not made for two processes"):
        Ends(trot, page, Scenario(**world))


def test_a_policy_of_another_gait_is_refused(page):
    with pytest.raises(InputError, match="trot"):
        MakeLinkedController(
            PolicyActing(A1, load_gait("pace"), page), DrakeLcm("memq://"), CHANNELS
        )


def test_a_policy_whose_joints_have_other_gains_than_the_robots_end_is_refused(trot, page):
    firm = page.policy.with_joint_law(JointLaw((60.0, 1.0)))
    with pytest.raises(InputError, match="learned with joints of gains"):
        MakeLinkedController(
            PolicyActing(A1, trot, alone(firm, page.expert)), DrakeLcm("memq://"), CHANNELS
        )


def test_a_step_of_both_ends_takes_less_than_a_control_period(trot, page):
    ends = Ends(trot, page, Scenario())
    ends.run(5)
    begun = time.thread_time()
    ends.run(50)
    assert (time.thread_time() - begun) / 50 < 0.02

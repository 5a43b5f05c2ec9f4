"""Both ends of Unitree's wire: the robot rises, walks, and is damped when anything is wrong."""

import numpy as np
import pytest
from pydrake.lcm import DrakeLcm

from glassgait.diagrams.acting import PolicyActing
from glassgait.diagrams.link import ControllerEnd
from glassgait.diagrams.scenario import Scenario
from glassgait.diagrams.unitree_controller_end import UnitreeControllerEnd
from glassgait.diagrams.unitree_robot_end import Drive, UnitreeRobotEnd
from glassgait.models.errors import InputError
from glassgait.models.link.channels import Channels
from glassgait.models.link.dds import Heard
from glassgait.models.link.messages import command_t, sensors_t, targets_t
from glassgait.models.link.motors import MotorCommand, pack_low_cmd
from glassgait.models.link.operator import Asked
from glassgait.models.link.remote import Button, Remote, write_remote
from glassgait.models.link.supervision import Fault, Stage, Supervision
from glassgait.models.link.unitree_messages import LOW_CMD, is_sound, seal
from glassgait.models.policies.controller import alone
from glassgait.models.policies.library import load_expert, load_student
from glassgait.models.robots import kinematics, quadruped
from glassgait.models.robots.library import load_robot
from glassgait.models.task.command import Command

A1 = load_robot()
ROBOT, CONTROLLER, ROGUE = 1, 2, 3
"""Publishers."""

FORWARD = Command(np.array([0.5, 0.0]), np.array(8.0))
OURS = [3, 4, 5, 0, 1, 2, 9, 10, 11, 6, 7, 8]
"""Motors of the joints, front left first, written out."""


class Pipe:
    """An end of a wire within one process."""

    def __init__(self, publisher):
        self.publisher, self.waiting, self.sent = publisher, [], []
        self.cut = False

    def join(self, other):
        self.other, other.other = other, self

    def take(self, wait=0.0):
        waiting, self.waiting = self.waiting, []
        return waiting

    def send(self, message):
        self.sent.append(message.copy().reshape(()))
        if not self.cut:
            self.other.waiting.append(Heard(message, self.publisher))


class Ends:
    """Both ends in one process, in simulated time."""

    def __init__(
        self, gait, policy, *, scenario=None, supervision=None, acting=None, operator=None
    ):
        self.robots, self.controllers = Pipe(ROBOT), Pipe(CONTROLLER)
        self.robots.join(self.controllers)
        self.robot = UnitreeRobotEnd(scenario or Scenario(), self.robots, seed=3)
        self.controller = UnitreeControllerEnd(
            acting or PolicyActing(A1, gait, policy),
            self.controllers,
            operator=operator or (lambda *_: Asked(FORWARD)),
            supervision=supervision or Supervision(rising=1.0, self_test=False),
            clock=lambda: self.robot.simulator.get_context().get_time(),
        )

    def run(self, n_steps, *, controlled=True, disturb=lambda _: None):
        states = []
        for _ in range(n_steps):
            states.append(self.robot.output("state").copy())
            self.robot.send()
            for part in range(self.robot.n_parts):
                disturb(self)
                if controlled:
                    self.controller.listen(0.0)
                    self.controller.answer()
                self.robot.advance(part)
        return np.array(states)


@pytest.fixture(scope="module")
def page():
    return alone(load_student("trot", "sparse_formula"), load_expert("trot"))


@pytest.fixture
def ends(trot, page):
    return Ends(trot, page)


def damped(ends, fault):
    course = ends.controller.course
    return (course.stage, course.fault) == (Stage.DAMPED, fault)


def test_the_robot_rises_from_the_ground_and_walks(ends):
    states = ends.run(150)
    height = states[:, 6]
    assert height[0] < 0.15
    assert height[60:].min() > 0.2
    assert kinematics.lean(states[:, quadruped.QUATERNION]).max() < 15.0
    assert states[-1, quadruped.POSITION][0] > 0.3
    assert kinematics.foot_heights(A1, states[60:]).max() > 0.02
    assert ends.controller.course.stage is Stage.FOLLOWING
    assert ends.robot.phase is Drive.DRIVEN
    counts = ends.controller.counts()
    # The latest state waits for the next step.
    assert len(ends.controllers.waiting) == 1
    assert (counts["states heard"], counts["states lost"]) == (1499, 0)
    assert ends.robot.counts()["commands heard"] == counts["commands sent"] == 1500
    assert all(is_sound(message) for message in ends.controllers.sent)


def test_targets_are_those_of_a_controller_that_is_told_the_same(ends, trot, page):
    """Told by LCM, in this process; what it is told is written out here, field by field."""
    ends.run(90)
    lcm, channels, answers = DrakeLcm("memq://"), Channels("SAME_"), []
    lcm.Subscribe(channels.targets, lambda data: answers.append(targets_t.decode(data)))
    other = ControllerEnd(PolicyActing(A1, trot, page), lcm, channels)
    command = command_t()
    command.session, command.speed, command.dwell = 1, 0.5, 8.0
    lcm.Publish(channels.command, command.encode())
    touching, force, followed = np.zeros(4, bool), np.zeros(3), False
    for index, (state, sent) in enumerate(
        zip(ends.robots.sent, ends.controllers.sent, strict=True)
    ):
        counts = state["foot_force"][[1, 0, 3, 2]]
        touching = np.where(touching, counts > 40, counts >= 60)
        force += 0.002 * state["imu_state"]["accelerometer"].astype(float)
        if index % 10 == 0:
            sensors = sensors_t()
            sensors.session, sensors.sequence = 1, index // 10
            sensors.utime = 20_000 * sensors.sequence
            sensors.joint_position = state["motor_state"]["q"][OURS].tolist()
            sensors.joint_velocity = state["motor_state"]["dq"][OURS].tolist()
            sensors.foot_contact = touching.tolist()
            sensors.angular_velocity = state["imu_state"]["gyroscope"].tolist()
            sensors.velocity_change = force.tolist()
            w, x, y, z = state["imu_state"]["quaternion"].astype(float)
            length = w * w + x * x + y * y + z * z
            down = [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y) / length]
            sensors.gravity = [-down[0] / length, -down[1] / length, -down[2]]
            sensors.followed = followed
            force[:] = 0.0
            lcm.Publish(channels.sensors, sensors.encode())
            lcm.HandleSubscriptions(0)
            other.answer()
            lcm.HandleSubscriptions(0)
        followed = index >= 500
        if followed:
            motors = sent["motor_cmd"]["q"][OURS]
            np.testing.assert_allclose(motors, answers[-1].joint_position, rtol=0, atol=1e-6)
    assert len(answers) == 90


def test_a_silent_robot_is_damped_for_good(ends):
    ends.run(60)
    ends.robots.cut = True
    ends.run(7)
    assert damped(ends, Fault.SILENT)
    assert ends.robot.phase is Drive.DAMPED
    ends.robots.cut = False
    states = ends.run(100)
    assert damped(ends, Fault.SILENT)
    # It sinks to the ground, and not fast.
    assert states[-1, 6] < 0.15
    assert np.diff(states[:, 6]).min() > -0.02
    assert kinematics.lean(states[:, quadruped.QUATERNION]).max() < 20.0


def test_a_robot_whose_controller_vanishes_goes_on_by_its_last_command(ends):
    ends.run(60)
    ends.run(20, controlled=False)
    assert ends.robot.phase is Drive.ALONE


def test_a_controller_that_was_late_itself_damps(ends):
    ends.run(60)
    ends.run(6, controlled=False)
    ends.run(1)
    assert damped(ends, Fault.LATE)
    assert ends.robot.phase is Drive.DAMPED


@pytest.mark.parametrize("stage", [Stage.RISING, Stage.FOLLOWING])
def test_two_buttons_of_an_operators_gamepad_damp_for_good(trot, page, stage):
    pressed = []
    ends = Ends(trot, page, operator=lambda *_: Asked(FORWARD, damped=bool(pressed)))
    ends.run(20 if stage is Stage.RISING else 60)
    assert ends.controller.course.stage is stage
    pressed.append(True)
    ends.run(2)
    pressed.clear()
    ends.run(2)
    assert damped(ends, Fault.ASKED)
    assert ends.robot.phase is Drive.DAMPED


def test_what_is_pressed_before_the_robot_follows_is_not_remembered(trot, page):
    heard = []

    def operator(remote, _):
        heard.append((ends.controller.course.stage, remote.buttons))
        return Asked(FORWARD)

    ends = Ends(trot, page, operator=operator)

    def pressed():
        return {stage for stage, buttons in heard if Button.START in buttons}

    ends.robot.remote = write_remote(Remote(Button.START, 0.0, 0.0, 0.0, 0.0))
    ends.run(60)
    assert {stage for stage, _ in heard} == {Stage.RISING, Stage.FOLLOWING}
    assert not pressed()
    ends.robot.remote = write_remote(Remote.untouched())
    ends.run(5)
    ends.robot.remote = write_remote(Remote(Button.START, 0.0, 0.0, 0.0, 0.0))
    ends.run(5)
    assert pressed() == {Stage.FOLLOWING}


def test_two_buttons_of_the_remote_damp(ends):
    ends.run(60)
    ends.robot.remote = write_remote(Remote(Button.L2 | Button.B, 0.0, 0.0, 0.0, 0.0))
    ends.run(1)
    assert damped(ends, Fault.ASKED)
    assert ends.robot.phase is Drive.DAMPED


def test_a_robot_that_is_turned_over_is_damped(ends):
    ends.run(60)
    ends.robot.diagram.GetSubsystemByName("plant").SetPositions(
        ends.robot.diagram.GetSubsystemByName("plant").GetMyMutableContextFromRoot(
            ends.robot.simulator.get_mutable_context()
        ),
        np.array([0.5, 0.5, 0.5, 0.5, 0.0, 0.0, 0.5, *A1.default_stance]),
    )
    ends.run(1)
    assert damped(ends, Fault.LEANS)


def test_states_with_wrong_checksums_damp_only_in_a_row(ends):
    def spoil(every):
        def disturb(ends):
            for heard in ends.controllers.waiting:
                if int(heard.message["tick"]) % every == 0:
                    heard.message["crc"] += 1

        return disturb

    ends.run(60)
    ends.run(20, disturb=spoil(6))
    assert ends.controller.course.stage is Stage.FOLLOWING
    assert ends.controller.counts()["states with a wrong checksum"] > 50
    ends.run(1, disturb=spoil(1))
    ends.run(1, disturb=spoil(1))
    assert damped(ends, Fault.BAD_STATES)


def test_targets_that_are_not_finite_damp(ends):
    ends.run(60)
    sent = len(ends.controllers.sent)
    # The state that waits asks for no new targets.
    ends.controller._targets = np.full(12, np.nan)
    ends.controller.listen(0.0)
    ends.controller.answer()
    assert damped(ends, Fault.BAD_TARGETS)
    (last,) = ends.controllers.sent[sent:]
    assert not last["motor_cmd"]["kp"].any()
    assert np.all(np.isfinite(last["motor_cmd"]["q"]))


def test_a_controller_that_ends_leaves_its_robot_damped(ends, trot, page):
    ends.run(60)
    clock = iter(np.arange(0.0, 10.0, 0.05))
    ends.controller._clock = lambda: 1.2 + next(clock)
    ends.controller.leave()
    ends.run(1, controlled=False)
    assert damped(ends, Fault.ENDED)
    assert ends.robot.phase is Drive.DAMPED


def rogue(ends):
    """Publishes what is not honest on both topics."""
    tick = int(ends.robots.sent[-1]["tick"])
    state = ends.robots.sent[-1].copy().reshape(())
    state["motor_state"]["q"] = 1.0
    state["tick"] = tick + 1
    nonsense = state.copy().reshape(())
    nonsense["imu_state"]["quaternion"] = np.nan
    wrong = pack_low_cmd(A1, MotorCommand.to(A1.lower_limits, (400.0, 1.0)))
    beyond = wrong.copy().reshape(())
    beyond["motor_cmd"]["q"] = 1e9
    bad = [None, LOW_CMD.blank(), seal(beyond), wrong]
    ends.controllers.waiting += [Heard(None, ROGUE), Heard(seal(state), ROGUE)]
    ends.controllers.waiting += [Heard(seal(nonsense), ROGUE), Heard(ends.robots.sent[0], ROBOT)]
    ends.robots.waiting += [Heard(message, ROGUE) for message in bad]


def test_rogue_messages_change_nothing(trot, page):
    calm, disturbed = Ends(trot, page), Ends(trot, page)
    first = [pair.run(1) for pair in (calm, disturbed)]
    np.testing.assert_array_equal(*first)
    np.testing.assert_array_equal(calm.run(60), disturbed.run(60, disturb=rogue))
    counts = disturbed.controller.counts()
    assert counts["messages of another kind"] == 600
    assert counts["states of another publisher"] == 1200
    assert counts["states that are old"] == 600
    assert disturbed.robot.n_foreign == 600
    assert disturbed.robot.counts()["commands with a wrong checksum"] == 600
    limits = A1.lower_limits - 1e-6, A1.upper_limits + 1e-6
    for message in disturbed.controllers.sent:
        assert np.all(message["motor_cmd"]["q"][OURS] >= limits[0])
        assert np.all(message["motor_cmd"]["q"][OURS] <= limits[1])


@pytest.mark.parametrize(
    ("world", "reported"), [({"latency": 0.01}, "latency"), ({"true_body_state": True}, "true")]
)
def test_worlds_that_are_not_made_for_two_processes_are_refused(trot, page, world, reported):
    with pytest.raises(InputError, match=f"{reported}.* is not made for two processes"):
        Ends(trot, page, scenario=Scenario(**world))


TESTED = Supervision(rising=1.0)
UNTIL_TESTED = 165
"""Control steps until a robot has risen and passed the self-test."""


def test_a_robot_that_is_wired_rightly_passes_the_self_test_and_walks(trot, page):
    ends = Ends(trot, page, supervision=TESTED)
    ends.run(60)
    assert ends.controller.course.stage is Stage.TESTING
    ends.run(UNTIL_TESTED - 60)
    assert ends.controller.course.stage is Stage.FOLLOWING
    states = ends.run(60)
    assert kinematics.foot_heights(A1, states).max() > 0.02


def miswired(motors=None, signs=None):
    """Returns how a robot answers whose motors are numbered otherwise, or turn the other way."""
    order = np.arange(20)
    if motors is not None:
        order[list(motors)] = order[list(motors[::-1])]
    sign = np.ones(20)
    sign[list(signs or [])] = -1.0

    def change(message):
        message = message.copy().reshape(())
        field = "motor_state" if "motor_state" in message.dtype.names else "motor_cmd"
        own = message[field][order].copy()
        for name in ("q", "dq"):
            own[name] = own[name] * sign
        message[field] = own
        return seal(message)

    return change


@pytest.mark.parametrize(
    "wiring",
    [
        {"motors": (0, 3)},  # The hips of the front legs.
        pytest.param({"motors": (7, 10)}, marks=pytest.mark.slow),  # The thighs of the rear legs.
        pytest.param({"motors": (2, 5)}, marks=pytest.mark.slow),  # The calves of the front legs.
        pytest.param({"signs": [3]}, marks=pytest.mark.slow),
        pytest.param({"signs": [4]}, marks=pytest.mark.slow),
    ],
)
def test_a_robot_that_is_wired_otherwise_is_damped_before_it_walks(trot, page, wiring):
    ends, change = Ends(trot, page, supervision=TESTED), miswired(**wiring)
    for pipe in (ends.robots, ends.controllers):
        send = pipe.send
        pipe.send = lambda message, send=send: send(change(message))
    for _ in range(UNTIL_TESTED):
        ends.run(1)
        if ends.controller.course.stage is Stage.DAMPED:
            break
    assert damped(ends, Fault.MISWIRED) or damped(ends, Fault.LEANS)
    assert ends.controller.findings or damped(ends, Fault.LEANS)
    assert ends.controller.course.fault is not None

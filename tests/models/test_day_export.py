"""The C of a robot's day does what Python does, step by step."""

import numpy as np
import pytest

from glassgait.diagrams.scenario import Scenario
from glassgait.models.export.binding import BAD_INPUT, COMMAND_LIMITED, N_DAY, Sensors
from glassgait.models.export.controller import write_controller
from glassgait.models.export.reference import PythonController
from glassgait.models.policies.controller import alone
from glassgait.models.policies.library import load_expert, load_student
from glassgait.models.policies.switched import SwitchedPolicy
from glassgait.models.task.command import Command
from glassgait.models.task.day import REQUESTS, load_day
from glassgait.models.task.gait import load_gait
from glassgait.models.task.gait_switch import GaitSwitch
from glassgait.studies.common.episode import episode, give, lie, request_mode
from glassgait.studies.export.agreement import RecordedMoments
from glassgait.studies.export.files import has_compiler, load_controller

DAY = load_day()
DAMPED, REST = DAY.names.index("damped"), DAY.names.index("rest")
COMMAND = Command(np.array([0.4, 0.2]), np.array(8.0))
STILL = Command(np.zeros(2), np.array(8.0))
pytestmark = pytest.mark.skipif(not has_compiler(), reason="there is no C compiler")


def controller_of(name):
    if name == "several":
        switch = GaitSwitch([load_gait("trot"), load_gait("walk")])
        parts = [alone(load_expert(gait.name)) for gait in switch.gaits]
        return switch, alone(SwitchedPolicy(switch, parts))
    policy = load_expert("trot") if name == "expert" else load_student("trot", name)
    return load_gait("trot"), alone(policy, load_expert("trot"))


@pytest.fixture(
    scope="module",
    params=[
        "sparse_formula",
        pytest.param("expert", marks=pytest.mark.slow),
        pytest.param("several", marks=pytest.mark.slow),
    ],
)
def both(request, tmp_path_factory):
    """Python's controller and C's, of a page, a network and two gaits."""
    gait, controller = controller_of(request.param)
    names = {"name": "day", "policy_name": request.param, "version": "0"}
    written = write_controller(gait, controller, day=DAY, **names)
    compiled = load_controller(written, tmp_path_factory.mktemp("day"))
    return PythonController(gait, controller, DAY), compiled


def recorded():
    """Records what a robot senses over a day, which it lives by the trot's page."""
    gait, controller = controller_of("sparse_formula")

    def every(command):
        return Command(command.velocity[None], np.array([8.0]))

    events = [
        *(
            lie(controller.robot, DAY, np.zeros((1, 12))),
            give(0, every(STILL)),
            request_mode(30, "stand"),
        ),
        *(request_mode(230, "walk"), give(230, every(COMMAND))),
        *(give(330, every(STILL)), give(400, every(COMMAND)), request_mode(450, "sit")),
    ]
    log = RecordedMoments(1)
    episode(
        gait,
        controller,
        Scenario(),
        n_robots=1,
        n_steps=600,
        seed=3,
        observers=[log],
        events=events,
        when_fallen="go on",
        day=DAY,
    )
    (moments,) = log.sequences
    return moments


@pytest.fixture(scope="module")
def moments():
    return recorded()


def requests(n_steps):
    """What the operator requests at each of these steps."""
    asked = np.zeros(n_steps, dtype=int)
    asked[30:230], asked[230:450] = REQUESTS.index("stand"), REQUESTS.index("walk")
    return asked


def modes_of_both(both, moments):
    """Lets both take the same steps, and returns the modes and what was damped."""
    python, compiled = both
    ours, theirs = python.initial(), compiled.initial()
    np.testing.assert_array_equal(ours, theirs)
    modes, damped, status = [], [], []
    for step, (moment, asked) in enumerate(zip(moments, requests(len(moments)), strict=True)):
        own = moment._replace(requested_mode=int(asked))
        one, other = python.step(ours, *own), compiled.step(theirs, *own)
        ours, theirs = one.memory, other.memory
        text = f"step {step}"
        np.testing.assert_allclose(other.targets, one.targets, atol=1e-9, err_msg=text)
        np.testing.assert_allclose(theirs, ours, atol=1e-9, err_msg=text)
        assert (one.damped, one.status) == (other.damped, other.status), text
        modes.append(int(ours[-N_DAY]))
        damped.append(one.damped)
        status.append(one.status)
    return np.array(modes), np.array(damped), np.array(status)


def test_c_lives_through_the_day_as_python_does(both, moments):
    modes, damped, status = modes_of_both(both, moments)
    order = [DAY.names[mode] for i, mode in enumerate(modes) if i == 0 or mode != modes[i - 1]]
    assert order == [
        *("rest", "fold", "rise", "stand", "walk", "stand", "walk", "stand", "sit", "rest")
    ]
    assert not status.any()
    np.testing.assert_array_equal(damped, modes == REST)


def test_a_lean_ends_damped_in_both_and_is_remembered(both, moments):
    tipped = [own._replace(sensors=leaning(own.sensors)) for own in moments[260:270]]
    modes, damped, _ = modes_of_both(both, [*moments[:260], *tipped, *moments[270:449]])
    assert (modes[:260] != DAMPED).all()
    assert (modes[260:] == DAMPED).all()
    assert damped[260:].all()


@pytest.mark.parametrize("wrong", [np.nan, pytest.param(np.inf, marks=pytest.mark.slow), 1e9])
def test_readings_that_fail_hold_the_targets_and_then_end_damped(both, moments, wrong):
    lost = [own._replace(sensors=without_joint(own.sensors, wrong)) for own in moments[260:280]]
    modes, _, status = modes_of_both(both, [*moments[:260], *lost, *moments[280:449]])
    # After more than 0.1 s.
    assert (modes[260:266] != DAMPED).all()
    assert (modes[267:] == DAMPED).all()
    assert (status[260:280] == BAD_INPUT).all()


def test_a_short_loss_of_readings_changes_nothing(both, moments):
    lost = [own._replace(sensors=without_joint(own.sensors, np.nan)) for own in moments[260:263]]
    modes, _, _ = modes_of_both(both, [*moments[:260], *lost, *moments[263:449]])
    assert (modes != DAMPED).all()


def leaning(sensors):
    imu = sensors.imu.copy()
    imu[6:9] = [0.0, 0.8, -0.6]
    return Sensors(sensors.joint_position, sensors.joint_velocity, sensors.touching, imu)


def without_joint(sensors, value):
    position = sensors.joint_position.copy()
    position[4] = value
    return Sensors(position, sensors.joint_velocity, sensors.touching, sensors.imu)


def test_a_command_that_is_not_finite_halts_the_robot_and_does_not_damp_it(both, moments):
    wrong = Command(np.array([np.nan, 0.0]), np.array(8.0))
    lost = [own._replace(command=wrong) for own in moments[280:330]]
    modes, damped, status = modes_of_both(both, [*moments[:280], *lost, *moments[330:449]])
    assert not damped[280:330].any()
    assert (modes != DAMPED).all()
    assert DAY.names[modes[279]] == "walk" and DAY.names[modes[329]] == "stand"
    assert set(status[280:330]) == {COMMAND_LIMITED}

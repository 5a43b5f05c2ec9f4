"""Claims: the shipped ones, and files that are refused in one sentence."""

import pytest

from glassgait.models.certificates.claims import (
    DEFAULT_CLAIMS,
    IMU_CLAIMS,
    Claim,
    claim_files,
    load_claims,
)
from glassgait.models.errors import InputError
from glassgait.models.estimation.sensors import IMU_NOISE, ImuReading
from glassgait.models.robots.library import load_robot
from glassgait.models.robots.robot import DEFAULT_LAW
from glassgait.models.task.gait import gait_names, load_gait
from glassgait.models.task.observation import (
    JOINT_POSITION_NOISE,
    JOINT_VELOCITY_NOISE,
    ObservationLayout,
)
from glassgait.models.task.termination import TerminationLimits


def test_shipped_claims_are_of_every_gait():
    claims = load_claims(DEFAULT_CLAIMS)
    assert {claim.kind for claim in claims} == {"never", "effect", "mirror", "change"}
    assert len(claims) > 10
    for gait in gait_names():
        for claim in claims:
            claim.refuse_unknown(load_gait(gait))


@pytest.mark.parametrize("name", ["a1", "go2"])
def test_a_limit_of_motors_is_each_robots(name):
    robot = load_robot(name)
    for claim in load_claims(DEFAULT_CLAIMS):
        number = claim.number(robot, DEFAULT_LAW)
        match claim.kind:
            case "effect":
                assert number == robot.effort.min() / robot.stiffness
            case "never":
                assert number == robot.damping / robot.stiffness
            case "change":
                assert number == TerminationLimits().action_change


def test_claims_of_noise_go_from_one_end_of_the_sensors_noise_to_the_other():
    (joints,) = (claim for claim in load_claims(DEFAULT_CLAIMS) if claim.kind == "change")
    (all_sensors,) = (claim for claim in load_claims(IMU_CLAIMS) if claim.kind == "change")
    entries = ObservationLayout(2, imu=True).entries
    noise = {"q": JOINT_POSITION_NOISE, "dq": JOINT_VELOCITY_NOISE}
    imu = ImuReading.of(IMU_NOISE)
    for claim, widths in (
        (joints, noise),
        (all_sensors, noise | {"g": imu.gravity[0], "w": imu.angular_velocity[0]}),
    ):
        for symbol in (entry.symbol for entry in entries):
            width = widths.get(symbol.partition(".")[0], 0.0)
            assert claim.change_of(symbol) == pytest.approx(2 * width, abs=1e-12)
    assert claim_files(imu=False) == (DEFAULT_CLAIMS,)
    assert claim_files(imu=True) == (DEFAULT_CLAIMS, IMU_CLAIMS)
    for gait in gait_names():
        all_sensors.refuse_unknown(load_gait(gait), imu=True)
    with pytest.raises(InputError, match="g"):
        all_sensors.refuse_unknown(load_gait("trot"))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("- 1", "must hold the key 'claims'"),
        ("claims: []", "must hold the key 'claims'"),
        ("claims: [3]", "claim 1: is not a mapping|claim 1: "),
        ("claims: [{name: a, kind: limits, least: 1, most: -1}]", "least is above most"),
        ("claims: [{name: a, kind: effect, observations: [t], most: -1}]", "give 0 or more"),
        ("claims: [{name: a, kind: mirrors}]", "kind is 'mirrors'"),
        ("claims: [{name: a, kind: mirror, most: 1.0}]", "has no key 'most'; remove it"),
        ("claims: [{name: a, kind: effect, most: 1.0}]", "needs the key 'observations'"),
        ("claims: [{name: a, kind: never, observations: [t]}]", "needs the key 'never'"),
        ("claims: [{name: a, kind: limits, mots: 1.0}]", "write 'most'"),
        ("claims: [{name: a, kind: limits, most: 1.0}]", "needs the key 'least'"),
        ("claims: [{name: a, kind: limits, joints: [FL_knee]}]", "unknown joint 'FL_knee'"),
        ("claims: [{name: a, kind: change, most: 1.0, changes: {q: -1.0}}]", "changes"),
        ("claims: [{name: a, kind: effect, observations: [t]}]", "needs the key 'most'"),
        ("claims: [{name: a, kind: effect, observations: [t], limit: most}]", "limit"),
        (
            "claims: [{name: a, kind: effect, observations: [t], limit: torque, most: 1}]",
            "most and limit",
        ),
        ("claims: [{name: a, kind: mirror, limit: torque}]", "has no key 'limit'"),
        ("claims: [{name: a, kind: mirror}, {name: a, kind: mirror}]", "two claims are called"),
        ("claims: [{name: a, kind: limits, most: .inf}]", "a finite number"),
        ("claims: [{kind: mirror}]", "claim 1: needs the key 'name'; add it"),
    ],
)
def test_refuses_what_is_no_claim(tmp_path, text, message):
    path = tmp_path / "mine.yaml"
    path.write_text(text)
    with pytest.raises(InputError, match=message) as refused:
        load_claims(path)
    assert str(path) in str(refused.value)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"states": ("q9",)}, "has no state 'q9'"),
        ({"stuck": ("h.XX",)}, "no observation is called 'h.XX'"),
        ({"kind": "never", "observations": ("t",), "never": "rises"}, "t has no slope"),
        ({"kind": "effect", "observations": ("s0", "s1"), "most": 0.0}, "no observation is called"),
        ({"kind": "change", "changes": {"s0": 1.0}, "most": 1.0}, "no observation is called"),
        ({"stuck": ("s0",)}, "no observation is called"),
    ],
)
def test_refuses_names_that_a_gait_does_not_know(values, message):
    with pytest.raises(InputError, match=message):
        limits = {} if "kind" in values else {"kind": "limits", "least": 0.0, "most": 1.0}
        Claim(**{"name": "a"} | limits | values).refuse_unknown(load_gait("trot"))


def test_own_quantities_are_those_of_the_joint():
    claim = Claim(name="a", kind="never", observations=("dq.own", "t"), never="rises")
    symbols = ["dq.FL_hip", "dq.FL_thigh", "t"]
    assert claim.observations_of(1, symbols) == (1, 2)


def test_changes_are_of_kinds_or_of_single_quantities():
    changes = {"q": 0.1, "q.FL_hip": 0.3, "cmd.v": 1.0}
    claim = Claim(name="a", kind="change", changes=changes, most=1.0)
    assert claim.change_of("q.FL_hip") == 0.3
    assert claim.change_of("q.FR_hip") == 0.1
    assert claim.change_of("cmd.v") == 1.0
    assert claim.change_of("cmd.yaw") == 0.0
    assert claim.change_of("dq.FR_hip") == 0.0

"""`deploy.yaml`: all of it must be there, and be what the robot has."""

import json
from dataclasses import fields, replace
from itertools import combinations
from shutil import copytree

import pytest
import yaml

from glassgait.models.errors import InputError
from glassgait.models.export.contract import CONTRACT, Contract, contract_of, read_contract
from glassgait.models.export.controller import write_controller
from glassgait.models.policies.controller import alone
from glassgait.models.policies.library import load_expert
from glassgait.models.policies.switched import SwitchedPolicy
from glassgait.models.robots.library import load_robot
from glassgait.models.task.day import load_day
from glassgait.models.task.gait import load_gait
from glassgait.models.task.gait_switch import GaitSwitch

TROT, A1 = load_gait("trot"), load_robot()
OF_JOINTS = ("stance", "lower_limits", "upper_limits", "effort")


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    """A folder with an exported file and its contract."""
    folder = tmp_path_factory.mktemp("exported")
    file = folder / "trot_expert.c"
    file.write_text("/* a controller */")
    file.with_suffix(".h").write_text("/* its header */")
    contract = contract_of(TROT, alone(load_expert("trot")), file, "expert")
    (folder / CONTRACT).write_text(contract.text())
    return folder


@pytest.fixture
def folder(exported, tmp_path):
    """The same, to be changed."""
    return copytree(exported, tmp_path / "exported")


@pytest.fixture(scope="module")
def written(exported):
    """What the contract holds, as JSON: it is read again fast."""
    return json.dumps(yaml.safe_load((exported / CONTRACT).read_text()))


@pytest.fixture
def changed(folder, written):
    """Reads the contract with something changed in it."""

    def read(change, robot=A1):
        plain = json.loads(written)
        change(plain)
        (folder / CONTRACT).write_text(yaml.dump(plain, Dumper=yaml.CSafeDumper, sort_keys=False))
        return read_contract(folder / CONTRACT, robot)

    return read


def test_what_is_written_is_read_again(folder):
    contract, file, _ = read_contract(folder / CONTRACT, A1)
    assert file == folder / "trot_expert.c"
    assert (contract.stiffness, contract.damping) == (40.0, 1.0)
    assert contract.command_ranges["speed"] == (-TROT.max_speed, TROT.max_speed)
    assert [own.name for own in contract.observations[:2]] == ["Command X", "Command Yaw"]
    assert contract.observations[2].offset == A1.default_stance[0]
    assert (contract.day, "request" in contract.command) == ("none", False)
    assert contract.text() == (folder / CONTRACT).read_text()


@pytest.mark.parametrize("key", [own.name for own in fields(Contract)])
def test_a_missing_key_is_refused_by_name(changed, key):
    with pytest.raises(InputError, match=f"'{key}'"):
        changed(lambda plain: plain.pop(key))


def test_an_unknown_key_is_refused(changed):
    with pytest.raises(InputError, match="extra"):
        changed(lambda plain: plain.update(extra=1))


def exchanges():
    """Every exchange of two entries of every list that has an order of its own."""
    for key, size in (("joints", 12), ("feet", 4), ("motor_order", 4)):
        yield from ((key, pair) for pair in combinations(range(size), 2))


@pytest.mark.parametrize(("key", "pair"), exchanges())
def test_every_exchange_of_two_names_is_refused(changed, key, pair):
    def exchange(plain):
        first, second = pair
        names = plain[key]
        names[first], names[second] = names[second], names[first]

    with pytest.raises(InputError, match=f"'{key}'"):
        changed(exchange)


@pytest.mark.parametrize(
    "key", ["hip_offset", "thigh_offset", "thigh_length", "calf_length", "foot_radius"]
)
def test_every_length_that_is_off_by_a_millimetre_is_refused(changed, key):
    def lengthen(plain):
        own = plain[key]
        plain[key] = [own[0] + 1e-3, own[1]] if isinstance(own, list) else own + 1e-3

    with pytest.raises(InputError, match=f"key '{key}' is not that of the"):
        changed(lengthen)


@pytest.mark.parametrize("key", OF_JOINTS)
@pytest.mark.parametrize("factor", [-1.0, 57.29577951308232])
def test_every_sign_and_unit_of_a_joint_is_refused(changed, key, factor):
    for joint in range(12):

        def change(plain, joint=joint):
            plain[key][joint] *= factor

        with pytest.raises(InputError, match=f"'{key}'"):
            changed(change)


@pytest.mark.parametrize(
    "change",
    [
        lambda plain: plain.update(robot="go2"),
        lambda plain: plain.update(control_period=0.005),
        lambda plain: plain.update(action_scale=0.5),
        lambda plain: plain["sensors"]["joint_position"].update(unit="deg"),
        lambda plain: plain["sensors"]["gravity"].update(frame="world"),
        lambda plain: plain["sensors"].pop("gravity"),
        lambda plain: plain["command"]["yaw_rate"].update(unit="deg/s"),
        lambda plain: plain["targets"]["joint_position"].update(size=11),
        lambda plain: plain["command"].pop("dwell"),
        lambda plain: plain.update(stiffness=400.0),
        lambda plain: plain.update(limited=False),
        lambda plain: plain["command_ranges"].update(speed=[-100.0, 100.0]),
        lambda plain: plain["observations"].pop(),
        lambda plain: plain["observations"][3].update(scale=57.3),
        lambda plain: plain["gaits"].update(trot="0"),
        lambda plain: plain.update(version=True),
        lambda plain: plain.update(file="a\0b"),
        lambda plain: plain.update(file="other.c"),
        lambda plain: plain.update(file="../trot_expert.c"),
        lambda plain: plain.update(file_digest="0" * 64),
        lambda plain: plain.update(stiffness=float("nan")),
        lambda plain: plain.update(version=1),
        lambda plain: plain.update(version=2),
        lambda plain: plain.update(version=3),
        lambda plain: plain["hip_offset"].reverse(),
        lambda plain: plain.update(thigh_offset=-plain["thigh_offset"]),
        lambda plain: plain.update(gaits={}),
        lambda plain: plain.update(numbers="float"),
        lambda plain: plain["rm_states"]["trot"].pop(),
        lambda plain: plain.update(rm_states={}),
        lambda plain: plain.update(estimator="network"),
        lambda plain: plain.update(header_digest="none"),
        lambda plain: plain.update(day="0"),
    ],
)
def test_what_is_not_the_robots_is_refused(changed, change):
    with pytest.raises(InputError, match=f"{CONTRACT}|other.c"):
        changed(change)


def test_a_controller_that_was_edited_is_refused(folder):
    (folder / "trot_expert.c").write_text("/* another */")
    with pytest.raises(InputError, match="file_digest"):
        read_contract(folder / CONTRACT, A1)
    with pytest.raises(InputError, match="'robot' is 'a1', not 'go2'"):
        read_contract(folder / CONTRACT, load_robot("go2"))


def test_a_header_that_was_edited_or_lost_is_refused(folder):
    (folder / "trot_expert.h").write_text("/* another */")
    with pytest.raises(InputError, match="header_digest"):
        read_contract(folder / CONTRACT)
    (folder / "trot_expert.h").unlink()
    with pytest.raises(InputError, match="header_digest"):
        read_contract(folder / CONTRACT)


def test_the_robot_is_the_one_that_ships_of_its_name(folder, changed):
    assert read_contract(folder / CONTRACT)[2].name == "a1"
    with pytest.raises(InputError, match="robot"):
        changed(lambda plain: plain.update(robot="../a1"), robot=None)


def test_says_how_the_c_file_is_called(folder):
    contract, *_ = read_contract(folder / CONTRACT)
    interface = contract.interface()
    written = write_controller(
        TROT, alone(load_expert("trot")), name="trot_expert", policy_name="expert", version="0"
    )
    for key in ("name", "real", "n_states", "has_imu", "has_odometry", "has_day"):
        assert getattr(interface, key) == getattr(written, key)
    assert interface.joint_law.gains_of(A1) == written.joint_law.gains_of(A1)
    assert interface.joint_law.limited == written.joint_law.limited
    with pytest.raises(InputError, match="--format c"):
        replace(contract, file="trot_expert.onnx").interface()


def test_a_day_and_several_gaits_say_what_else_is_asked_and_given(folder):
    expert, file = load_expert("trot"), folder / "trot_expert.c"
    lived = contract_of(TROT, alone(expert), file, "expert", load_day())
    assert "request" in lived.command and "damped" in lived.targets
    assert lived.day == load_day().digest()
    gaits = GaitSwitch([TROT, load_gait("pace")])
    policies = SwitchedPolicy(gaits, [alone(expert), alone(load_expert("pace"))])
    both = contract_of(gaits, alone(policies), file, "expert")
    assert list(both.gaits) == ["trot", "pace"] and "gait" in both.command


def exchanged(entries):
    """Returns a mapping whose first two entries are in each other's place."""
    first, second, *rest = entries
    return {name: entries[name] for name in (second, first, *rest)}


@pytest.mark.parametrize("keys", [("gaits", "rm_states"), ("command_ranges",), ("sensors",)])
def test_every_exchange_of_two_entries_is_refused(folder, keys):
    """A gait's number is its place: in another order another gait would run."""
    gaits, file = GaitSwitch([TROT, load_gait("pace")]), folder / "trot_expert.c"
    policies = SwitchedPolicy(gaits, [alone(load_expert(name)) for name in ("trot", "pace")])
    contract = contract_of(gaits, alone(policies), file, "expert")
    (folder / CONTRACT).write_text(contract.text())
    assert list(read_contract(folder / CONTRACT)[0].gaits) == ["trot", "pace"]
    plain = yaml.safe_load(contract.text())
    plain |= {key: exchanged(plain[key]) for key in keys}
    (folder / CONTRACT).write_text(yaml.safe_dump(plain, sort_keys=False))
    with pytest.raises(InputError, match="'digest'"):
        read_contract(folder / CONTRACT)

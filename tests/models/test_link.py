"""Messages between two processes: their types, what is packed into them, counted and lost."""

import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import glassgait.models.link
from glassgait.models.errors import InputError
from glassgait.models.link.channels import Channels, LinkSettings, Tally
from glassgait.models.link.messages import command_t, sensors_t, targets_t
from glassgait.models.link.packing import (
    pack_command,
    pack_sensors,
    pack_targets,
    unpack_answer,
    unpack_command,
    unpack_imu,
    unpack_joints,
)
from glassgait.models.task.command import Command

FOLDER = Path(glassgait.models.link.__file__).parent


def sources(folder):
    return {path.name: path.read_text() for path in folder.glob("*.py")}


def test_the_types_are_what_lcms_tool_makes(tmp_path):
    tool = shutil.which("lcm-gen", path=Path(sys.executable).parent) or shutil.which("lcm-gen")
    if tool is None:
        pytest.skip("needs lcm-gen, of the wheel lcm")
    command = [tool, "--python", "--ppath", tmp_path, FOLDER / "messages.lcm"]
    subprocess.run(command, check=True)
    made, kept = sources(tmp_path / "messages"), sources(FOLDER / "messages")
    assert made == kept
    assert set(kept) == {"__init__.py", "command_t.py", "sensors_t.py", "targets_t.py"}


def test_a_message_comes_out_as_it_went_in(generator, trot):
    touching = np.array([True, False, True, False])
    joints, imu = generator.normal(size=24), generator.normal(size=9)
    packed = pack_sensors(7, 1.02, joints=joints, touching=touching, imu=imu, followed=True)
    sent = sensors_t.decode(packed.encode())
    assert (sent.session, sent.sequence, sent.utime, sent.followed) == (7, 51, 1_020_000, True)
    np.testing.assert_array_equal(unpack_joints(sent), joints)
    np.testing.assert_array_equal(unpack_imu(sent), imu)
    assert tuple(sent.foot_contact) == tuple(touching)
    targets = generator.normal(size=12)
    answered = targets_t.decode(pack_targets(sent, targets, mode=5, day="a1").encode())
    assert (answered.mode, answered.damped, answered.day) == (5, False, "a1")
    answer = unpack_answer(answered)
    assert (answer.session, answer.time) == (7, 1.02)
    np.testing.assert_array_equal(answer.targets, targets)
    command = Command(np.array([0.4, -0.1]), np.array(7.0))
    message = unpack_command(command_t.decode(pack_command(7, 1.02, command).encode()), trot)
    np.testing.assert_array_equal(message.velocity, command.velocity)
    assert message.dwell == 7.0


def test_a_message_of_another_type_is_not_decoded():
    with pytest.raises(ValueError, match="Decode error"):
        sensors_t.decode(targets_t().encode())


def counted(*sequences, tally=None, session=1, late=()):
    tally = tally or Tally()
    for sequence in sequences:
        tally.count(session, sequence, late=sequence in late)
    return tally.rows()


def test_counts_what_is_late_lost_and_doubled():
    assert counted(5, 6, 7) == {"heard": 3, "late": 0, "lost": 0, "doubled": 0}
    assert counted(0, 1, 4, 4, 5, late=(4,)) == {"heard": 4, "late": 1, "lost": 2, "doubled": 1}


def test_what_was_overtaken_is_not_lost():
    assert counted(0, 2, 1, 3) == {"heard": 4, "late": 0, "lost": 0, "doubled": 0}


def test_another_session_begins_anew():
    tally = Tally()
    counted(0, 1, 2, tally=tally)
    assert counted(0, 1, tally=tally, session=2) == {
        "heard": 5,
        "late": 0,
        "lost": 0,
        "doubled": 0,
    }
    assert tally.sessions == 2


def test_a_leap_of_any_length_is_counted_at_once():
    assert counted(0, 2**60)["lost"] == 2**60 - 1


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"lcm_url": "nonsense"}, "lcm_url is 'nonsense'; write udpm://"),
        ({"lcm_url": "memq://"}, "lcm_url is 'memq://'"),
        ({"channels": "a b"}, "channels is 'a b'; write letters"),
        ({"channels": "a" * 33}, "32 at most"),
    ],
)
def test_places_that_are_none_are_refused(values, message):
    with pytest.raises(InputError, match=message):
        LinkSettings(**values)


def test_channels_begin_with_their_prefix():
    names = LinkSettings(channels="LEFT_").names
    assert names == Channels("LEFT_")
    assert (names.sensors, names.command, names.targets) == (
        "LEFT_SENSORS",
        "LEFT_COMMAND",
        "LEFT_TARGETS",
    )

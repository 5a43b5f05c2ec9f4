"""The Unitree bridge moves a fake robot on the loopback interface, and damps it."""

import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from glassgait.models.export.binding import has_compiler
from glassgait.models.export.contract import CONTRACT, read_contract
from glassgait.studies.cli import main

pytest.importorskip("cyclonedds", reason="needs cyclonedds")

from cyclonedds.domain import DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic

from glassgait.studies.examples import unitree_bridge as bridge

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not has_compiler(), reason="needs a C compiler, cc"),
]

DOMAIN = 143
UPRIGHT = [1.0, 0.0, 0.0, 0.0]


class FakeRobot:
    """Publishes states every 4 ms; its joints are wherever they were last driven to."""

    def __init__(self):
        self._domain = bridge.Domain(DOMAIN, bridge.CONFIGURATION.format("lo"))
        end = DomainParticipant(DOMAIN)
        self._writer = DataWriter(end, Topic(end, "rt/lowstate", bridge.types_of("LowState_")[0]))
        self._reader = DataReader(end, Topic(end, "rt/lowcmd", bridge.types_of("LowCmd_")[0]))
        self.q = np.zeros(12)
        self.commands = []

    def live(self, until, seconds=10.0, quaternion=UPRIGHT, *, silent=False):
        """Lives until a condition holds of the commands, and returns how long that took."""
        record = np.zeros((), bridge.types_of("LowState_")[1])
        record["imu_state"]["quaternion"] = quaternion
        record["imu_state"]["accelerometer"] = 0.0, 0.0, 9.81
        begun = time.monotonic()
        while not until(self.commands):
            assert time.monotonic() - begun < seconds
            record["motor_state"]["q"][:12] = self.q
            # The feet of either diagonal touch by turns, as a trot wants it.
            record["foot_force"] = np.roll([100, 0, 0, 100], int(6.0 * time.monotonic()) % 2 * 2)
            if not silent:
                self._writer.write(bridge.message("LowState_", record))
            for command in self._reader.take(N=100):
                self.commands.append(command)
                if command.motor_cmd[0].kp > 0.0:
                    self.q = np.array([motor.q for motor in command.motor_cmd[:12]])
            time.sleep(0.004)
        return time.monotonic() - begun


def is_damped(commands):
    driven = [motor for motor in commands[-1].motor_cmd if motor.mode] if commands else []
    return len(driven) == 12 and all(motor.kp == 0.0 and motor.kd > 0.0 for motor in driven)


@pytest.fixture(scope="module")
def contract_path(tmp_path_factory):
    folder = tmp_path_factory.mktemp("export")
    export = ["export", "--gait", "trot", "--robot", "go2", "--n-steps", "20"]
    main([*export, "--policy", "formulas", "--output", str(folder)])
    return folder / CONTRACT


@pytest.fixture
def process(contract_path):
    module = "glassgait.studies.examples.unitree_bridge"
    options = ["--domain", str(DOMAIN), "--rising", "0.5", "--speed", "0.3"]
    command = [sys.executable, "-m", module, "--contract", str(contract_path), *options]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as started:
        yield started
        started.kill()


def test_the_checksum_is_the_sdks():
    """The number is by code that was compared with unitree-sdk2py-dimos 1.0.3."""
    message = bridge.low_cmd(np.arange(12), np.linspace(-1.0, 1.0, 12), 20.0, 0.5)
    assert message.crc == 0xB8271B42


@pytest.mark.parametrize("end", ["lean", "silence", "Ctrl-C"])
def test_it_stands_up_follows_and_damps(end, process, contract_path):
    robot, contract = FakeRobot(), read_contract(contract_path)
    motors = [
        [
            f"{leg}_{part}" for leg in contract["motor_order"] for part in ("hip", "thigh", "calf")
        ].index(joint)
        for joint in contract["joints"]
    ]
    robot.live(lambda commands: len(commands) > 0, seconds=60.0)
    begun = len(robot.commands)
    robot.live(lambda commands: len(commands) > begun + 80 or is_damped(commands), seconds=30.0)
    if is_damped(robot.commands):
        pytest.skip("the machine is so busy that the fake robot was silent for 100 ms")

    # It rises from zero angles to the stance, and then the legs trot by turns.
    targets = np.array([[one.motor_cmd[i].q for i in motors] for one in robot.commands])
    stance = np.array(contract["stance"])
    apart = np.abs(targets - stance).max(axis=1)
    assert apart[0] > 0.9 * np.abs(stance).max()
    assert apart.min() < 1e-6
    assert np.ptp(targets[-30:], axis=0).max() > 0.05
    assert np.all(targets >= np.array(contract["lower_limits"]) - 1e-6)
    assert robot.commands[-1].motor_cmd[motors[0]].kp == pytest.approx(contract["stiffness"])

    # Whatever is wrong, it damps and ends.
    match end:
        case "lean":
            said, lean = "leans by more than 60", np.radians(65.0) / 2.0
            robot.live(is_damped, quaternion=[np.cos(lean), np.sin(lean), 0.0, 0.0])
        case "silence":
            said = "no state came"
            assert robot.live(is_damped, silent=True) < 5.0
        case _:
            said = "Ctrl-C"
            process.send_signal(signal.SIGINT)
            robot.live(is_damped)
    out, _ = process.communicate(timeout=20)
    assert said in out

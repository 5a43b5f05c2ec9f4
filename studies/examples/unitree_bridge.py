"""Moves a Unitree Go2 by an exported controller, over DDS; it was never tested on hardware.

    python -m glassgait.studies.examples.unitree_bridge --contract deploy.yaml --interface eth0

The contract is written by `glassgait export`; the C file beside it is compiled and loaded by
ctypes. The robot stands up by interpolation, then follows the controller at 50 Hz. The bridge damps
the joints and ends if the trunk leans by more than 60 degrees, no state arrives for 100 ms, a
reading or target is invalid, or at Ctrl-C. Messages are those of Unitree's SDK for Python
(github.com/unitreerobotics/unitree_sdk2_python). Needs `pip install cyclonedds`.
"""

import math
import tempfile
import time
import zlib
from collections.abc import Iterator
from functools import cache
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.idl import annotations, make_idl_struct, types
from cyclonedds.pub import DataWriter
from cyclonedds.qos import Policy, Qos
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic

from glassgait.models.control import Sensors
from glassgait.models.export import binding
from glassgait.models.export.contract import interface_of, read_contract
from glassgait.models.robots import kinematics
from glassgait.models.task.command import Command

LEAN = 60.0  # lean of the trunk beyond which joints are damped (degrees)
SILENCE = 0.1  # time without a state after which joints are damped (s)
DAMPING = 5.0  # damping of the joints after a fault (N·m·s/rad)

TOUCH, RELEASE = 60, 40
"""Counts of a foot sensor at which contact begins, and down to which it lasts; of one Go2."""

CONFIGURATION = """<CycloneDDS><Domain Id="any"><General><Interfaces>
<NetworkInterface name="{}"/></Interfaces></General></Domain></CycloneDDS>"""

BEGIN = "head:u1*2 level_flag:u1 frame_reserve:u1 sn:u4*2 version:u4*2 bandwidth:u2"
FIELDS = {
    "IMUState_": "quaternion:f4*4 gyroscope:f4*3 accelerometer:f4*3 rpy:f4*3 temperature:u1",
    "MotorState_": "mode:u1 q:f4 dq:f4 ddq:f4 tau_est:f4 q_raw:f4 dq_raw:f4 ddq_raw:f4 "
    "temperature:u1 lost:u4 reserve:u4*2",
    "BmsState_": "version_high:u1 version_low:u1 status:u1 soc:u1 current:i4 cycle:u2 bq_ntc:u1*2 "
    "mcu_ntc:u1*2 cell_vol:u2*15",
    "LowState_": f"{BEGIN} imu_state:IMUState_ motor_state:MotorState_*20 bms_state:BmsState_ "
    "foot_force:i2*4 foot_force_est:i2*4 tick:u4 wireless_remote:u1*40 bit_flag:u1 adc_reel:f4 "
    "temperature_ntc1:u1 temperature_ntc2:u1 power_v:f4 power_a:f4 fan_frequency:u2*4 reserve:u4 "
    "crc:u4",
    "MotorCmd_": "mode:u1 q:f4 dq:f4 tau:f4 kp:f4 kd:f4 reserve:u4*3",
    "BmsCmd_": "off:u1 reserve:u1*3",
    "LowCmd_": f"{BEGIN} motor_cmd:MotorCmd_*20 bms_cmd:BmsCmd_ wireless_remote:u1*40 led:u1*12 "
    "fan:u1*2 gpio:u1 reserve:u4 crc:u4",
}
"""The fields of the SDK's types in `unitree_go.msg.dds_`, in order: name, type and length."""


def fields_of(name: str) -> Iterator[tuple[str, str, int]]:
    """Yields name, type and array length of each field of an SDK type; length 0 is a scalar."""
    for field in FIELDS[name].split():
        key, _, kind = field.partition(":")
        kind, _, count = kind.partition("*")
        yield key, kind, int(count or 0)


@cache
def types_of(name: str) -> tuple[Any, np.dtype]:
    """Returns the DDS type of a message, and its memory layout in C."""
    fields, parts = {}, []
    for key, kind, count in fields_of(name):
        scalar = np.dtype(kind) if kind not in FIELDS else None
        element, part = types_of(kind) if scalar is None else (getattr(types, scalar.name), scalar)
        fields[key] = types.array[element, count] if count else element
        parts.append((key, part, (count,)) if count else (key, part))
    struct = make_idl_struct(name, f"unitree_go.msg.dds_.{name}", fields)
    return annotations.final(annotations.autoid("sequential")(struct)), np.dtype(parts, align=True)


def message(name: str, record: Any) -> Any:
    """Converts a record of the C layout to the DDS type."""
    values = {}
    for key, kind, count in fields_of(name):
        value = record[key]
        if kind in FIELDS:
            values[key] = [message(kind, x) for x in value] if count else message(kind, value)
        else:
            values[key] = value.tolist()
    return types_of(name)[0](**values)


def checksum(record: Any) -> int:
    """Returns the SDK's CRC of a record: polynomial 0x04C11DB7 over all its words but the last."""
    words = np.frombuffer(record.tobytes(), "<u4")[:-1].astype(">u4").tobytes()
    mirrored = words.translate(bytes(int(f"{byte:08b}"[::-1], 2) for byte in range(256)))
    return int(f"{zlib.crc32(mirrored) ^ 0xFFFFFFFF:032b}"[::-1], 2)


def low_cmd(motors: np.ndarray, q: np.ndarray, kp: Any, kd: Any) -> Any:
    """Returns the message that drives motors (12) to positions (12; rad)."""
    record = np.zeros((), types_of("LowCmd_")[1])
    record["head"], record["level_flag"] = (0xFE, 0xEF), 0xFF
    driven = record["motor_cmd"]
    driven["mode"][motors] = 1
    driven["q"][motors], driven["kp"][motors], driven["kd"][motors] = q, kp, kd
    record["crc"] = checksum(record)
    return message("LowCmd_", record)


class FaultError(Exception):
    """Raised when the joints must be damped."""


class Robot:
    """The DDS connection to the robot, with joints and feet in the order of the contract.

    Attributes:
        sensors: The latest readings, after the first `read` that returned True.
    """

    sensors: Sensors

    def __init__(self, contract: dict[str, Any], domain: int, interface: str) -> None:
        self._domain = Domain(domain, CONFIGURATION.format(interface))
        node, qos = DomainParticipant(domain), Qos(Policy.History.KeepLast(100))
        self._reader = DataReader(node, Topic(node, "rt/lowstate", types_of("LowState_")[0]), qos)
        self._writer = DataWriter(node, Topic(node, "rt/lowcmd", types_of("LowCmd_")[0]), qos)
        legs = contract["motor_order"]
        names = [f"{leg}_{part}" for leg in legs for part in ("hip", "thigh", "calf")]
        self._motors = np.array([names.index(joint) for joint in contract["joints"]])
        self._feet = [legs.index(foot) for foot in contract["feet"]]
        self._gains = contract["stiffness"], contract["damping"]
        self._period, self._heard = contract["control_period"], math.inf
        self._touching = np.zeros(4, dtype=bool)

    def read(self) -> bool:
        """Reads the states since the last call, and returns whether there were any.

        Raises a FaultError after a long silence, for a reading that is not finite, or if the trunk
        leans too far.
        """
        states = self._reader.take(N=100)
        if not states:
            if time.monotonic() - self._heard > SILENCE:
                raise FaultError("no state came for 100 ms")
            return False
        self._heard = time.monotonic()
        for state in states:
            counts = np.array(state.foot_force)[self._feet]
            self._touching = np.where(self._touching, counts > RELEASE, counts >= TOUCH)

        # The controller needs the accelerometer's integral over a control period.
        imu, motors = states[-1].imu_state, states[-1].motor_state
        change = self._period * np.mean([s.imu_state.accelerometer for s in states], axis=0)
        gravity = kinematics.gravity_direction(np.array(imu.quaternion))
        position = np.array([motors[i].q for i in self._motors])
        velocity = np.array([motors[i].dq for i in self._motors])
        reading = np.concatenate([imu.gyroscope, change, gravity])
        self.sensors = Sensors(position, velocity, self._touching, reading)
        if not np.isfinite([*position, *velocity, *reading]).all():
            raise FaultError("a reading is not finite")
        if gravity[2] > -math.cos(math.radians(LEAN)):
            raise FaultError(f"the trunk leans by more than {LEAN:g} degrees")
        return True

    def drive(self, targets: np.ndarray) -> None:
        """Drives the joints to targets (12; rad)."""
        self._writer.write(low_cmd(self._motors, targets, *self._gains))

    def damp(self) -> None:
        """Damps the joints, for half a second."""
        for _ in range(25):
            self._writer.write(low_cmd(self._motors, np.zeros(12), 0.0, DAMPING))
            time.sleep(0.02)


def stand_up(robot: Robot, stance: np.ndarray, seconds: float) -> Iterator[None]:
    """Moves the joints to the stance, at rest at both ends, one control step at a time."""
    begin, start, share = robot.sensors.joint_position, time.monotonic(), 0.0
    while share < 1.0:
        share = min((time.monotonic() - start) / seconds, 1.0)
        robot.drive(begin + (3.0 - 2.0 * share) * share**2 * (stance - begin))
        yield


def follow(robot: Robot, controller: binding.LoadedController, command: Command) -> Iterator[None]:
    """Drives the joints to the controller's targets, one control step at a time."""
    memory = controller.initial()
    while True:
        step = controller.step(memory, robot.sensors, command)
        if step.status & (binding.BAD_INPUT | binding.BAD_TARGET):
            raise FaultError("a reading or a target is bad")
        memory = step.memory
        robot.drive(step.targets)
        yield


def main(
    contract: Path,
    interface: str = "lo",
    domain: int = 1,
    speed: float = 0.0,
    yaw_rate: float = 0.0,
    rising: float = 3.0,
) -> None:
    """Stands the robot up, and lets it follow the controller until Ctrl-C or a fault.

    Args:
        contract: The deploy.yaml of `glassgait export`.
        interface: Network interface, such as eth0; by default the loopback.
        domain: DDS domain; a robot's is 0.
        speed: Commanded forward speed (m/s).
        yaw_rate: Commanded yaw rate, to the left (rad/s).
        rising: Time to stand up (s).
    """
    # Load the controller, and connect to the robot.
    terms = read_contract(contract)
    source, period = contract.parent / terms["file"], terms["control_period"]
    with tempfile.TemporaryDirectory() as folder:
        controller = binding.compiled_controller(source, interface_of(terms), Path(folder))
    command = Command(np.array([speed, yaw_rate]), np.array(terms["command_ranges"]["dwell"][0]))
    robot, stance = Robot(terms, domain, interface), np.array(terms["stance"])
    steps = chain(stand_up(robot, stance, rising), follow(robot, controller, command))

    # Take a step every 20 ms if a state has arrived.
    try:
        while True:
            if robot.read():
                next(steps)
            time.sleep(period - time.monotonic() % period)
    except (FaultError, KeyboardInterrupt) as reason:
        print(f"damped: {reason}" if str(reason) else "damped: Ctrl-C", flush=True)
    finally:
        robot.damp()


if __name__ == "__main__":
    tyro.cli(main)

"""Two processes over Unitree's messages, by DDS on this machine's loopback."""

import os
import re
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from glassgait.diagrams.scenario import Scenario
from glassgait.diagrams.unitree_robot_end import Drive, UnitreeRobotEnd
from glassgait.models.export.contract import CONTRACT
from glassgait.models.link.dds import COMMANDS, STATES, DdsEndpoint, DdsSettings, open_robots_end
from glassgait.models.link.motors import MotorCommand, pack_low_cmd
from glassgait.models.link.unitree_messages import LOW_CMD, LOW_STATE
from glassgait.models.robots.library import load_robot
from glassgait.studies.cli import main
from glassgait.studies.deployment.drive import look as looking
from glassgait.studies.deployment.drive.processes import RobotProcess
from glassgait.studies.deployment.export.files import has_compiler

pytest.importorskip("cyclonedds", reason="needs the extra unitree")

A1 = load_robot()

DOMAIN = 2 + os.getpid() % 200
"""Tests that run side by side have domains of their own; a robot's is 0."""

STEPS = 200

COMMAND = "from glassgait.studies.cli import main; main()"


@pytest.fixture(params=["python", "compiled"])
def controller(tmp_path, request):
    """A controller in a process of its own."""
    acts = "--gait trot --policy sparse_formula"
    if request.param == "compiled":
        if not has_compiler():
            pytest.skip("needs a C compiler, cc")
        main(f"export {acts} --n-steps 20 --output {tmp_path / 'exported'}".split())
        acts = f"--contract {tmp_path / 'exported' / CONTRACT}"
    with open(tmp_path / "log", "w+", encoding="utf-8") as log:  # noqa: PTH123
        arguments = (
            f"drive controller --wire unitree {acts} --command.speed "
            f"0.5 --supervision.rising 1 --supervision.silence 5 --domain {DOMAIN}"
        ).split()
        process = subprocess.Popen(
            [sys.executable, "-c", COMMAND, *arguments], stdout=log, stderr=log, cwd=tmp_path
        )
        process.log = (tmp_path / "log").read_text
        yield process
        process.kill()
        process.wait()


def counted(log, name):
    (value,) = re.findall(rf"{name}\s*│\s*([\d,.]+)", log)
    return float(value.replace(",", ""))


def test_two_processes_lose_nothing(controller):
    """States at 500 Hz for four seconds: each control step waits for its answer."""
    endpoint = open_robots_end(DdsSettings(domain=DOMAIN))
    robot = UnitreeRobotEnd(Scenario(), endpoint)
    wait_for_a_command(robot, endpoint)
    states = []

    def note():
        states.append(robot.output("state").copy())

    process = RobotProcess(robot, patience=1.0, pushed=note)
    record = process.run(STEPS, lambda: False)
    assert robot.phase is Drive.DRIVEN
    controller.send_signal(signal.SIGINT)
    controller.wait(20.0)
    log = controller.log()
    assert "the robot follows the controller" in log
    assert counted(log, "states heard") == 10 * STEPS
    # States that come together, on a machine that is busy, are answered by one.
    assert 0.5 * STEPS < counted(log, "answers sent") <= STEPS
    for name in ("lost", "with a wrong checksum", "that are useless", "of another publisher"):
        assert counted(log, f"states {name}") == 0.0
    assert record["commands with a wrong checksum"] == record["commands that are useless"] == 0
    assert record["commands heard"] >= STEPS
    walked = np.array(states)
    assert walked[-1, 4] > 0.25
    assert walked[-1, 6] > 0.2


def wait_for_a_command(robot, endpoint):
    """Lets the two find each other, and the robot's first state be answered."""
    end = time.monotonic() + 60.0
    robot.send()
    while not robot.answered and time.monotonic() < end:
        robot.listen(0.05)
        if not robot.answered:
            robot.send()
    assert robot.answered, "no controller answered within a minute"


@pytest.fixture
def pair():
    settings = DdsSettings(domain=DOMAIN)
    states, commands = (STATES, LOW_STATE), (COMMANDS, LOW_CMD)
    first = DdsEndpoint(settings, hears=states, sends=commands)
    return first, DdsEndpoint(settings, hears=commands, sends=states), settings


def test_messages_pass_between_two_ends_and_publishers_are_told_apart(pair):
    first, second, settings = pair
    third = DdsEndpoint(settings, hears=(STATES, LOW_STATE), sends=(COMMANDS, LOW_CMD))
    message = pack_low_cmd(A1, MotorCommand.to(A1.default_stance, (40.0, 1.0)))
    publishers = set()
    for sender in (first, third):
        (heard,) = sent_until_heard(sender, second, message)
        assert heard.message.tobytes() == message.tobytes()
        assert 0.0 <= heard.age < 10.0
        publishers.add(heard.publisher)
    assert len(publishers) == 2


def sent_until_heard(sender, hearer, message):
    end = time.monotonic() + 10.0
    while time.monotonic() < end:
        sender.send(message)
        if heard := hearer.take(0.2):
            return heard[:1]
    return []


def test_waits_no_longer_than_asked(pair):
    begun = time.monotonic()
    assert pair[0].take(0.05) == []
    assert 0.04 < time.monotonic() - begun < 5.0


def test_a_person_looks_at_what_the_robot_senses(pair, capsys, monkeypatch):
    monkeypatch.setattr(looking, "EVERY", 0.0)
    first, second, _ = pair
    robot = UnitreeRobotEnd(Scenario(sensor_noise=0.0), second)
    remaining = iter(range(40))

    def stopped():
        robot.send()
        robot.advance(0)
        return next(remaining, None) is None

    counts = looking.look(A1, first, stopped).counts
    assert counts.heard > 0
    assert counts.corrupt == 0
    printed = capsys.readouterr().out
    assert re.search(r"FR_hip\s*│\s*0\s*│\s*-0.3", printed)
    assert re.search(r"gravity [+-]0\.0\d [+-]0\.0\d -1\.00", printed)
    # It is sent nothing.
    assert robot.phase is Drive.LIMP

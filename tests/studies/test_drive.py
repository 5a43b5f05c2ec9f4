"""`glassgait drive`: what is refused, and the losses that are counted."""

import json
import shutil

import numpy as np
import pytest
import yaml

from glassgait.models.errors import InputError
from glassgait.models.export.contract import CONTRACT, Contract
from glassgait.models.policies.library import STUDENT_DIRECTORY, policy_path
from glassgait.studies.cli import main
from glassgait.studies.deployment.drive import command, packet_loss, processes
from glassgait.studies.deployment.drive.packet_loss import Loss
from glassgait.studies.deployment.export.files import has_compiler

REFUSED = {
    "controller --gait gallop": "gait 'gallop'",
    "controller --lcm-url nonsense": "lcm_url",
    "controller --lcm-url tcpq://localhost:65536": "lcm_url",
    "simulator --lcm-url udpm://239.255.76.67:0": "lcm_url",
    "simulator --scenario latency_20ms --channels T1_": "latency",
    "simulator --watchdog.hold 0": "hold",
    "controller --command.speed 0.5": "over LCM the robot's end sends the command",
    "controller --remote": "over LCM the robot's end sends the command",
    "controller --look": "add --wire unitree",
    "controller --wire unitree --remote --command.speed 0.5": "come from the remote",
    "controller --wire unitree --remote --request walk": "come from the remote",
    "controller --wire unitree --meshcat --command.speed 0.5": "commands come from Meshcat",
    "controller --wire unitree --command.speed 9": "speed is 9.0; give -1 to 1",
    "controller --wire unitree --command.dwell 99": "dwell is 99; give 6 to 11",
    "controller --wire unitree --remote --command.dwell 99": "dwell is 99; give 6 to 11",
    "simulator --meshcat --command.speed 0.5": "leave --meshcat or --command out",
    "controller --meshcat": "over LCM the robot's end sends the command",
    "controller --request walk": "over LCM the robot's end sends the command",
    "controller --day night": "unknown day 'night'",
    "controller --contract none/deploy.yaml": "none/deploy.yaml",
    "controller --contract deploy.yaml --policy gbm": "policy is the contract's",
    "controller --contract deploy.yaml --policy expert": "policy is the contract's",
    "controller --contract deploy.yaml --source runs": "source is the contract's",
    "simulator --day night --channels T2_": "unknown day 'night'",
    "simulator --request walk": "a request is of a day",
    "simulator --wire unitree --day day": "the controller's end has the command and the day",
    "controller --wire unitree --interface a;b": "interface",
    "controller --wire unitree --domain 233": "domain",
    "simulator --wire unitree --command.speed 0.5": "the controller's end has the command",
    "simulator --wire unitree --scenario latency_20ms": "latency",
    "packet-loss --n-robots 0": "n_robots",
    "dropout --robot .": "is a folder",
}


@pytest.mark.parametrize("arguments", REFUSED)
def test_bad_input_is_refused_in_one_sentence(arguments, refused, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert REFUSED[arguments] in refused(["drive", *arguments.split()])
    assert not list(tmp_path.iterdir())


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    """What `glassgait export` wrote of the trot's page."""
    if not has_compiler():
        pytest.skip("needs a C compiler, cc")
    folder = tmp_path_factory.mktemp("exported")
    main(
        f"export --gait trot --policy sparse_formula --n-steps 20 --output {folder / 'run'}".split()
    )
    return folder / "run"


def renamed(plain):
    first, second, *_ = plain["joints"]
    plain["joints"][:2] = second, first


MUTATIONS = {
    "'joints' is not that of the a1": renamed,
    "'stance' is not that of the a1": lambda plain: plain["stance"].reverse(),
    "'thigh_length' is not that of the a1": lambda plain: plain.update(thigh_length=0.213),
    "lacks the key 'effort'": lambda plain: plain.pop("effort"),
    "'digest' is not that of the others": lambda plain: plain.update(stiffness=60.0),
    "'file_digest' is not that": lambda plain: plain.update(file_digest="0" * 64),
    "'header_digest' is not that": lambda plain: plain.update(header_digest="0" * 64),
    "robot": lambda plain: plain.update(robot="b2"),
    "unknown key 'extra'": lambda plain: plain.update(extra=1),
}


@pytest.mark.parametrize("wire", ["lcm", "unitree"])
@pytest.mark.parametrize("message", MUTATIONS)
def test_a_contract_that_was_changed_is_refused_before_anything_is_sent(
    message, wire, exported, refused, tmp_path, monkeypatch
):
    for opened in ("open_lcm", "open_controllers_end"):
        monkeypatch.setattr(command, opened, lambda _: pytest.fail("it was opened"))
    folder = shutil.copytree(exported, tmp_path / "own")
    plain = yaml.safe_load((folder / CONTRACT).read_text())
    MUTATIONS[message](plain)
    if "digest" in plain and "'digest'" not in message:
        plain["digest"] = redigested(plain)
    (folder / CONTRACT).write_text(yaml.safe_dump(plain, sort_keys=False))
    given = ["drive", "controller", "--contract", str(folder / CONTRACT), "--wire", wire]
    assert message in refused(given)


def redigested(plain):
    """Returns the digest of what was changed, as one would write it who wants it to pass."""
    known = {key: value for key, value in plain.items() if key != "extra"}
    try:
        return Contract.from_plain(known, "own").own_digest()
    except InputError:
        return plain["digest"]


def test_the_robot_that_is_moved_must_be_the_contracts(exported, refused):
    given = ["drive", "controller", "--contract", str(exported / CONTRACT), "--robot", "go2"]
    assert "'robot' is 'a1', not 'go2'" in refused(given)


@pytest.fixture
def opened(monkeypatch):
    """Ends a command where it opens a wire, and says so."""

    def end(_):
        raise InputError("the wire is opened")

    for name in ("open_lcm", "open_controllers_end"):
        monkeypatch.setattr(command, name, end)


@pytest.mark.parametrize("wire", ["lcm", "unitree"])
def test_flags_that_contradict_the_contract_are_refused(
    wire, exported, refused, opened, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    given = ["drive", "controller", "--contract", str(exported / CONTRACT), "--wire", wire]
    for agreeing in ([], ["--gait", "trot"], ["--robot", "a1"]):
        assert "the wire is opened" in refused([*given, *agreeing])
    assert "gait 'walk' is not the contract's" in refused([*given, "--gait", "walk"])
    assert "'robot' is 'a1', not 'go2'" in refused([*given, "--robot", "go2"])
    others = policy_path(STUDENT_DIRECTORY / "go2" / "trot", "sparse_formula")
    assert "go2" in refused([*given, "--gait", str(others)])
    assert "day 'day' is not the contract's" in refused([*given, "--day", "day"])


def test_a_gait_that_is_named_as_by_default_is_not_taken_for_none(
    exported, refused, opened, tmp_path
):
    """The contract's trot is another one than that which ships."""
    folder = shutil.copytree(exported, tmp_path / "own")
    plain = yaml.safe_load((folder / CONTRACT).read_text())
    plain["gaits"]["trot"] = "0" * 16
    plain["digest"] = redigested(plain)
    (folder / CONTRACT).write_text(yaml.safe_dump(plain, sort_keys=False))
    given = ["drive", "controller", "--contract", str(folder / CONTRACT)]
    assert "the wire is opened" in refused(given)
    assert "gait 'trot' is not the contract's" in refused([*given, "--gait", "trot"])


@pytest.fixture(scope="module")
def several(tmp_path_factory):
    """What `glassgait export` wrote of two gaits, with a day."""
    if not has_compiler():
        pytest.skip("needs a C compiler, cc")
    folder = tmp_path_factory.mktemp("several") / "run"
    arguments = "export --gait walk trot --policy sparse_formula --day day --n-steps 20 --output"
    main([*arguments.split(), str(folder)])
    return folder


def test_of_several_gaits_one_is_named_or_the_operator_changes_them(several, refused, opened):
    given = ["drive", "controller", "--contract", str(several / CONTRACT)]
    for wire in ("lcm", "unitree"):
        assert "several gaits; name the one" in refused([*given, "--wire", wire])
        for gait in ("walk", "trot"):
            assert "is opened" in refused([*given, "--wire", wire, "--gait", gait, "--day", "day"])
        assert "is not the contract's" in refused([*given, "--wire", wire, "--gait", "pace"])
    for chosen in (["--remote"], ["--look"]):
        assert "the wire is opened" in refused([*given, "--wire", "unitree", *chosen])


def test_a_source_that_was_edited_is_not_compiled(exported, refused, tmp_path):
    folder = shutil.copytree(exported, tmp_path / "own")
    with (folder / "trot_sparse_formula.c").open("a") as file:
        file.write("\n/* a remark */\n")
    assert "file_digest" in refused(["drive", "controller", "--contract", str(folder / CONTRACT)])


def test_losses_are_counted_and_kept(tmp_path, monkeypatch):
    monkeypatch.setattr(packet_loss, "TRIALS", packet_loss.TRIALS[5:6])
    run = [
        "drive",
        "packet-loss",
        "--policy",
        "sparse_formula",
        "--n-robots",
        "1",
        "--n-steps",
        "60",
    ]
    main([*run, "--output", str(tmp_path / "run")])
    (row,) = json.loads((tmp_path / "run" / "metrics.json").read_text())
    assert row["control steps"] == 60
    assert row["lost either way"] > 0


def test_a_share_of_messages_is_lost_by_the_seed(generator):
    loss = Loss(share=0.2)
    lost = loss.draw(20_000, 2, generator)
    np.testing.assert_allclose(lost.mean(axis=0), 0.2, atol=0.02)
    # Each channel by itself.
    assert abs((lost[:, 0] & lost[:, 1]).mean() - 0.04) < 0.01
    again = [loss.draw(50, 2, np.random.default_rng(3)) for _ in range(2)]
    np.testing.assert_array_equal(*again)
    assert not Loss().draw(100, 2, generator).any()


def test_a_burst_takes_all_messages_of_its_time_once_an_interval(generator):
    lost = Loss(burst=0.5).draw(2000, 2, generator)
    np.testing.assert_array_equal(lost[:, 0], lost[:, 1])
    for interval in np.split(lost[:, 0], 4):
        (begin, end) = np.flatnonzero(np.diff(interval.astype(int)))
        assert end - begin == 25
        assert 124 <= begin <= 375


class Clock:
    """A clock whose time passes only by waiting, or by what holds a process up."""

    def __init__(self, monkeypatch):
        self.now = 100.0
        monkeypatch.setattr(processes.time, "monotonic", lambda: self.now)

    def wait(self, seconds):
        self.now += seconds

    def pace(self, slack):
        return processes.Pace(self.wait, slack=slack)

    def run(self, pace, n_parts, *, held_up=0.0):
        """Returns when each of the parts of two milliseconds begins."""
        begun = []
        for part in range(n_parts):
            if part == 5:
                self.now += held_up
            pace.wait_until(part // 10, part % 10 / 10)
            begun.append(self.now - 100.0)
        return np.array(begun)


@pytest.mark.parametrize("held_up", [0.0, 0.05, 0.09])
def test_a_process_that_was_held_up_catches_up_but_not_too_fast(held_up, monkeypatch):
    clock = Clock(monkeypatch)
    pace = clock.pace(slack=0.1)
    begun = clock.run(pace, 200, held_up=held_up)
    assert pace.slips == 0
    np.testing.assert_allclose(begun[-1], 199 * 0.002)
    assert np.diff(begun).min() > 0.002 / processes.FASTEST - 1e-9
    assert np.diff(begun).max() >= held_up - 1e-9


def test_the_clock_of_a_process_that_was_held_up_for_longer_is_put_back(monkeypatch):
    clock = Clock(monkeypatch)
    pace = clock.pace(slack=0.1)
    begun = clock.run(pace, 200, held_up=0.2)
    assert pace.slips == 1
    np.testing.assert_allclose(pace.slipped, 0.198)
    np.testing.assert_allclose(begun[-1], 199 * 0.002 + 0.198)

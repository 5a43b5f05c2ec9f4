"""`glassgait drive`: what is refused, and the losses that are counted."""

import json

import numpy as np
import pytest

from glassgait.studies.cli import main
from glassgait.studies.deployment.drive import packet_loss
from glassgait.studies.deployment.drive.packet_loss import Loss

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

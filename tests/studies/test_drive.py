"""`glassgait drive`: what is refused, and the losses that are counted."""

import json

import pytest

from glassgait.studies.cli import main
from glassgait.studies.deployment.drive import command

REFUSED = {
    "controller --gait gallop": "unknown gait 'gallop'",
    "controller --lcm-url nonsense": "lcm_url is 'nonsense'; write udpm://",
    "controller --lcm-url tcpq://localhost:65536": "whose port is 65536; give one from 1 to 65535",
    "simulator --lcm-url udpm://239.255.76.67:0": "whose port is 0; give one from 1",
    "simulator --scenario latency_20ms --channels T1_": "latency is not made for two processes",
    "simulator --watchdog.hold 0": "hold is 0.0",
    "packet-loss --n-robots 0": "n_robots is 0",
}


@pytest.mark.parametrize("arguments", REFUSED)
def test_bad_input_is_told_in_one_sentence(arguments, refused, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert REFUSED[arguments] in refused(["drive", *arguments.split()])
    assert not list(tmp_path.iterdir())


def test_losses_are_counted_and_kept(tmp_path, monkeypatch):
    monkeypatch.setattr(command, "TRIALS", command.TRIALS[5:6])
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

"""Runs that were killed resume exactly."""

import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

SEED = int(os.environ.get("KILL_SEED", "0")) or random.SystemRandom().randrange(1, 2**31)

SETTINGS = Path(__file__).parent / "settings"
LEARN = ["--updates", "6", "--n-robots", "8"]
COMMANDS = {
    "train": [
        *["--settings", str(SETTINGS / "train.yaml"), *LEARN],
        *["--checkpoint-updates", "2", "--friction-updates", "2"],
    ],
    "distill": [*["--settings", str(SETTINGS / "distill.yaml"), "--n-workers", "1"]],
    "refine": [
        *["--settings", str(SETTINGS / "refine.yaml"), *LEARN, "--policy", "formulas"],
        *["--candidate-updates", "2", "--candidate-steps", "20"],
    ],
}


def start(command, output, *more):
    """Starts a command in a process of its own."""
    program = "from glassgait.studies.cli import main; main()"
    arguments = [command, *COMMANDS[command], "--output", str(output), *more]
    return subprocess.Popen(
        [sys.executable, "-c", program, *arguments],
        stdout=subprocess.DEVNULL,
        env={**os.environ, "OMP_NUM_THREADS": "1"},
    )


def results(folder):
    """Returns every policy in a folder and its R² scores, which must be equal."""
    paths = [*folder.rglob("*.safetensors"), *folder.rglob("*.formulas"), *folder.rglob("*.json")]
    kept = {path.relative_to(folder): path.read_bytes() for path in paths}
    passing = ("checkpoint", "round", "record")
    return {path: data for path, data in kept.items() if not path.name.startswith(passing)}


@pytest.mark.slow
@pytest.mark.parametrize("command", COMMANDS)
def test_a_killed_run_resumes_to_the_same_end(command, tmp_path):
    print(f"KILL_SEED={SEED}")
    moments = random.Random(f"{SEED} {command}")
    whole, killed = tmp_path / "whole", tmp_path / "killed"
    began = time.monotonic()
    assert start(command, whole).wait(timeout=200) == 0
    seconds = time.monotonic() - began
    process = start(command, killed)
    time.sleep(moments.uniform(0.3, 1.0) * seconds)
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert start(command, killed, "--resume").wait(timeout=200) == 0
    assert results(killed) == results(whole) != {}

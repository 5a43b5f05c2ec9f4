"""Runs that were killed, and files that were damaged: they resume exactly, or are refused."""

import os
import random
import shutil
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from glassgait.models.errors import InputError
from glassgait.models.task.gait import load_gait
from glassgait.studies.common.run import CHECKPOINT_NAME
from glassgait.studies.distillation.study import distill
from glassgait.studies.training.run import TrainingRun

SEED = int(os.environ.get("KILL_SEED", "0")) or random.SystemRandom().randrange(1, 2**31)

LEARN = ["--updates", "6", "--n-robots", "8"]
COMMANDS = {
    "train": [
        *[*LEARN, "--n-groups", "2", "--fine-steps"],
        *["--checkpoint-updates", "2", "--friction-updates", "2"],
    ],
    "distill": [
        *["--episodes", "5", "--alone-rounds", "1", "--episode-steps", "60", "--n-workers", "1"],
        *["--students", "linear", "histogram_gbm", "--histogram-gbm.n-trees", "5"],
    ],
    "refine": [
        *[*LEARN, "--worlds.n-groups", "2", "--worlds.fine-steps", "--policy", "sparse_formula"],
        *["--candidate-updates", "2", "--candidate-steps", "20", "--ppo.critic-updates", "2"],
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


NONSENSE = (b"", b"null", b"[]", b"{}", b"{{{", b"\xff\xfe", b"[" * 100_000, b"9" * 5000)


def hurt(data, dice):
    """Returns the bytes flipped, cut short, doubled, mixed up or replaced."""
    where, length = dice.randrange(len(data)), dice.randrange(1, 64)
    match dice.randrange(5):
        case 0:
            return data[:where] + bytes([data[where] ^ 1 << dice.randrange(8)]) + data[where + 1 :]
        case 1:
            return data[:where]
        case 2:
            return data[:where] + data[where : where + length] * 2 + data[where + length :]
        case 3:
            return data[:where] + dice.randbytes(length) + data[where + length :]
        case _:
            return dice.choice(NONSENSE)


@pytest.fixture
def resumes(distilled, trained, tiny_distillation, tiny_training, expert, tmp_path):
    """Copies finished runs, and returns for each file whether its run still ends the same."""
    distillation = shutil.copytree(distilled, tmp_path / "distillation")
    training = shutil.copytree(trained, tmp_path / "training")
    gait = load_gait("trot")
    r2 = distill(tiny_distillation, gait, expert, distillation, resume=True)
    run = TrainingRun(tiny_training, gait, training, resume=True)
    weights, _ = run.learner.to_arrays()

    def distills():
        return distill(tiny_distillation, gait, expert, distillation, resume=True).equals(r2)

    def trains():
        run.restore()
        arrays, _ = run.learner.to_arrays()
        return all(np.array_equal(value, weights[name]) for name, value in arrays.items())

    return {
        distillation / "config.yaml": distills,
        distillation / "linear.safetensors": distills,
        training / CHECKPOINT_NAME: trains,
    }


@pytest.mark.parametrize("count", [30, pytest.param(500, marks=pytest.mark.slow)])
def test_damaged_files_are_refused_or_do_no_harm(count, resumes):
    dice, refused = random.Random(count), 0
    for case in range(count):
        path, resume = dice.choice(list(resumes.items()))
        whole = path.read_bytes()
        path.write_bytes(hurt(whole, dice))
        try:
            assert resume(), f"case {case}: {path.name} was accepted and changed the run"
        except InputError as error:
            refused += 1
            assert len(str(error)) < 700 and "\n" not in str(error), f"case {case}"
        path.write_bytes(whole)
    assert refused > count / 2

"""Killed at a random moment and resumed, every resumable command ends as if it had not been."""

import json
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from glassgait.models.policies.library import load_expert
from glassgait.models.task.gait import load_gait
from glassgait.studies.distillation.config import DistillationConfig
from glassgait.studies.distillation.study import distill

SEED = int(os.environ.get("KILL_SEED", "0")) or random.SystemRandom().randrange(1, 2**31)

# What takes minutes by its command is made small; all else is the command's own.
DRIVER = """
import sys
from glassgait.studies.cli import main

if sys.argv[1] == "importance":
    import glassgait.studies.importance.study
    glassgait.studies.importance.study.EPISODE_STEPS = 20
if sys.argv[1] == "demo":
    sys.path.insert(0, sys.argv.pop())
    import glassgait.studies.reproduction.demo.command, test_demo
    glassgait.studies.reproduction.demo.command.QUICK = test_demo.TINY
    glassgait.studies.reproduction.demo.command.REPLAY_SECONDS = 0.2
main(sys.argv[1:])
"""

LEARN = ["--updates", "6", "--checkpoint-updates", "2", "--friction-updates", "2"]
LEARN += ["--n-robots", "8", "--n-groups", "2", "--fine-steps"]
COLLECT = ["--episodes", "5", "--alone-rounds", "1", "--episode-steps", "60", "--n-jobs", "1"]
ROLL_OUT = ["--n-robots", "2", "--n-steps", "60"]
FEW = [f"--rollouts.{name.removeprefix('--')}" if "--" in name else name for name in ROLL_OUT]
LOOK = ["--n-samples", "20", "--repeats", "2", "--policy", "statewise_linear"]


@pytest.fixture(scope="module")
def distilled(tmp_path_factory):
    folder = tmp_path_factory.mktemp("distilled")
    students = ("statewise_linear", "statewise_symbolic")
    config = DistillationConfig(
        students=students, episodes=5, alone_rounds=0, episode_steps=60, n_jobs=1
    )
    distill(config, load_gait("trot"), load_expert("trot"), folder, lambda line: None)
    return folder


COMMANDS = {
    "train": LEARN,
    "distill": [*COLLECT, "--students", "linear", "histogram_gbm", "--histogram-gbm.n-trees", "5"],
    "evaluate worlds": [
        *ROLL_OUT,
        "--scenario",
        "training",
        "push_1.0",
        "--n-seeds",
        "3",
        "--source",
        "{distilled}",
    ],
    "distill --sweep terms": [
        *ROLL_OUT,
        "--terms",
        "24",
        "--samples",
        "{distilled}/statewise_symbolic",
    ],
    "reproduce curricula": [*COLLECT, "--students", "linear", *FEW, "--rollouts.n-seeds", "1"],
    "importance": [*ROLL_OUT, *LOOK, "--source", "{distilled}"],
    "demo": ["--n-robots", "2"],
}


def start(command, folder, distilled, *more):
    arguments = [text.format(distilled=distilled) for text in COMMANDS[command]]
    tail = [str(Path(__file__).parent)] if command == "demo" else []
    whole = [*command.split(), *arguments, "--output", str(folder), *more, *tail]
    # In a group of its own, so that a kill leaves no process behind.
    return subprocess.Popen(
        [sys.executable, "-c", DRIVER, *whole],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        start_new_session=True,
    )


def finish(process):
    _, message = process.communicate(timeout=300)
    assert process.returncode == 0, message.decode()


def results(folder):
    """Returns what must be equal: every number and every policy, but no times."""
    policies = {
        str(path.relative_to(folder)): path.read_bytes()
        for path in folder.rglob("*")
        if path.suffix in (".safetensors", ".formulas")
        and path.name != "checkpoint.safetensors"
        and not path.name.startswith("round_")
    }
    metrics = {
        str(path.relative_to(folder)): json.loads(path.read_text())
        for path in folder.rglob("metrics.json")
    }
    assert policies or metrics
    return policies, json.dumps(metrics, sort_keys=True)


@pytest.mark.slow
@pytest.mark.parametrize("command", COMMANDS)
def test_a_killed_run_resumes_to_the_same_end(command, distilled, tmp_path):
    print(f"KILL_SEED={SEED}")
    moments = random.Random(f"{SEED} {command}")
    whole, killed = tmp_path / "whole", tmp_path / "killed"
    began = time.monotonic()
    finish(start(command, whole, distilled))
    seconds = time.monotonic() - began
    process = start(command, killed, distilled)
    time.sleep(moments.uniform(0.3, 1.0) * seconds)
    os.kill(process.pid, signal.SIGKILL)
    process.communicate()
    finish(start(command, killed, distilled, "--resume"))
    assert results(killed) == results(whole)
    assert not list(killed.rglob(".*.partial"))

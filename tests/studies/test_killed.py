"""Killed at a random moment and resumed, every resumable command ends as if it had not been."""

import json
import multiprocessing
import os
import random
import runpy
import time

import pytest

from glassgait.models.policies.library import load_expert
from glassgait.models.task.gait import load_gait
from glassgait.studies.distillation.config import DistillationConfig
from glassgait.studies.distillation.study import distill

SEED = int(os.environ.get("KILL_SEED", "0")) or random.SystemRandom().randrange(1, 2**31)

# What takes minutes by its command is made small; all else is the command's own. Everything is
# imported once, in the process that every run is a fork of.
DRIVER = """
import os
import sys

os.environ["OMP_WAIT_POLICY"] = "PASSIVE"
os.environ["OMP_NUM_THREADS"] = "1"

from glassgait.studies import cli
from glassgait.studies.distillation.config import DistillationConfig
from glassgait.studies.distillation.students.settings import StudentsSettings
from glassgait.studies.distillation.students.symbolic_regression import StatewiseSymbolicSettings
from glassgait.studies.importance import study
from glassgait.studies.reproduction import demo

for name in cli.COMMANDS:
    cli.command_class(name)
study.EPISODE_STEPS = 20
demo.REPLAY_STEPS = 10
demo.QUICK = DistillationConfig(
    students=("linear", "statewise_symbolic"),
    episodes=5,
    alone_rounds=0,
    episode_steps=60,
    settings=StudentsSettings(
        statewise_symbolic=StatewiseSymbolicSettings(shapes=((20, 20),), start_weights=(1,))
    ),
    n_workers=1,
)

if __name__ == "run":
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    # Cases run here: workers would import everything anew.
    os.cpu_count = lambda: 1
    cli.main(ARGUMENTS)
"""

LEARN = ["--updates", "6", "--checkpoint-updates", "2", "--friction-updates", "2"]
LEARN += ["--n-robots", "8", "--n-groups", "2", "--fine-steps"]
COLLECT = ["--episodes", "5", "--alone-rounds", "1", "--episode-steps", "60", "--n-workers", "1"]
ROLL_OUT = ["--n-robots", "2", "--n-steps", "60"]
LOOK = ["--n-samples", "20", "--repeats", "2", "--policy", "statewise_linear"]


@pytest.fixture(scope="module")
def distilled(tmp_path_factory):
    folder = tmp_path_factory.mktemp("distilled")
    students = ("statewise_linear", "statewise_symbolic")
    config = DistillationConfig(
        students=students, episodes=5, alone_rounds=0, episode_steps=60, n_workers=1
    )
    distill(config, load_gait("trot"), load_expert("trot"), folder, lambda line: None)
    return folder


COMMANDS = {
    "train": LEARN,
    "distill": [*COLLECT, "--students", "linear", "histogram_gbm", "--histogram-gbm.n-trees", "5"],
    "evaluate scenarios": [
        *ROLL_OUT,
        "--scenario",
        "training",
        "push_1.0",
        "--n-seeds",
        "3",
        "--source",
        "{distilled}",
    ],
    "importance": [*LOOK, "--source", "{distilled}"],
    "demo": ["--n-robots", "2"],
}


@pytest.fixture(scope="module")
def start(distilled, tmp_path_factory):
    """Starts a command, and returns its process."""
    driver = tmp_path_factory.mktemp("driver") / "killed_driver.py"
    driver.write_text(DRIVER)
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload([driver.stem])

    def fork(arguments):
        process = context.Process(
            target=runpy.run_path, args=(str(driver), {"ARGUMENTS": arguments}, "run")
        )
        process.start()
        return process

    def run(command, output, *more):
        settings = [text.format(distilled=distilled) for text in COMMANDS[command]]
        return fork([*command.split(), *settings, "--output", str(output), *more])

    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", str(driver.parent))
        # Its time is that of all imports.
        finish(fork(["--version"]))
        yield run


def finish(process):
    process.join(timeout=100)
    assert process.exitcode == 0


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
def test_a_killed_run_resumes_to_the_same_end(command, start, tmp_path):
    print(f"KILL_SEED={SEED}")
    moments = random.Random(f"{SEED} {command}")
    whole, killed = tmp_path / "whole", tmp_path / "killed"
    began = time.monotonic()
    finish(start(command, whole))
    seconds = time.monotonic() - began
    process = start(command, killed)
    time.sleep(moments.uniform(0.1, 1.0) * seconds)
    process.kill()
    process.join()
    finish(start(command, killed, "--resume"))
    assert results(killed) == results(whole)
    assert not list(killed.rglob(".*.partial"))

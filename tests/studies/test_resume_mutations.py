"""Files that a run resumes from, hurt in every way: it is reported, or it does no harm."""

import random
import shutil

import numpy as np
import pytest

from glassgait.diagrams.domain_randomization import DomainRandomization
from glassgait.diagrams.scenario import Scenario
from glassgait.models.errors import InputError
from glassgait.models.policies.controller import alone
from glassgait.models.policies.library import load_expert
from glassgait.models.task.gait import load_gait
from glassgait.studies.common.cases import cases_in_worlds, run_rollouts
from glassgait.studies.common.rollouts import RolloutConfig
from glassgait.studies.common.run_folder import CHECKPOINT_NAME
from glassgait.studies.distillation.config import DistillationConfig
from glassgait.studies.distillation.study import distill
from glassgait.studies.training.config import PpoConfig, TrainingConfig
from glassgait.studies.training.run import TrainingRun

GAIT = load_gait("trot")
EXPERT = load_expert("trot")
DISTILLATION = DistillationConfig(
    students=("linear",), episodes=5, alone_rounds=0, episode_steps=20, n_workers=1
)
TRAINING = TrainingConfig(
    updates=1,
    n_robots=4,
    worlds=DomainRandomization(n_groups=1, fine_steps=()),
    ppo=PpoConfig(steps_per_update=4, actor_layers=(4,), critic_layers=(4,), epochs=1),
)
JOBS = cases_in_worlds(
    GAIT,
    {"expert": alone(EXPERT)},
    {"training": Scenario()},
    RolloutConfig(n_robots=2, n_steps=5, n_seeds=1),
)

NONSENSE = (
    b"",
    b"null",
    b"[]",
    b"{}",
    b"{{{",
    b"\xff\xfe",
    b"[" * 100_000,
    b"9" * 5000,
    b"a: &a [*a]",
)


def hurt(data: bytes, dice: random.Random) -> bytes:
    """Returns the bytes flipped, cut short, doubled, mixed up or replaced."""
    where, length = dice.randrange(len(data)), dice.randrange(1, 64)
    match dice.randrange(6):
        case 0:
            return data[:where] + bytes([data[where] ^ 1 << dice.randrange(8)]) + data[where + 1 :]
        case 1:
            return data[:where]
        case 2:
            return data[:where] + data[where : where + length] * 2 + data[where + length :]
        case 3:
            return data[:where] + data[where + length :]
        case 4:
            return data[:where] + dice.randbytes(length) + data[where + length :]
        case _:
            return dice.choice(NONSENSE)


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """Makes a distillation, rollouts and a training run, and what they resume to."""
    folder = tmp_path_factory.mktemp("finished")
    r2 = distill(DISTILLATION, GAIT, EXPERT, folder / "distillation", lambda line: None)
    scores = run_rollouts(JOBS, folder / "rollouts", processes=1)
    run = TrainingRun(TRAINING, GAIT, folder / "training")
    run.update()
    run.save()
    arrays, _ = run.learner.to_arrays()
    return folder, r2, scores, run, {name: value.copy() for name, value in arrays.items()}


@pytest.fixture
def resumes(finished, tmp_path):
    """Copies the runs, and reports for each file that is resumed from whether it ends the same."""
    folder, r2, scores, run, weights = finished
    shutil.copytree(folder, tmp_path, dirs_exist_ok=True)
    run.folder = tmp_path / "training"

    def distills():
        again = distill(
            DISTILLATION, GAIT, EXPERT, tmp_path / "distillation", lambda line: None, resume=True
        )
        return again.equals(r2)

    def trains():
        run.restore()
        arrays, _ = run.learner.to_arrays()
        return all(np.array_equal(value, weights[name]) for name, value in arrays.items())

    def evaluates():
        return run_rollouts(JOBS, tmp_path / "rollouts", processes=1).equals(scores)

    (rollouts,) = (tmp_path / "rollouts").glob("*.json")
    distillation = tmp_path / "distillation"
    return {
        distillation / "config.yaml": distills,
        distillation / "linear" / "record.json": distills,
        distillation / "linear.safetensors": distills,
        rollouts: evaluates,
        tmp_path / "training" / CHECKPOINT_NAME: trains,
    }


def check(resumes, seed, count):
    dice = random.Random(seed)
    refused = 0
    for case in range(count):
        path, resume = dice.choice(list(resumes.items()))
        whole = path.read_bytes()
        path.write_bytes(hurt(whole, dice))
        try:
            assert resume(), f"seed {seed}, case {case}: {path.name} was accepted and changed it"
        except InputError as error:
            refused += 1
            assert len(str(error)) < 700 and "\n" not in str(error), f"seed {seed}, case {case}"
        path.write_bytes(whole)
    assert refused > count / 2


def test_damaged_files_are_refused_or_do_no_harm(resumes):
    check(resumes, seed=1, count=50)


@pytest.mark.slow
def test_a_thousand_damaged_files_are_refused_or_do_no_harm(resumes):
    check(resumes, seed=2, count=1000)

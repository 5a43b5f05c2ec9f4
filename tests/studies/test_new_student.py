"""A student with a policy class of its own: one file and one entry are enough for every study."""

import subprocess
import sys

import pandas as pd
import pytest

pytestmark = pytest.mark.slow

PROGRAM = """
import sys
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from sklearn.linear_model import Ridge

from glassgait.models.export.c_policies import Code, policy_code
from glassgait.models.formulas.expression import variable
from glassgait.models.policies.arrays import Reals
from glassgait.models.policies.policy import (
    INTERCEPT,
    FactoredTerm,
    Policy,
    contributions_of_action,
)
from glassgait.models.settings import Positive
from glassgait.studies.distillation.students.registry import STUDENTS
from glassgait.studies.distillation.students.student import Student, StudentSettings


@dataclass(frozen=True)
class StiffSettings(StudentSettings):
    '''Settings of the stiff student.

    Attributes:
        ridge: Weight of the penalty.
    '''

    title: ClassVar[str] = "distillation: stiff"
    ridge: Positive = 3.0


def fit(samples, settings, *, seed, n_jobs):
    model = Ridge(settings.ridge).fit(samples.observations, samples.actions)
    return StiffPolicy(
        samples.gait, samples.observation_names, weights=model.coef_, intercepts=model.intercept_
    )


class StiffPolicy(Policy):
    kind = "stiff_policy"
    array_specs: ClassVar = {"weights": Reals("joints observations"), "intercepts": Reals("joints")}

    def factored_terms(self, joint):
        weights = enumerate(self.weights[joint].tolist())
        terms = (FactoredTerm((weight,), (variable(index),)) for index, weight in weights)
        return (FactoredTerm((0.0,), ()), *terms)

    def importance(self, observations):
        return "derivatives", np.abs(self.weights)

    def __call__(self, observation):
        return observation @ self.weights.T + self.intercepts

    def _explain(self, observation, joint):
        parts = self.weights[joint] * observation
        intercepts = np.full((*observation.shape[:-1], 1), self.intercepts[joint])
        values = np.concatenate([intercepts, parts], axis=-1)
        terms = (INTERCEPT, *self.observation_names)
        return contributions_of_action(self.robot, terms, values, joint)


@policy_code.register
def code(policy: StiffPolicy, style) -> Code:
    lines = [
        f"    action[{joint}] = {intercept!r}"
        + "".join(f" + {w!r} * observation[{i}]" for i, w in enumerate(weights))
        + ";"
        for joint, (weights, intercept) in enumerate(
            zip(policy.weights.tolist(), policy.intercepts.tolist())
        )
    ]
    signature = style.signature(takes_state=False)
    return Code("Stiff sums.", signature + "\\n{\\n" + "\\n".join(lines) + "\\n}\\n")


STUDENTS["stiff"] = Student(
    "stiff", "Stiff", fit, color="#E69F00", marker="*", settings=StiffSettings(),
    policy=StiffPolicy, brevity=9,
)

from glassgait.studies.cli import main

main(sys.argv[1:])
"""

SMALL = """
study: report
distillation:
  students: [gbm, ebm, symbolic]
  episodes: 5
  alone_rounds: 0
  episode_steps: 60
  n_workers: 1
  settings:
    gbm: {n_trees: 5, depth: 2}
    histogram_gbm: {n_trees: 5}
    ebm: {outer_bags: 2, interactions: 2, round_interactions: 1, max_rounds: 20}
    symbolic: {shapes: [[20, 20]], start_weights: [1]}
rollouts: {n_robots: 2, n_steps: 20, n_seeds: 1}
n_samples: 30
repeats: 2
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("stiff")


@pytest.fixture(scope="module")
def run(folder):
    """Runs a command in a process whose registry holds one student more."""

    def start(*arguments):
        done = subprocess.run(
            [sys.executable, "-c", PROGRAM, *arguments],
            cwd=folder,
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    return start


@pytest.fixture(scope="module")
def distilled(run, folder):
    short = ["--episodes", "5", "--alone-rounds", "0", "--episode-steps", "60", "--n-workers", "2"]
    run("distill", "--students", "stiff", "linear", "--stiff.ridge", "2.0", *short)
    return folder / "runs" / "distill" / "trot"


def test_it_is_distilled_with_settings_of_its_own(distilled):
    assert (distilled / "stiff.safetensors").exists()
    assert "ridge: 2.0" in (distilled / "config.yaml").read_text()
    assert pd.read_csv(distilled / "r2.csv")["student"].tolist() == ["Stiff", "Linear"]


def test_it_is_evaluated_at_every_ratio(run, distilled, folder):
    source = ["--source", "runs/distill/trot"]
    run("evaluate", "alternation", *source, "--n-robots", "2", "--n-steps", "20")
    table = pd.read_csv(folder / "runs" / "evaluate" / "alternation" / "trot" / "standalone.csv")
    assert "Stiff" in table["policy"].tolist()


def test_its_importances_are_measured(run, distilled, folder):
    short = ["--n-robots", "2", "--n-steps", "20", "--n-samples", "30", "--repeats", "2"]
    run("importance", "--source", "runs/distill/trot", "--policy", "stiff", *short)
    found = folder / "runs" / "importance" / "trot_stiff"
    assert (found / "stiff_permutation.png").exists()
    assert (found / "stiff_derivatives.png").exists()


def test_it_stands_in_the_report_beside_the_papers(run, folder):
    (folder / "small.yaml").write_text(SMALL)
    run("reproduce", "small.yaml", "--gait", "trot", "--policy", "stiff", "--output", "report")
    page = (folder / "report" / "report.html").read_text()
    assert "Gait sequences, Stiff" in page
    assert "Stiff" in (folder / "report" / "report.html").read_text()


RUN = ("--source", "runs/distill/trot")


def test_it_is_explained_by_the_file_alone(run, distilled, folder):
    run("explain", "page", *RUN, "--policy", "stiff", "--n-steps", "20", "--output", "explained")
    assert '"q.FL_hip"' in (folder / "explained" / "index.html").read_text()


def test_it_is_exported(run, distilled, folder):
    short = ["--n-robots", "1", "--n-steps", "20", "--output", "c"]
    run("export", *RUN, "--policy", "stiff", *short)
    assert (folder / "c" / "trot_stiff.c").exists()

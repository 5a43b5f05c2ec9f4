"""The shipped experts: their records, their symmetry, and that they walk."""

import numpy as np
import pandas as pd
import pytest

from glassgait.diagrams.scenario import load_scenario
from glassgait.models.files import read_yaml
from glassgait.models.policies.controller import alone
from glassgait.models.policies.library import (
    EXPERT_DIRECTORY,
    STUDENT_DIRECTORY,
    load_expert,
    load_policy,
    shipped_experts,
)
from glassgait.models.robots import quadruped
from glassgait.models.task.gait import load_gait
from glassgait.models.task.observation import REFLECT_JOINTS, reflect_observation
from glassgait.models.task.symmetry import mirrored_states
from glassgait.studies.common.rollouts import RolloutConfig, roll_out
from glassgait.studies.common.scores import score_rollouts
from glassgait.studies.common.settings_file import read_settings
from glassgait.studies.training.config import TrainingConfig
from glassgait.studies.training.record import trainings

SHORT = STUDENT_DIRECTORY / "short"
LOCAL = sorted([*(EXPERT_DIRECTORY / "local").glob("*.safetensors"), *SHORT.glob("*.formulas")])

BUDGET = 12e6
"""Control steps that no gait's training may exceed, with those of what it began as."""


@pytest.mark.parametrize("gait", shipped_experts())
def test_records_hold_how_the_expert_was_made(gait):
    record = read_yaml(EXPERT_DIRECTORY / f"{gait}.yaml")
    config = read_settings(TrainingConfig(), EXPERT_DIRECTORY / f"{gait}.yaml")
    curve = pd.read_csv(EXPERT_DIRECTORY / f"{gait}.csv")
    assert config.gait == gait
    assert config.mirrored
    assert config.updates == record["updates"] == len(curve)
    assert record["control_steps"] == curve["control_steps"].iloc[-1]
    runs = trainings(EXPERT_DIRECTORY / f"{gait}.yaml")
    assert sum(read_yaml(run)["control_steps"] for run in runs) <= BUDGET


@pytest.mark.parametrize("gait", shipped_experts())
def test_experts_treat_left_and_right_alike(gait, generator):
    expert = load_expert(gait)
    reflect = reflect_observation(expert.observation_names, mirrored_states(load_gait(gait)))
    observations = generator.normal(size=(50, len(expert.observation_names)))
    image = REFLECT_JOINTS(expert(reflect(observations)))
    np.testing.assert_allclose(image, expert(observations), atol=1e-9)


@pytest.mark.parametrize("path", LOCAL, ids=lambda path: path.name)
def test_legs_of_local_policies_ignore_other_legs(path, generator):
    policy, record = load_policy(path), path.with_suffix(".yaml")
    assert policy.gait == path.stem
    if policy.kind == "neural":
        assert read_yaml(record)["config"]["actor"] == "local"
        assert read_yaml(record)["control_steps"] <= BUDGET
    legs = [entry.leg for entry in policy.layout.entries]
    seen, others = generator.normal(size=(2, len(legs)))
    for joint, name in enumerate(quadruped.JOINTS):
        ignored = [leg not in (None, name[:2]) for leg in legs]
        assert policy(np.where(ignored, others, seen))[joint] == policy(seen)[joint]


@pytest.mark.parametrize(
    "scenario", ["nominal", pytest.param("latency_20ms", marks=pytest.mark.slow)]
)
@pytest.mark.parametrize(
    "gait",
    [
        pytest.param(gait, marks=() if gait in ("trot", "bound") else pytest.mark.slow)
        for gait in shipped_experts()
    ],
)
def test_experts_stay_up_and_keep_their_gait(gait, scenario):
    config = RolloutConfig(n_robots=6, n_steps=250, seed=7)
    policy = alone(load_expert(gait))
    log = roll_out(load_gait(gait), policy, load_scenario(scenario), config)
    scores = score_rollouts(log)
    assert not scores["fell"].any()
    # Over five seeds the half-bound keeps 0.90 of its rhythm, every other gait more than 0.95; of
    # six robots and five seconds, the start included, it keeps 0.84.
    assert scores["rhythm"].mean() > (0.8 if gait == "half_bound" else 0.85)

"""The shipped experts: their records, their page, and that they walk."""

import pandas as pd
import pytest

from glassgait.diagrams.scenario import Scenario
from glassgait.models.files import read_yaml
from glassgait.models.policies.alternating import AlternatingPolicy
from glassgait.models.policies.library import EXPERT_DIRECTORY, load_expert, shipped_experts
from glassgait.models.task.gait import load_gait
from glassgait.studies.rollouts.config import RolloutConfig
from glassgait.studies.rollouts.roll_out import roll_out
from glassgait.studies.rollouts.scores import score_rollouts
from glassgait.studies.tables import to_markdown
from glassgait.studies.training.record import read_config
from glassgait.studies.training.tables import training_table

BUDGET = 10e6
"""Control steps that no gait's training may exceed."""


@pytest.mark.parametrize("gait", shipped_experts())
def test_records_tell_how_the_expert_was_made(gait):
    record = read_yaml(EXPERT_DIRECTORY / f"{gait}.yaml")
    if "worlds" not in record["config"]:
        pytest.skip("trained by an earlier version, whose settings are no longer there")
    config = read_config(EXPERT_DIRECTORY / f"{gait}.yaml")
    curve = pd.read_csv(EXPERT_DIRECTORY / f"{gait}.csv")
    assert config.gait == gait
    assert config.updates == record["updates"] == len(curve)
    assert record["control_steps"] == curve["control_steps"].iloc[-1] <= BUDGET


def test_page_shows_the_records():
    records = [EXPERT_DIRECTORY / f"{gait}.yaml" for gait in shipped_experts()]
    table = to_markdown(training_table(records))
    assert table in (EXPERT_DIRECTORY / "README.md").read_text()


@pytest.mark.parametrize("gait", shipped_experts())
def test_experts_stay_up_and_keep_their_gait(gait):
    config = RolloutConfig(n_robots=6, n_steps=250, seed=7)
    policy = AlternatingPolicy(load_expert(gait))
    scores = score_rollouts(roll_out(load_gait(gait), policy, Scenario(), config))
    assert not scores["fell"].any()
    # The half-bound keeps 0.86 of its rhythm over five seeds, every other gait more than 0.95.
    assert scores["rhythm"].mean() > (0.7 if gait == "half_bound" else 0.85)

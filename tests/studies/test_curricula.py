"""The comparison of curricula: equal budgets, one table, one figure."""

import pandas as pd
import pytest

from glassgait.studies.cli import main
from glassgait.studies.distillation.config import DistillationConfig, rounds
from glassgait.studies.reproduction.curricula import (
    CURRICULA,
    TICKS,
    curricula_table,
    equal_budgets,
)

SMALL = ["--episodes", "5", "--alone-rounds", "1", "--episode-steps", "40", "--n-workers", "1"]
ROLLOUTS = ["--rollouts.n-robots", "2", "--rollouts.n-steps", "20", "--rollouts.n-seeds", "1"]


def test_every_curriculum_has_as_many_episodes():
    budgets = equal_budgets(DistillationConfig())
    last = {
        rounds(config, kind)[-1].episodes[-1]
        for config in budgets.values()
        for kind in ("linear", "symbolic")
    }
    assert list(budgets) == list(CURRICULA)
    assert len(TICKS) == len(CURRICULA)
    assert last == {62}
    for config in budgets.values():
        assert {own.steps for own in rounds(config, "linear")} == {config.episode_steps}


def test_every_curriculum_begins_with_the_expert_and_goes_its_own_way():
    periods = {
        name: [own.period for own in rounds(config, "linear")]
        for name, config in equal_budgets(DistillationConfig()).items()
    }
    assert periods["expert_only"] == [1] * 16
    assert periods["half"] == [1] + [2] * 15
    assert periods["student_only"] == [1] + [0] * 15
    assert periods["alternation"] == list(range(1, 17))
    assert periods["alternation_then_alone"] == [*range(1, 9), *[0] * 8]


def test_shares_are_of_the_expert_alone():
    fits = pd.DataFrame({"curriculum": ["half"], "student": ["linear"], "r2": [0.9]})
    scores = pd.DataFrame(
        {
            "curriculum": ["expert", "expert", "half", "half"],
            "student": ["expert", "expert", "linear", "linear"],
            "return": [10.0, 10.0, 9.0, 7.0],
            "fell": [False, False, False, True],
        }
    )
    for name in (
        "plain_return",
        "rhythm",
        "going_speed_error",
        "yaw_rate_error",
        "way",
        "cost_of_transport",
    ):
        scores[name] = 1.0
    row = curricula_table(fits, scores).iloc[0]
    assert row["share"] == pytest.approx(0.8)
    assert (row["falls"], row["robots"]) == (1, 2)


@pytest.mark.slow
def test_command_writes_a_row_a_curriculum_and_resumes_to_the_same(tmp_path, capsys, refused):
    output = tmp_path / "curricula"
    command = [
        "reproduce",
        "curricula",
        "--students",
        "linear",
        *SMALL,
        *ROLLOUTS,
        "--output",
        str(output),
    ]
    main(command)
    first = (output / "curricula.csv").read_text()
    assert pd.read_csv(output / "curricula.csv")["curriculum"].tolist() == list(CURRICULA)
    assert {path.suffix for path in output.glob("curricula.*")} == {".csv", ".md", ".png", ".pdf"}
    main([*command, "--resume"])
    assert (output / "curricula.csv").read_text() == first
    assert "--resume" in refused(command)

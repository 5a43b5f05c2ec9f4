"""The choice among a student's candidates: its seeds, and falls, simplicity and return."""

import pandas as pd
import pytest

from glassgait.studies.common.experiment import REPORTED_SEEDS, SELECTION_SEEDS
from glassgait.studies.common.rollouts import RolloutConfig
from glassgait.studies.distillation import selection
from glassgait.studies.distillation.selection import simplest_of_the_best


def test_no_reported_seed_selects():
    assert not {*REPORTED_SEEDS} & {*SELECTION_SEEDS}
    assert {seed for seed, _ in selection.SELECTION} <= {*SELECTION_SEEDS}
    assert RolloutConfig().seeds == REPORTED_SEEDS


@pytest.mark.parametrize(
    ("small", "large", "chosen"),
    [
        ((995.0, 0), (1000.0, 0), "small"),
        ((985.0, 0), (1000.0, 0), "large"),
        ((999.0, 1), (1000.0, 0), "large"),
        ((1001.0, 0), (1000.0, 0), "small"),
        # Falls count before reward, unless a student falls less because it hardly walks.
        ((1000.0, 2), (975.0, 0), "large"),
        ((1000.0, 2), (100.0, 0), "small"),
        ((-1000.0, 2), (-1001.0, 3), "small"),
    ],
)
def test_falls_count_before_simplicity_and_reward(small, large, chosen):
    rows = [("small", *small), ("large", *large)]
    ranked = pd.DataFrame(rows, columns=["candidate", "return", "falls"])
    ranked = ranked.sort_values("return", ascending=False)
    assert simplest_of_the_best(ranked, {"small": 1, "large": 2}) == chosen


def test_of_equally_simple_students_the_one_that_earns_most_is_taken():
    rows = [("first", 1000.0, 0), ("second", 999.0, 0)]
    ranked = pd.DataFrame(rows, columns=["candidate", "return", "falls"])
    assert simplest_of_the_best(ranked, {"first": 1, "second": 1}) == "first"

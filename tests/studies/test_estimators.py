"""The comparison of estimators."""

import numpy as np
import pandas as pd
import pytest

from glassgait.diagrams.scenario import Scenario
from glassgait.models.errors import InputError
from glassgait.models.policies.controller import alone
from glassgait.studies.common.cases import Case
from glassgait.studies.evaluation.estimators import (
    ERRORS,
    LEARNED,
    ODOMETRY,
    Estimators,
    errors_table,
)


def test_odometry_watches_and_changes_nothing(tmp_path):
    for gain in (0.15, 0.9):
        Estimators(
            scenario=("slope_10deg",),
            n_robots=2,
            n_steps=60,
            gain=gain,
            output=tmp_path / str(gain),
        ).run()
    table, other = (pd.read_csv(tmp_path / str(gain) / "errors.csv") for gain in (0.15, 0.9))
    assert table["estimator"].tolist() == [LEARNED, ODOMETRY]
    learned = table["estimator"] == LEARNED
    pd.testing.assert_frame_equal(table[learned], other[learned])
    assert np.all(table.loc[~learned, ERRORS] != other.loc[~learned, ERRORS])
    # On a slope the network guesses.
    slope = table[ERRORS].to_numpy()
    assert np.all(slope[1, :2] < slope[0, :2]) and slope[1, 3] < slope[0, 3]


def test_odometry_that_is_in_the_loop_is_what_the_policy_observed(trot, odometry_expert):
    case = Case({"policy": "expert"}, trot, alone(odometry_expert), Scenario(), seed=1)
    rows = Estimators(n_robots=2, n_steps=50).measure(case)
    assert rows["estimator"].tolist() == [ODOMETRY] and rows["steps"].tolist() == [100]
    assert np.all(np.sqrt(rows[ERRORS]) < [0.2, 0.2, 0.2, 1.5])


def test_mean_squares_are_weighted_by_steps_and_rooted():
    labels = {"gait": "trot", "policy": "expert", "scenario": "training", "estimator": ODOMETRY}
    rows = pd.DataFrame(
        [labels | {"steps": steps} | dict.fromkeys(ERRORS, own) for steps, own in ((3, 1), (1, 5))]
    )
    table = errors_table(rows, {"training": "home"})
    assert table[ERRORS].to_numpy().tolist() == [[1.414] * 4]
    assert table["scenario"].tolist() == ["home"]


def test_a_gain_of_more_than_all_is_refused():
    with pytest.raises(InputError, match="gain"):
        Estimators(gain=1.5)

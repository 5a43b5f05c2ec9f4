"""The comparison of estimators."""

import numpy as np
import pandas as pd
import pytest

from glassgait.diagrams.scenario import Scenario
from glassgait.models.errors import InputError
from glassgait.models.policies.controller import alone
from glassgait.models.policies.neural import Network, NeuralPolicy
from glassgait.models.robots import quadruped
from glassgait.models.task.observation import ObservationLayout
from glassgait.studies.common.cases import Case
from glassgait.studies.evaluation.estimators import (
    ERRORS,
    LEARNED,
    ODOMETRY,
    Estimators,
    errors_table,
)


@pytest.fixture
def standing_by_a_network(tmp_path, trot):
    """The folder of an expert that stands, and whose network always estimates the same."""
    names = ObservationLayout(trot.n_states).names
    still, guess = (
        Network((np.zeros((outputs, inputs)),), (bias,))
        for inputs, outputs, bias in (
            (len(names), quadruped.N_JOINTS, np.zeros(quadruped.N_JOINTS)),
            (len(names) - 7, 7, np.array([0.5, 0.0, 0.0, 0.03, 0.03, 0.03, 0.03])),
        )
    )
    (tmp_path / "run").mkdir()
    NeuralPolicy("trot", names, still, guess).save(tmp_path / "run" / "trot.safetensors")
    return tmp_path / "run"


def test_odometry_watches_and_changes_nothing(tmp_path, standing_by_a_network):
    for gain in (0.15, 0.9):
        Estimators(
            source=standing_by_a_network,
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
    # The robots stand, whatever the network says.
    slope = table[ERRORS].to_numpy()
    assert slope[1, 0] < slope[0, 0] and slope[1, 3] < slope[0, 3]


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

"""Predicted pushes: the sets, how large they may be, and the command."""

import json

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from glassgait.models.policies.controller import alone
from glassgait.models.task.command import Command
from glassgait.models.task.gait import load_gait
from glassgait.studies.cli import main
from glassgait.studies.evaluation.basin_figure import LOOKS, basin_figure
from glassgait.studies.evaluation.push_sets import (
    Circle,
    FittedConics,
    OrbitEllipses,
    Prediction,
    PushOutcomes,
    calibrated,
)
from glassgait.studies.evaluation.strides import SPEEDS, StrideMap

TROT = load_gait("trot")


def drawn(count, seed, survives):
    """Draws pushes, and lets those survive for which a function says so."""
    generator = np.random.default_rng(seed)
    velocity, phase = generator.uniform(-2, 2, (count, 2)), generator.uniform(0, 1, count)
    return PushOutcomes(velocity, phase, survives(velocity, phase, generator))


def in_ellipse(velocity, phase, _):
    """Survives what is in an ellipse that moves to the left and back with the phase."""
    left = velocity[:, 1] - 0.4 * np.cos(2 * np.pi * phase)
    return (velocity[:, 0] / 1.2) ** 2 + (left / 0.7) ** 2 < 1.0


def test_an_ellipse_of_the_stride_map_is_a_level_set_of_what_falls_from_stride_to_stride():
    jacobian = np.array([[0.5, 0.3], [0.0, -0.6]])
    own = OrbitEllipses.of(jacobian, np.stack([np.eye(2), 2.0 * np.eye(2)]))
    value, after = own.forms[0], jacobian.T @ own.forms[0] @ jacobian
    np.testing.assert_allclose(value - after, np.eye(2), atol=1e-12)
    velocity = np.array([[1.0, 0.0], [1.0, 0.0], [0.0, 0.5]])
    margin = own.margin(velocity, np.array([0.0, 0.5, 0.99]))
    # The phase just before the stride's end is nearest to its beginning.
    assert margin == pytest.approx([-value[0, 0], -4.0 * value[0, 0], -0.25 * value[1, 1]])


def test_conics_find_an_ellipse_that_moves_with_the_phase():
    fit, test = drawn(4000, 0, in_ellipse), drawn(1000, 1, in_ellipse)
    own = FittedConics.fit(fit)
    assert np.mean((own.margin(test.velocity, test.phase) > 0) == test.survived) > 0.97
    circle = Prediction(Circle(), -1.0, test).row()
    assert circle["AUC"] < Prediction(own, 0.0, test).row()["AUC"] > 0.99


def test_where_all_survive_every_push_is_in():
    everyone = drawn(300, 2, lambda velocity, *_: np.ones(len(velocity), dtype=bool))
    own = FittedConics.fit(everyone)
    threshold = calibrated(own, everyone, everyone)
    row = Prediction(own, threshold, everyone).row()
    assert row["of these survived"] == row["of these predicted"] == 1.0
    assert np.isnan(row["AUC"])
    nobody = drawn(300, 2, lambda velocity, *_: np.zeros(len(velocity), dtype=bool))
    own = FittedConics.fit(nobody)
    assert calibrated(own, nobody, nobody) == float("inf")
    row = Prediction(own, float("inf"), nobody).row()
    assert row["predicted"] == 0 and np.isnan(row["of these survived"])


def test_where_no_push_comes_nothing_is_predicted():
    none = drawn(0, 0, lambda velocity, *_: np.zeros(len(velocity), dtype=bool))
    own = FittedConics.fit(none)
    assert calibrated(own, none, none) == float("inf")
    prediction = Prediction(own, float("inf"), none)
    assert prediction.row()["predicted"] == prediction.row()["pushes"] == 0
    assert len(basin_figure({"expert": [prediction]}, "Trot").axes) == 4


def test_few_pushes_show_nothing():
    fit, few = drawn(500, 0, in_ellipse), drawn(50, 1, in_ellipse)
    own = FittedConics.fit(fit)
    assert calibrated(own, fit, few) == float("inf")
    assert np.isfinite(calibrated(own, fit, drawn(2000, 1, in_ellipse)))


def test_a_calibrated_set_seldom_holds_fewer_survivors_than_it_says():
    def with_odds(velocity, _, generator):
        speed = np.linalg.norm(velocity, axis=1)
        return generator.uniform(size=len(speed)) < 1.0 / (1.0 + np.exp(12.0 * (speed - 1.5)))

    unlucky, found = 0, 0
    tried, many = drawn(500, 999, with_odds), drawn(200_000, 1000, with_odds)
    margins = Circle().margin(many.velocity, many.phase)
    for seed in range(200):
        threshold = calibrated(Circle(), tried, drawn(500, seed, with_odds))
        if np.isfinite(threshold):
            found += 1
            unlucky += many.survived[margins >= threshold].mean() < 0.95
    assert found > 150
    # At most one in twenty, but for chance.
    assert unlucky <= 18


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 1000), threshold=st.floats(-2.0, 0.0))
def test_a_row_counts_what_is_in_and_what_survived(seed, threshold):
    test = drawn(200, seed, in_ellipse)
    row = Prediction(Circle(), threshold, test).row()
    inside = np.linalg.norm(test.velocity, axis=1) <= -threshold
    assert row["predicted"] == inside.sum()
    kept = (inside & test.survived).sum()
    assert row["of these predicted"] == pytest.approx(kept / test.survived.sum())
    if inside.any():
        assert row["95 % from"] <= row["of these survived"] <= row["95 % to"]


def test_a_picture_has_the_border_of_every_set_that_there_is():
    fit, test = drawn(500, 0, in_ellipse), drawn(500, 1, in_ellipse)
    forms = OrbitEllipses(np.tile(np.eye(2), (16, 1, 1)))
    predictions = [
        Prediction(Circle(), -1.0, test),
        Prediction(forms, -1.0, test),
        Prediction(FittedConics.fit(fit), 0.0, test),
    ]
    assert [one.own.title for one in predictions] == [*LOOKS]
    figure = basin_figure({"expert": predictions, "gbm": predictions[::2]}, "Trot")
    assert [len(axes.collections) for axes in figure.axes] == 4 * [5] + 4 * [4]
    lost = [Prediction(Circle(), float("inf"), test)]
    assert len(basin_figure({"expert": lost}, "Trot").axes[0].collections) == 2


def test_a_push_at_the_first_step_is_a_change_of_the_point(expert):
    strides = StrideMap(TROT, alone(expert), Command(np.array([[0.4, 0.0]]), np.array([8.0])))
    (point,) = strides.first_points()
    sides = np.array([0.0, np.pi / 2])
    pushed = strides.pushed(point, 0, sides, 0.1)
    moved = np.tile(point * strides.units, (2, 1))
    moved[:, SPEEDS] += 0.1 * np.eye(2)
    images = strides(moved / strides.units, np.zeros(2, dtype=np.int64))
    np.testing.assert_allclose(pushed, images, atol=1e-6)
    later = strides.pushed(point, 5, sides, 0.1)
    assert np.isfinite(later).all()
    assert np.abs(later - pushed).max() > 1e-3


@pytest.mark.slow
def test_the_command_counts_what_it_predicted(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    options = ["--n-fit", "60", "--n-calibration", "200", "--n-test", "60", "--n-phases", "8"]
    options += ["--greatest-speed", "0.3", "--n-steps", "50", "--n-workers", "1"]
    main(["evaluate", "basin", "--gait", "trot", "--policy", "expert", *options])
    folder = tmp_path / "runs" / "evaluate" / "basin" / "trot_expert"
    summary = json.loads((folder / "metrics.json").read_text())
    assert [row["set"] for row in summary] == [*LOOKS]
    # Pushes of 0.3 m/s are survived; and so sets of all of them can be shown to hold.
    assert {row["survived"] for row in summary} == {60}
    assert {row["of these survived"] for row in summary} == {1.0}
    pushes = pd.read_csv(folder / "pushes.csv")
    assert len(pushes) == 60
    assert np.hypot(pushes["forward (m/s)"], pushes["left (m/s)"]).max() <= 0.3
    assert (folder / "basin.png").exists()
    conics = pd.read_csv(folder / "conics.csv")
    assert conics["term"].tolist() == [*FittedConics.TERMS]

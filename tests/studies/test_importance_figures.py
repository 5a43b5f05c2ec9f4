"""Students drawn from within: interpret's own model of the additive ones, and trees."""

import re
from urllib.request import urlopen

import interpret
import numpy as np
import pytest
from interpret.glassbox import ExplainableBoostingRegressor
from sklearn.ensemble import GradientBoostingRegressor

from glassgait.models.formulas.quantities import RobotUnits
from glassgait.models.policies.additive import AdditivePolicy
from glassgait.models.policies.boosting import BoostedTreesPolicy
from glassgait.models.robots.library import load_robot
from glassgait.models.task.observation import ObservationLayout, entries_of
from glassgait.studies.common.experiment import Report
from glassgait.studies.importance.figures import (
    dependence_figure,
    interpret_model,
    shape_figure,
    student_figures,
    tree_figure,
)

A1 = load_robot()


NAMES = ObservationLayout(2).names
N = len(NAMES)


@pytest.fixture(scope="module")
def additive():
    """A bagged additive policy of four joints' models, twelve in all, and its samples."""
    generator = np.random.default_rng(2)
    observations = generator.normal(size=(400, N))
    targets = np.sin(observations[:, 3]) + observations[:, 5] * observations[:, 8]
    models = [
        ExplainableBoostingRegressor(
            feature_types=["continuous"] * N,
            outer_bags=2,
            interactions=3,
            max_rounds=40,
            random_state=seed,
            n_jobs=1,
        ).fit(observations, (1 + seed) * targets)
        for seed in range(2)
    ]
    policy = AdditivePolicy.compile("trot", NAMES, [models[i % 2] for i in range(12)])
    return policy, models, observations


@pytest.mark.slow
def test_interprets_dashboard_shows_the_model(additive, capsys):
    for package in ("dash", "dash_cytoscape", "gevent", "IPython", "plotly"):
        pytest.importorskip(package, reason="needs the extra 'show'")
    policy, _, observations = additive
    interpret.show(interpret_model(policy, 0, observations).explain_global())
    found = re.search(r"http://127\.0\.0\.1:\d+/\d+/", capsys.readouterr().out)
    assert found is not None
    with urlopen(f"{found.group()}_dash-layout", timeout=60) as answer:
        assert "q.FL_thigh" in answer.read().decode()


def test_interprets_own_model_comes_back(additive):
    policy, models, observations = additive
    rebuilt, units = interpret_model(policy, 1, observations), RobotUnits.of(A1, NAMES)
    quantities, scale = units.quantities(observations), A1.action_scale
    targets = A1.default_stance[1] + scale * models[1].predict(observations)
    np.testing.assert_allclose(rebuilt.predict(quantities), targets)
    np.testing.assert_allclose(rebuilt.term_importances(), scale * models[1].term_importances())
    ours, theirs = rebuilt.explain_global(), models[1].explain_global()
    assert ours.data()["names"][:N] == [entry.symbol for entry in entries_of(NAMES)]
    for term in (3, N):
        mine, other = ours.data(term), theirs.data(term)
        np.testing.assert_allclose(mine["scores"], scale * other["scores"])
        if term < N:
            assert max(mine["upper_bounds"] - mine["scores"]) > 0
            np.testing.assert_allclose(mine["upper_bounds"], scale * other["upper_bounds"])
    local = rebuilt.explain_local(quantities[:1]).data(0)
    parts = policy.explain(observations[0], 1)
    target = sum(local["scores"]) + rebuilt.intercept_
    assert target == pytest.approx(targets[0], abs=1e-9)
    assert parts.values.sum() == pytest.approx(target, abs=1e-9)


def test_functions_are_drawn_in_the_robots_units(additive):
    """A velocity is observed twentyfold smaller than it is; the page's axis is in rad/s."""
    policy, _, observations = additive
    velocity = NAMES.index("DoF Vel FL Hip")
    drawn = shape_figure(policy, interpret_model(policy, 0, observations), (velocity,), "title")
    above, below = drawn.axes
    assert below.get_xlabel() == "dq.FL_hip\n(rad/s)"
    assert above.get_ylabel() == "adds to the target (rad)"
    low, high = below.dataLim.intervalx
    seen = 20 * observations[:, velocity]
    assert (low, high) == pytest.approx((seen.min(), seen.max()))


def test_additive_students_are_drawn(additive, tmp_path):
    policy, _, observations = additive
    # A dollar sign in a name is one.
    figures = student_figures(r"a$\frac$b", "ebm", policy, 0, observations)
    assert [*figures] == [f"ebm_FL_hip_{what}" for what in ("terms", "shapes", "pair_1", "pair_2")]
    Report(figures=figures).write(tmp_path)
    for stem in figures:
        assert (tmp_path / f"{stem}.png").stat().st_size > 5000
        assert (tmp_path / f"{stem}.pdf").exists()


def test_trees_are_drawn_with_their_questions(generator):
    observations = generator.normal(size=(300, N))
    model = GradientBoostingRegressor(n_estimators=4, max_depth=3, random_state=0)
    model.fit(observations, np.where(observations[:, 7] > 0.2, 1.0, -1.0) + observations[:, 9])
    policy = BoostedTreesPolicy.compile("trot", NAMES, [model] * 12)
    added = policy.tree_values(observations, 2).sum(axis=-1)
    np.testing.assert_allclose(added + policy.intercepts[2], policy(observations)[:, 2])
    figure = tree_figure(policy, 2, observations)
    boxes = [text.get_text() for text in figure.axes[0].texts]
    assert boxes[0].startswith("q.FR_calf\n≤ ")
    assert " rad?\n" in boxes[0]
    assert "300 samples" in boxes[0]
    assert {"yes", "no"} < set(boxes)
    drawn = dependence_figure(policy, 2, observations, (7, 9), generator, n_curves=5)
    assert drawn.axes[0].get_xlabel() == "q.FR_calf\n(rad)"
    assert drawn.axes[0].get_ylabel() == "target of FL calf (rad)"

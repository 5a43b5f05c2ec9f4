"""Figures of additive students and trees."""

import numpy as np
import pytest
from interpret.glassbox import ExplainableBoostingRegressor
from sklearn.ensemble import GradientBoostingRegressor

from glassgait.models.policies.additive import AdditivePolicy
from glassgait.models.policies.boosting import BoostedTreesPolicy
from glassgait.models.robots.library import load_robot
from glassgait.models.task.observation import ObservationLayout
from glassgait.studies.common.experiment import Report
from glassgait.studies.importance.figures import (
    dependence_figure,
    shape_figure,
    student_figures,
    term_figure,
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


def test_terms_are_ranked_by_what_interpret_calls_importance(additive):
    policy, models, observations = additive
    (axes,) = term_figure(policy.explain(observations, 1), "title").axes
    drawn = [bar.get_width() for bar in axes.patches]
    expected = np.sort(A1.action_scale * np.asarray(models[1].term_importances()))[::-1]
    np.testing.assert_allclose(drawn, expected[: len(drawn)])


def test_functions_are_drawn_in_the_robots_units(additive):
    """A velocity is observed twentyfold smaller than it is; the page's axis is in rad/s."""
    policy, _, observations = additive
    velocity = NAMES.index("DoF Vel FL Hip")
    drawn = shape_figure(policy, 0, observations, (velocity,), "title")
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

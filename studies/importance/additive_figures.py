"""Figures of one joint's additive model, from interpret's explanation objects."""

import textwrap
from typing import Any

import numpy as np
from interpret.glassbox import ExplainableBoostingRegressor
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from glassgait.models.policies.policy import Contributions
from glassgait.models.robots.robot import Robot
from glassgait.studies.common.figures import COLUMN_WIDTH, label_with_unit, styled, subplots

POSITIVE, NEGATIVE, NEUTRAL = "#D55E00", "#0072B2", "0.55"

LABEL_WIDTH = 42
"""Characters in a line of a label."""


@styled
def term_figure(model: ExplainableBoostingRegressor, title: str, n_terms: int = 15) -> Figure:
    """Ranks the terms by their mean size (paper, Figure 10)."""
    importances = np.asarray(model.term_importances())
    order = np.argsort(-importances, kind="stable")[:n_terms]
    names = [model.term_names_[index] for index in order]
    figure, axes = subplots(figsize=(COLUMN_WIDTH, 0.7 + 0.16 * len(order)))
    axes.barh(range(len(order)), importances[order], color="#0072B2")
    axes.set_yticks(range(len(order)), names, fontsize=6)
    axes.invert_yaxis()
    axes.set(xlabel="mean |contribution| to the action", title=title)
    return figure


@styled
def shape_figure(
    robot: Robot, model: ExplainableBoostingRegressor, terms: tuple[int, ...], title: str
) -> Figure:
    """Draws functions of one observation with bands of two standard deviations between the bagged
    models, above where the observations lie (paper, Figure 8, top)."""
    explanation: Any = model.explain_global()
    size = (2 * COLUMN_WIDTH, 2.3)
    figure, panels = subplots(
        2, len(terms), figsize=size, squeeze=False, height_ratios=(4, 1), sharex="col"
    )
    for (above, below), term in zip(panels.T, terms, strict=True):
        _draw_shape(above, below, explanation.data(term))
        name = model.term_names_[term]
        below.set_xlabel(label_with_unit(robot, name))
        below.set_yticks([])
    panels[0, 0].set_ylabel("adds to the action")
    panels[1, 0].set_ylabel("samples")
    figure.suptitle(title, fontsize=8)
    return figure


@styled
def pair_figure(robot: Robot, model: ExplainableBoostingRegressor, term: int, title: str) -> Figure:
    """Draws a function of two observations as a map (paper, Figure 8, bottom)."""
    explanation: Any = model.explain_global()
    data = explanation.data(term)
    first, second = (model.feature_names_in_[index] for index in model.term_features_[term])
    left, right = _edges(data["left_names"]), _edges(data["right_names"])
    scores = np.asarray(data["scores"])
    reach = max(float(np.abs(scores).max()), 1e-9)
    figure, axes = subplots(figsize=(COLUMN_WIDTH, 2.6))
    image = axes.pcolormesh(
        left, right, scores.T, cmap="RdBu_r", vmin=-reach, vmax=reach, rasterized=True
    )
    axes.grid(visible=False)
    axes.set(
        xlabel=label_with_unit(robot, first),
        ylabel=label_with_unit(robot, second),
        title=title,
    )
    figure.colorbar(image, ax=axes).set_label("adds to the action")
    return figure


@styled
def contribution_figure(contributions: Contributions, title: str, n_terms: int = 15) -> Figure:
    """Draws the parts of one target, the largest first, and their sum (paper, Figure 9)."""
    order = np.argsort(-np.abs(contributions.values), kind="stable")
    shown, rest = order[:n_terms], order[n_terms:]
    labels = [contributions.terms[index] for index in shown]
    values = contributions.values[shown].tolist()
    if len(rest):
        labels.append(f"{len(rest)} other terms")
        values.append(float(contributions.values[rest].sum()))
    labels.append("target")
    # Long terms go on in a second line; none is cut.
    labels = [textwrap.fill(label, LABEL_WIDTH) for label in labels]
    n_lines = sum(label.count("\n") + 1 for label in labels)
    values.append(float(contributions.values.sum()))
    colors = [POSITIVE if value > 0 else NEGATIVE for value in values]
    colors[-1] = NEUTRAL
    figure, axes = subplots(figsize=(COLUMN_WIDTH, 0.7 + 0.16 * n_lines))
    axes.barh(range(len(labels)), values, color=colors)
    axes.axvline(0.0, color="0.2", linewidth=0.6)
    axes.set_yticks(range(len(labels)), labels, fontsize=6)
    axes.invert_yaxis()
    axes.set(xlabel="adds to the target (rad)", title=title)
    return figure


def _draw_shape(above: Axes, below: Axes, data: dict[str, Any]) -> None:
    edges, scores = _edges(data["names"]), np.asarray(data["scores"])
    # interpret's bounds are one standard deviation away.
    band = 2.0 * (np.asarray(data["upper_bounds"]) - scores)
    above.stairs(
        scores + band, edges, baseline=scores - band, fill=True, color="#9ecae1", linewidth=0
    )
    above.stairs(scores, edges, baseline=None, color="#0072B2", linewidth=1.0)
    above.axhline(0.0, color="0.5", linewidth=0.5)
    density = data["density"]
    below.stairs(density["scores"], density["names"], fill=True, color="0.6")


def _edges(names: Any) -> np.ndarray:
    return np.asarray(names, dtype=float)

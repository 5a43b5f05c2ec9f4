"""The page of an explanation: replay, gait diagram and the terms of every target, in one file."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from glassgait.diagrams.rollout import Rollout
from glassgait.models.formulas.evaluate import Tape
from glassgait.models.formulas.expression import Expression, variable
from glassgait.models.formulas.grammar import write_formula
from glassgait.models.policies.policy import Contributions, FactoredTerm, Policy
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.models.robots import quadruped
from glassgait.models.robots.robot import DEFAULT_ROBOT
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.drawing import ink_on, state_colors
from glassgait.models.task.gait import Gait
from glassgait.studies.common.figures import inline_image, page_template
from glassgait.studies.explanation.policy_data import file_lines, variables_of

TEMPLATES = Path(__file__).parent / "templates"

MOST_SHOWN, N_SHOWN = 30, 14
"""A target with more than `MOST_SHOWN` terms shows `N_SHOWN` of them, and the sum of the others."""

ROUNDING = 1e-9
"""Differences of actions, and swings of a term within a state (rad), up to this count as 0."""


@dataclass(frozen=True)
class ExplainedJoint:
    """A joint's targets (n_steps,; rad), and the values of its terms (n_steps, k; rad)."""

    terms: tuple[FactoredTerm, ...]
    values: np.ndarray
    targets: np.ndarray
    states: np.ndarray

    def active(self) -> np.ndarray:
        """Returns whether each term is in the formula of the step's RM state (n_steps, k)."""
        # -1 stands for a term of all states.
        states = np.array([-1 if term.state is None else term.state for term in self.terms])
        return (states == -1) | (states == self.states[:, None])

    def active_of(self, contributions: Contributions, step: int) -> Contributions:
        """Selects the contributions (k) to a step's target that are in its state's formula."""
        active = np.flatnonzero(self.active()[step])
        terms = tuple(contributions.terms[index] for index in active)
        return Contributions(terms, contributions.values[active])

    def importances(self) -> np.ndarray:
        """Returns each term's mean absolute deviation from its mean in the RM state (k; rad)."""
        swings = np.array(self.values)
        for state in np.unique(self.states):
            inside = self.states == state
            swings[inside] -= swings[inside].mean(axis=0)
        return np.abs(swings).mean(axis=0)


def explain_rollout(policy: Policy, rollout: Rollout) -> tuple[ExplainedJoint, ...]:
    """Splits every target of a rollout into terms, joint by joint."""
    observations = rollout["observation"]
    # Terms add up to the targets before limits.
    targets = policy.robot.joint_targets(policy(observations))
    states = rollout["rm_state"].argmax(axis=1)
    explained = []
    for joint in range(quadruped.N_JOINTS):
        terms, values = policy.factored_terms(joint), policy.explain(observations, joint).values
        explained.append(ExplainedJoint(terms, values, targets[:, joint], states))
    return tuple(explained)


def render_page(
    *,
    gait: Gait,
    policy_name: str,
    policy: Policy,
    rollout: Rollout,
    explained: Sequence[ExplainedJoint],
    replay: str,
    joint: int,
    step: int,
    figures: Sequence[Path],
) -> str:
    """Renders the page of a student's rollout, which opens at a joint and control step.

    `replay` is Meshcat's page, and `figures` are PNG files of the joint.
    """
    # Collect the data from which the page's script draws.
    titles, units, variables = variables_of(policy, rollout["observation"])
    quantities, colors = _quantities(titles, explained), state_colors(gait)
    values = Tape(tuple(quantities), variables.shape[1])(variables)
    data = {
        "period": CONTROL_PERIOD,
        "legs": quadruped.LEGS,
        "states": gait.states,
        "colors": colors,
        "inks": [ink_on(color) for color in colors],
        "state": rollout["rm_state"].argmax(axis=1).tolist(),
        "contact": (rollout["foot_contact"] > 0.5).astype(int).tolist(),
        "joints": quadruped.JOINTS,
        "iterations": rollout["rm_iterations"].astype(int).ravel().tolist(),
        "quantities": list(quantities.values()),
        "units": units,
        # Terms use no values that are not finite.
        "values": _rounded(np.nan_to_num(values, posinf=0.0, neginf=0.0)),
        "explained": [_joint_data(each, list(quantities)) for each in explained],
        "figures": joint if figures else None,
        "file": file_lines(policy, len(gait.states)) if isinstance(policy, FormulaPolicy) else None,
        "joint": joint,
        "step": step,
    }

    # Fill in the template. In a script element, the data must not contain "<".
    robot = policy.robot.name
    of_robot = "" if robot == DEFAULT_ROBOT else f" of the {robot.capitalize()}"
    return page_template(TEMPLATES, "explanation.html").render(
        gait=gait,
        title=f"{gait.name.capitalize()}{of_robot}, {policy_name}",
        joint=quadruped.JOINTS[joint].replace("_", " "),
        limited=policy.joint_law.limited,
        limited_steps=limited_steps(policy, rollout),
        additive=any(not term.weights for each in explained for term in each.terms),
        weighted=any(term.weights for each in explained for term in each.terms),
        formulas=isinstance(policy, FormulaPolicy),
        data=json.dumps(data).replace("<", "\\u003c"),
        replay=json.dumps(replay).replace("<", "\\u003c"),
        figures=[(path.stem, inline_image(path)) for path in figures],
    )


def limited_steps(policy: Policy, rollout: Rollout) -> str | None:
    """Describes in how many steps limits changed the policy's action; None without limits."""
    if policy.joint_law.limits is None:
        return None
    changes = np.abs(policy(rollout["observation"]) - rollout["action"]).max(axis=1)
    return f"in {np.count_nonzero(changes > ROUNDING)} of {len(changes)} steps"


def _quantities(
    titles: Sequence[str], explained: Sequence[ExplainedJoint]
) -> dict[Expression, str]:
    """Names all quantities of terms: the variables in order, then functions."""
    names = {variable(index): name for index, name in enumerate(titles)}
    terms = (term for each in explained for term in each.terms)
    for quantity in (quantity for term in terms for quantity in term.quantities):
        if quantity not in names:
            names[quantity] = write_formula(quantity, titles)
    return names


def _joint_data(explained: ExplainedJoint, quantities: Sequence[Expression]) -> dict[str, Any]:
    """Returns each target's largest terms as pairs of index and value, and the others' sum."""
    # Select the largest terms of each step. In the file's order, rows of the page hardly move.
    values, active = explained.values, explained.active()
    sizes = np.where(active, np.abs(values), -1.0)
    order = np.argsort(-sizes, axis=1, kind="stable")
    n_active = active.sum(axis=1)
    n_shown = np.where(n_active > MOST_SHOWN, N_SHOWN, n_active)
    index = [sorted(ranked[:n].tolist()) for ranked, n in zip(order, n_shown, strict=True)]
    shown = [row[selected] for row, selected in zip(values, index, strict=True)]
    rest = [row.sum() - largest.sum() for row, largest in zip(values, shown, strict=True)]

    # Select the terms that swing most over the rollout.
    importances = explained.importances()
    moving = np.flatnonzero(importances > ROUNDING)
    ranked = np.sort(moving[np.argsort(-importances[moving], kind="stable")[:N_SHOWN]])
    place = {quantity: index for index, quantity in enumerate(quantities)}
    return {
        "terms": [
            {
                "weights": [float(f"{weight:.6g}") for weight in term.weights],
                "of": [place[quantity] for quantity in term.quantities],
                "state": term.state,
            }
            for term in explained.terms
        ],
        "target": _rounded(explained.targets),
        "index": index,
        "value": [_rounded(row) for row in shown],
        "others": (n_active - n_shown).tolist(),
        "rest": _rounded(np.array(rest)),
        "error": float(np.abs(values.sum(axis=1) - explained.targets).max()),
        "ranked": ranked.tolist(),
        "moving": len(moving),
        "importance": _rounded(importances[ranked]),
    }


def _rounded(values: np.ndarray) -> list:
    return np.round(values, 5).tolist()

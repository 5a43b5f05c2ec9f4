"""The page: replay, gait diagram and the terms of every target, in one file that opens offline."""

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
"""Terms of a target that are all shown, and of one with more; the others are a sum."""

ROUNDING = 1e-9
"""Difference of actions, and swing of a term within a state (rad), that is none."""


@dataclass(frozen=True)
class ExplainedJoint:
    """A joint's targets (n_steps,; rad), and what each of its terms adds (n_steps, k; rad)."""

    terms: tuple[FactoredTerm, ...]
    values: np.ndarray
    targets: np.ndarray
    states: np.ndarray

    def active(self) -> np.ndarray:
        """Returns which terms are in the formula of the step's state (n_steps, k)."""
        # A term that serves all states has none of its own.
        own = np.array([-1 if term.state is None else term.state for term in self.terms])
        return (own == -1) | (own == self.states[:, None])

    def active_of(self, contributions: Contributions, step: int) -> Contributions:
        """Leaves those parts (k) of a step's target that are in the formula of its state."""
        kept = np.flatnonzero(self.active()[step])
        terms = tuple(contributions.terms[index] for index in kept)
        return Contributions(terms, contributions.values[kept])

    def importances(self) -> np.ndarray:
        """Returns the mean size of each term's swings around its mean of the state (k; rad)."""
        swings = np.array(self.values)
        for state in np.unique(self.states):
            inside = self.states == state
            swings[inside] -= swings[inside].mean(axis=0)
        return np.abs(swings).mean(axis=0)


def explain_rollout(policy: Policy, rollout: Rollout) -> tuple[ExplainedJoint, ...]:
    """Splits every target of a rollout into terms, joint by joint."""
    observations = rollout["observation"]
    # Terms add up to what the policy asks for, before limits.
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
    """Renders the page of a student's rollout, first shown at a joint and control step.

    The replay is Meshcat's page; figures (PNG) are of the joint.
    """
    # The page's script draws from this data.
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
        # No term shows a value that is not finite.
        "values": _rounded(np.nan_to_num(values, posinf=0.0, neginf=0.0)),
        "explained": [_joint_data(own, list(quantities)) for own in explained],
        "figures": joint if figures else None,
        "file": file_lines(policy, len(gait.states)) if isinstance(policy, FormulaPolicy) else None,
        "joint": joint,
        "step": step,
    }

    # The template holds the text around it. The data may stand inside a script element.
    robot = policy.robot.name
    whose = "" if robot == DEFAULT_ROBOT else f" of the {robot.capitalize()}"
    return page_template(TEMPLATES, "explanation.html").render(
        gait=gait,
        title=f"{gait.name.capitalize()}{whose}, {policy_name}",
        joint=quadruped.JOINTS[joint].replace("_", " "),
        limited=policy.joint_law.limited,
        held_back=held_back(policy, rollout),
        additive=any(not term.weights for own in explained for term in own.terms),
        weighted=any(term.weights for own in explained for term in own.terms),
        formulas=isinstance(policy, FormulaPolicy),
        data=json.dumps(data).replace("<", "\\u003c"),
        replay=json.dumps(replay).replace("<", "\\u003c"),
        figures=[(path.stem, inline_image(path)) for path in figures],
    )


def held_back(policy: Policy, rollout: Rollout) -> str | None:
    """Returns in words how often limits changed what a policy asked for; None without limits."""
    if policy.joint_law.limits is None:
        return None
    apart = np.abs(policy(rollout["observation"]) - rollout["action"]).max(axis=1)
    return f"in {np.count_nonzero(apart > ROUNDING)} of {len(apart)} steps"


def _quantities(
    titles: Sequence[str], explained: Sequence[ExplainedJoint]
) -> dict[Expression, str]:
    """Names everything that some term is made of: the variables in order, then functions."""
    every = {variable(index): name for index, name in enumerate(titles)}
    terms = (term for own in explained for term in own.terms)
    for quantity in (quantity for term in terms for quantity in term.quantities):
        if quantity not in every:
            every[quantity] = write_formula(quantity, titles)
    return every


def _joint_data(explained: ExplainedJoint, quantities: Sequence[Expression]) -> dict[str, Any]:
    """Keeps each target's largest terms as pairs of index and value, and the others' sum."""
    # Choose the largest terms of each step; in the file's order rows stay where they are.
    values, active = explained.values, explained.active()
    sizes = np.where(active, np.abs(values), -1.0)
    order = np.argsort(-sizes, axis=1, kind="stable")
    n_active = active.sum(axis=1)
    n_shown = np.where(n_active > MOST_SHOWN, N_SHOWN, n_active)
    index = [sorted(own[:n].tolist()) for own, n in zip(order, n_shown, strict=True)]
    shown = [own[kept] for own, kept in zip(values, index, strict=True)]
    rest = [own.sum() - kept.sum() for own, kept in zip(values, shown, strict=True)]

    # Choose the terms that swing most over the rollout.
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
        "value": [_rounded(own) for own in shown],
        "others": (n_active - n_shown).tolist(),
        "rest": _rounded(np.array(rest)),
        "error": float(np.abs(values.sum(axis=1) - explained.targets).max()),
        "ranked": ranked.tolist(),
        "moving": len(moving),
        "importance": _rounded(importances[ranked]),
    }


def _rounded(values: np.ndarray) -> list:
    return np.round(values, 5).tolist()

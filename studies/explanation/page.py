"""The page: replay, gait diagram and the terms of every action, in one file that opens offline."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from diagrams.rollout import Rollout
from models.a1 import robot
from models.policies.gates import GATE_MEANINGS
from models.policies.policy import Contributions, Policy
from models.task import CONTROL_PERIOD
from models.task.gait import Gait
from models.task.palette import STATE_COLORS
from studies.evaluation.tables import POLICY_TITLES
from studies.pages import inline_image, page_template

TEMPLATES = Path(__file__).parent / "templates"

TRUNK_PLACE = slice(4, 6)
"""The trunk's x and y in the plant's state."""

N_SHOWN = 14
"""Terms that the page holds of each action; it holds the sum of the others."""


@dataclass(frozen=True)
class ExplainedJoint:
    """What a joint's actions consist of, over a rollout.

    Attributes:
        contributions: The parts, values (n_steps, k).
        actions: The actions (n_steps,).
    """

    contributions: Contributions
    actions: np.ndarray

    def importances(self) -> np.ndarray:
        """Returns the mean size of each term's swings over the rollout (k)."""
        values = self.contributions.values
        return np.abs(values - values.mean(axis=0)).mean(axis=0)


def explain_rollout(policy: Policy, rollout: Rollout) -> tuple[ExplainedJoint, ...]:
    """Splits every action of a rollout into terms, joint by joint.

    Args:
        policy: The student that acted.
        rollout: What it did.

    Raises:
        InputError: if this kind of policy has no such terms.
    """
    observations, actions = rollout["observations"], rollout["actions"]
    return tuple(
        ExplainedJoint(policy.explain(observations, joint), actions[:, joint])
        for joint in range(robot.N_JOINTS)
    )


def render_page(
    *,
    gait: Gait,
    policy_name: str,
    rollout: Rollout,
    explained: Sequence[ExplainedJoint],
    replay: str,
    joint: int,
    step: int,
    figures: Sequence[Path],
) -> str:
    """Renders the page.

    Args:
        gait: The gait.
        policy_name: Kind of student, or stem of its file.
        rollout: What the student did.
        explained: What its actions consist of.
        replay: Meshcat's page of the rollout.
        joint: Joint that is shown first.
        step: Control step that is shown first.
        figures: Figures of that joint, as PNG, in order.
    """
    data = {
        "period": CONTROL_PERIOD,
        "joints": [name.replace("_", " ") for name in robot.JOINTS],
        "legs": robot.LEGS,
        "states": gait.states,
        "colors": STATE_COLORS[: gait.n_states],
        "state": rollout["rm_state"].argmax(axis=1).tolist(),
        "iterations": rollout["rm_iterations"].astype(int).ravel().tolist(),
        "contact": (rollout["foot_contact"] > 0.5).astype(int).tolist(),
        "place": np.round(rollout["state"][:, TRUNK_PLACE], 3).tolist(),
        "explained": [_joint_data(own) for own in explained],
        "joint": joint,
        "step": step,
    }
    return page_template(TEMPLATES, "explanation.html").render(
        gait=gait,
        policy=POLICY_TITLES.get(policy_name, policy_name),
        joint=robot.JOINTS[joint].replace("_", " "),
        n_shown=N_SHOWN,
        gates=_gates(explained),
        data=_embedded(data),
        replay=_embedded(replay),
        figures=[(path.stem, inline_image(path)) for path in figures],
    )


def _gates(explained: Sequence[ExplainedJoint]) -> dict[str, str]:
    """Returns the gates that some term has, and what they mean."""
    terms = " ".join(term for own in explained for term in own.contributions.terms)
    return {gate: meaning for gate, meaning in GATE_MEANINGS.items() if gate in terms}


def _joint_data(explained: ExplainedJoint) -> dict[str, Any]:
    """Keeps each action's largest terms as pairs of index and value, and the others' sum."""
    values = explained.contributions.values
    order = np.argsort(-np.abs(values), axis=1, kind="stable")[:, :N_SHOWN]
    shown = np.take_along_axis(values, order, axis=1)
    importances = explained.importances()
    ranked = np.argsort(-importances, kind="stable")[:N_SHOWN]
    return {
        "terms": explained.contributions.terms,
        "action": _rounded(explained.actions),
        "index": order.tolist(),
        "value": _rounded(shown),
        "rest": _rounded(values.sum(axis=1) - shown.sum(axis=1)),
        "error": float(np.abs(values.sum(axis=1) - explained.actions).max()),
        "ranked": ranked.tolist(),
        "importance": _rounded(importances[ranked]),
    }


def _rounded(values: np.ndarray) -> list:
    return np.round(values, 5).tolist()


def _embedded(value: Any) -> str:
    """Writes JSON that may stand inside a script element."""
    return json.dumps(value).replace("<", "\\u003c")

"""Questions and answers in words and tables, and the page that shows them."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from glassgait.models.counterfactuals.question import Answer, Question
from glassgait.models.formulas.quantities import RobotUnits
from glassgait.models.robots import quadruped
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.gait import Gait
from glassgait.models.task.observation import entries_of
from glassgait.studies.common.gait_figure import strip_data
from glassgait.studies.common.pages import embedded, gait_title, inline_image, page_template
from glassgait.studies.distillation.students.registry import policy_title
from glassgait.studies.explanation.counterfactuals.futures import (
    AFTER,
    BEFORE,
    WAS,
    WOULD_BE,
    Futures,
)

_WORDS = {
    "hip": ("turn further to the left", "turn further to the right"),
    "thigh": ("swing further back", "swing further forward"),
    "calf": ("stretch more", "bend more"),
}
"""What a joint does whose angle is more, or less."""

_GROUPS = {
    "joint position": "angle of {0}",
    "joint velocity": "velocity of {0}",
    "previous action": "target of {0} at the step before",
    "foot height": "height of the {0} foot",
}

_AXES = {
    "v.x": "forward speed",
    "v.y": "speed to the left",
    "v.z": "upward speed",
    "g.x": "gravity's part ahead",
    "g.y": "gravity's part to the left",
    "g.z": "gravity's part upward",
    "w.x": "roll rate",
    "w.y": "pitch rate",
    "w.z": "yaw rate",
}


def question_in_words(question: Question, step: int) -> str:
    """Returns the question as a person would ask it."""
    more, less = _WORDS[quadruped.JOINTS[question.joint].split("_")[1]]
    name = quadruped.JOINTS[question.joint].replace("_", " ")
    return f"Why did {name} not {more if question.by > 0 else less} at step {step}?"


def answer_table(question: Question, answer: Answer) -> pd.DataFrame:
    """Lists what would have had to differ, in the robot's units, what differs most first.

    Returns:
        A row an observation: `observation`, `symbol` as formulas call it, `was`, `would be` and
        `difference` in `unit`, and `spreads`, the difference in standard deviations.
    """
    names, room = question.policy.observation_names, question.room
    units, entries = RobotUnits.of(question.policy.robot, names), entries_of(names)
    was, would_be = (units.quantities(o) for o in (question.observation, answer.observation))
    spreads = (answer.observation - question.observation)[answer.changed]
    spreads = spreads / room.spread[answer.changed]
    order = np.argsort(-np.abs(spreads), kind="stable")
    rows = [
        {
            "observation": _name_in_words(
                entries[index].group, entries[index].symbol, names[index]
            ),
            "symbol": entries[index].symbol,
            "was": float(was[index]),
            "would be": float(would_be[index]),
            "difference": float(would_be[index] - was[index]),
            "unit": entries[index].unit,
            "spreads": float(spread),
        }
        for index, spread in zip(answer.changed[order].tolist(), spreads[order], strict=True)
    ]
    return pd.DataFrame(rows)


def certainty_in_words(answer: Answer) -> str:
    """Returns whether an answer is proved to be the nearest of its sort."""
    if answer.gap < 1e-6:
        return "proved to be the nearest"
    if answer.proved:
        return f"proved to be the nearest but for {100 * answer.gap:.1f} % of its distance"
    if answer.bound <= 0:
        return "not proved to be the nearest: a nearer one may have been missed"
    return f"not proved to be the nearest: one nearer by {100 * answer.gap:.0f} % may be missed"


def outcome_in_words(outcome: Mapping[str, Any], by: float) -> str:
    """Describes what the joint and its foot did, of `Futures.outcome`."""
    followed = np.sign(outcome["joint"]) == np.sign(by) and abs(outcome["joint"]) > 1e-4
    moved = (
        f"the joint went {abs(outcome['joint']):.3f} rad that way after {outcome['after']:.2f} s, "
        f"and its foot was {_side(outcome['height'], 'higher', 'lower')} and "
        f"{_side(outcome['forward'], 'further forward', 'further back')}"
        if followed
        else "the joint did not go that way"
    )
    falls = {
        (False, False): "neither robot fell",
        (True, False): "with the other observation the robot fell",
        (False, True): "only the robot as it was fell",
        (True, True): "both robots fell",
    }
    return f"The target changed by {_change(outcome['target'])}; {moved}; " + (
        f"{falls[outcome['fell'], outcome['fell_before']]} within the part that is shown."
    )


def _change(value: float) -> str:
    """Writes by how much a target changes, however small a change was asked for."""
    return f"{value:+#.3g} rad"


def _side(value: float, more: str, less: str) -> str:
    return f"{1000 * abs(value):.1f} mm {more if value > 0 else less}"


def _name_in_words(group: str, symbol: str, name: str) -> str:
    pattern = _GROUPS.get(group)
    if pattern is None:
        return _AXES.get(symbol, name)
    return pattern.format(symbol.split(".")[1].replace("_", " "))


TEMPLATES = Path(__file__).parent / "templates"

_HEADINGS = {"nearest": "The nearest observation", "fewest": "The fewest changes"}


def render_page(
    *,
    gait: Gait,
    policy_name: str,
    question: Question,
    step: int,
    answers: Mapping[str, Answer | None],
    replayed: str,
    lasting: int,
    outcome: Mapping[str, Any],
    futures: Futures,
    replay: str,
    figure: Path,
) -> str:
    """Renders the page.

    Args:
        policy_name: Kind of student, or stem of its file.
        step: Control step that it is about.
        answers: The nearest answer and that of fewest changes, by name.
        replayed: Name of the answer that the policy was given.
        lasting: For how many control steps it was.
        outcome: What came of it, as `Futures.outcome` returns.
        futures: What was, and what came of it.
        replay: Meshcat's page of both robots.
        figure: Picture of both futures.
    """
    order = (replayed, *(name for name in answers if name != replayed))
    opened = min(BEFORE, step)
    return page_template(TEMPLATES, "counterfactual.html").render(
        title=f"{gait_title(gait.name, question.policy.robot)}, {policy_title(policy_name)}",
        question=question_in_words(question, step),
        by=question.by,
        step=step,
        moment=step * CONTROL_PERIOD,
        opened=opened,
        before=opened * CONTROL_PERIOD,
        after=AFTER * CONTROL_PERIOD,
        answers=[_shown(_HEADINGS[name], question, answers[name]) for name in order],
        lasting=lasting,
        outcome=outcome_in_words(outcome, question.by),
        colors=(WAS, WOULD_BE),
        futures=("as it was", "given the other observation"),
        strips=embedded([strip_data(part, gait) for part in futures.shown()]),
        replay=embedded(replay),
        figure=inline_image(figure),
    )


def _shown(heading: str, question: Question, answer: Answer | None) -> dict[str, Any]:
    if answer is None:
        return {"heading": heading, "table": pd.DataFrame(), "summary": ""}
    count = len(answer.changed)
    summary = (
        f"{count} observation{'s' if count > 1 else ''} would have had to differ, by a distance "
        f"of {answer.distance:.2f} standard deviations in all; {certainty_in_words(answer)}. The "
        f"target that the policy asks for then changes by {_change(answer.change_of_target)}."
    )
    return {"heading": heading, "table": answer_table(question, answer), "summary": summary}

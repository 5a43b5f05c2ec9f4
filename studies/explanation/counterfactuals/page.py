"""The page: the question, its answers, what came of one, and both robots in one replay."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pandas as pd

from glassgait.models.counterfactuals.question import Answer, Question
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.gait import Gait
from glassgait.studies.common.pages import inline_image, page_template
from glassgait.studies.distillation.students.registry import policy_title
from glassgait.studies.explanation.counterfactuals.futures import AFTER, BEFORE, WAS, WOULD_BE
from glassgait.studies.explanation.counterfactuals.words import (
    answer_table,
    certainty_in_words,
    outcome_in_words,
    question_in_words,
)

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
    replay: str,
    figure: Path,
) -> str:
    """Renders the page.

    Args:
        gait: The gait.
        policy_name: Kind of student, or stem of its file.
        question: The question.
        step: Control step that it is about.
        answers: The nearest answer and that of fewest changes, by name.
        replayed: Name of the answer that the policy was given.
        lasting: For how many control steps it was.
        outcome: What came of it, as `Futures.outcome` returns.
        replay: Meshcat's page of both robots.
        figure: Picture of both futures.
    """
    order = (replayed, *(name for name in answers if name != replayed))
    return page_template(TEMPLATES, "counterfactual.html").render(
        gait=gait,
        policy=policy_title(policy_name),
        question=question_in_words(question, step),
        by=question.by,
        step=step,
        moment=step * CONTROL_PERIOD,
        before=BEFORE * CONTROL_PERIOD,
        after=AFTER * CONTROL_PERIOD,
        answers=[_shown(_HEADINGS[name], question, answers[name]) for name in order],
        lasting=lasting,
        outcome=outcome_in_words(outcome, question.by),
        colors=(WAS, WOULD_BE),
        replay=json.dumps(replay).replace("<", "\\u003c"),
        figure=inline_image(figure),
    )


def _shown(heading: str, question: Question, answer: Answer | None) -> dict[str, Any]:
    if answer is None:
        return {"heading": heading, "table": pd.DataFrame(), "summary": ""}
    count = len(answer.changed)
    summary = (
        f"{count} observation{'s' if count > 1 else ''} would have had to differ, by a distance "
        f"of {answer.distance:.2f} standard deviations in all; {certainty_in_words(answer)}. The "
        f"policy then asks for {answer.change_of_target:+.4f} rad."
    )
    return {"heading": heading, "table": answer_table(question, answer), "summary": summary}

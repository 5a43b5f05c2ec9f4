"""`glassgait explain typeset`: a controller of formulas as a page of mathematics, and as LaTeX."""

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from glassgait.models.files import write_atomically
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.models.task import CONTROL_PERIOD
from glassgait.studies.common.console import console
from glassgait.studies.common.pages import gait_title
from glassgait.studies.common.typeset import StateJoint, image_places, to_html, to_latex
from glassgait.studies.distillation.students.library import OnePolicy
from glassgait.studies.distillation.students.registry import student_title
from glassgait.studies.explanation.interventions.command import SENTENCES, ExplainInterventions
from glassgait.studies.explanation.interventions.sentences import (
    SUFFIX,
    Sentences,
    find_sentences,
)


@dataclass(frozen=True)
class ExplainTypeset(OnePolicy):
    """Write all that a policy of formulas says as a page of mathematics, and the same as LaTeX.

    The page says of each formula what its largest term says on the robot, where 'explain
    interventions --each' was run of this very policy, or its sentences lie beside the policy.

    Attributes:
        output: Folder of the page; runs/explain/typeset/<gait> by default.
    """

    title: ClassVar[str] = "explain typeset"

    output: Path | None = None

    def run(self) -> None:
        """Writes the page, its LaTeX twin, and the file that both are made of."""
        found, name = self.find()
        policy, stem = found.formulas(name), Path(name).stem
        folder = self.output or found.output(self.title)
        tested = found.output(ExplainInterventions.title) / stem / SENTENCES
        said = find_sentences(policy.digest(), (tested, beside(found.file(name))))
        for path, text in typeset(policy, stem, said).items():
            write_atomically(folder / path, text)
        console.print(f"page written to {folder / f'{stem}.html'}")


def beside(path: Path) -> Path:
    """Returns where the sentences of a policy's file lie, if they lie beside it."""
    return path.with_name(f"{path.stem}{SUFFIX}")


def typeset(policy: FormulaPolicy, stem: str, sentences: Sentences | None) -> dict[str, str]:
    """Returns a policy's file, and its typeset forms, by name.

    Args:
        policy: The policy.
        stem: What the names begin with.
        sentences: What its largest terms say, if that was tested.
    """
    file = policy.to_file()
    title = f"{gait_title(policy.gait, policy.robot)}: {student_title(stem).lower()}"
    said: dict[StateJoint, str] = {}
    sentences_of = ""
    if sentences is not None:
        seconds = sentences.n_steps * CONTROL_PERIOD
        sentences_of = f"{sentences.n_robots} robots, {seconds:g} s each"
        said = _words(policy, sentences)
    source, page, twin = f"{stem}{policy.suffix}", f"{stem}.html", f"{stem}.tex"
    shown = {"title": title, "source": source, "twin": twin}
    html = to_html(file, policy.robot, **shown, sentences=said, sentences_of=sentences_of)
    return {source: policy.to_text(), page: html, twin: to_latex(file, policy.robot)}


def _words(policy: FormulaPolicy, sentences: Sentences) -> dict[StateJoint, str]:
    """Returns the sentence of each state and joint, those of mirror images too."""
    own = sentences.of_places()
    said = {place: sentence.words() for place, sentence in own.items()}
    for place, image in image_places(policy.to_file()).items():
        if image in own:
            said[place] = own[image].words(mirrored=True)
    return said

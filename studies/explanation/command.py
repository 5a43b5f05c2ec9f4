"""`glassgait explain page` and `explain formulas`: explains a rollout, and prints formulas."""

from dataclasses import field
from pathlib import Path
from typing import Annotated, ClassVar

from annotated_types import Ge
from rich.text import Text

from glassgait.models.errors import InputError
from glassgait.models.files import write_atomically
from glassgait.models.formulas.latex import programs_of, to_latex
from glassgait.models.policies.reading_cost import reading_cost
from glassgait.models.robots import quadruped
from glassgait.models.robots.quadruped import joint_index
from glassgait.models.settings import Seed, checked
from glassgait.studies.common.console import console, say
from glassgait.studies.common.jobs import Steps
from glassgait.studies.common.rollouts import CommandOverride
from glassgait.studies.distillation.students import OnePolicy, sums_of_terms

STEP = 100  # step that is shown first by default, if the rollout is long enough


@checked
class ExplainPage(OnePolicy):
    """Roll out a student without the expert, and write a page that explains every action.

    Attributes:
        joint: Joint that is shown first, and whose figures are drawn.
        step: Control step that is shown first, and whose contributions are drawn; by default 100,
            or the last one of a shorter rollout.
        command: Commanded speed (0.5 m/s, or the gait's greatest), yaw rate and rhythm.
        n_steps: Control steps of the rollout; a fall ends it earlier.
        seed: Seed of the sensors' noise.
        output: Folder of the page; runs/explain/page/<gait>/<policy> by default.
    """

    title: ClassVar[str] = "explain page"

    joint: str = "FL_hip"
    step: Annotated[int, Ge(0)] | None = None
    command: CommandOverride = field(default_factory=CommandOverride)
    n_steps: Steps = 300
    seed: Seed = 0
    output: Path | None = None

    def __post_init__(self) -> None:
        self._check_step(self.n_steps, "ends")

    def run(self) -> None:
        policies, policy = self.find()
        gait = policies.gait
        joint, controller = joint_index(self.joint), policies.controller(policy)
        student, name = controller.policy, Path(policy).stem
        # Refuse a student whose actions are not sums of terms before slow imports.
        try:
            student.factored_terms(joint)
        except InputError as error:
            kinds = ", ".join(sums_of_terms())
            raise InputError(
                f"--policy {policy}: its actions are no sums of terms; name one of {kinds}, or "
                "see 'glassgait importance'"
            ) from error

        from glassgait.diagrams.scenario import Scenario
        from glassgait.diagrams.visualization import open_meshcat
        from glassgait.studies.common.figures import save_figure
        from glassgait.studies.common.rollouts import play
        from glassgait.studies.explanation.page import explain_rollout, render_page
        from glassgait.studies.importance.figures import contribution_figure, student_figures

        # Roll out the student without the expert, and save the replay.
        folder = self.output or policies.output(self.title) / name
        replay = folder / f"{name}_replay.html"
        say("rolling out")
        rollout = play(
            gait,
            controller,
            Scenario(command=self.command.override(gait)),
            open_meshcat(),
            replay,
            n_steps=self.n_steps,
            seed=self.seed,
        )
        last = len(rollout.time) - 1
        self._check_step(last, "ended in a fall" if rollout.failed else "ends")
        step = min(STEP, last) if self.step is None else self.step

        # Split all targets into terms, and draw the figures of the joint that is shown first.
        say("splitting every target into its terms")
        explained = explain_rollout(student, rollout)
        title = f"{gait.name.capitalize()}, {self.joint.replace('_', ' ')}, step {step}"
        local = folder / f"{name}_{self.joint}_step_{step}"
        terms = student.explain(rollout["observation"][step], joint)
        save_figure(contribution_figure(explained[joint].active_of(terms, step), title), local)
        figures = student_figures(gait.name, name, student, joint, rollout["observation"])
        for stem, figure in figures.items():
            save_figure(figure, folder / stem)

        # Write everything that the page shows into one file.
        page = render_page(
            gait=gait,
            policy_name=name,
            policy=student,
            rollout=rollout,
            explained=explained,
            replay=replay.read_text(),
            joint=joint,
            step=step,
            figures=[folder / f"{stem}.png" for stem in (local.name, *figures)],
        )
        write_atomically(folder / "index.html", page)
        console.print(f"page written to {folder / 'index.html'}")

    def _check_step(self, last: int, end: str) -> None:
        if self.step is not None and self.step > last:
            raise InputError(
                f"--step {self.step}: the rollout {end} at step {last}; name one from 0 to {last}, "
                "or raise --n-steps"
            )


@checked
class ExplainFormulas(OnePolicy):
    """Print the formulas of a policy, as the text of its file or as LaTeX.

    Attributes:
        joint: Print only the lines of this joint, for example FL_calf.
        latex: Print the whole controller as a LaTeX document instead.
    """

    title: ClassVar[str] = "explain formulas"

    joint: str | None = None
    latex: bool = False

    def __post_init__(self) -> None:
        if self.latex and self.joint is not None:
            raise InputError("--joint: LaTeX is of the whole controller; leave --latex or this out")

    def run(self) -> None:
        policies, name = self.find()
        student = policies.formulas(name)
        if self.latex:
            print(to_latex(student.to_file()), end="")
            return
        if self.joint is not None:
            quadruped.joint_index(self.joint)

        # Print the file, with colours on a terminal.
        file, lines = student.to_file(), student.to_text().splitlines()
        for line in lines_of_joint(lines, self.joint) if self.joint else lines:
            console.print(_colored(line), soft_wrap=True)

        # Print the programs as comments, so that the whole output is a formula file.
        for title, program in {} if self.joint else programs_of(file).items():
            console.print(f"\n# {title}", style="dim")
            for line in program:
                console.print(f"#   {line}", style="dim", soft_wrap=True)
        written, cost = len(file.written()), reading_cost(student)
        console.print(
            f"\n# {name}: {student.n_terms()} terms in {written} formulas, on {len(lines)} lines; "
            f"{cost.operations} operations per action, {cost.numbers} numbers to read",
            style="dim",
        )


def lines_of_joint(lines: list[str], joint: str) -> list[str]:
    """Returns the titles and the lines of one joint from the lines of a formula file."""
    selected, of_joint = [], False
    for line in lines:
        if not line.startswith(" "):
            of_joint = line.startswith(f"{joint} ")
        if of_joint or line.startswith(("state ", "every state")):
            selected.append(line)
    return selected


def _colored(line: str) -> Text:
    """Highlights comments, titles and the names of joints."""
    code, sign, comment = line.partition("#")
    text = Text(code)
    if code.startswith(("state ", "every state", "definitions")):
        text.stylize("bold")
    elif not code.startswith(" ") and " = " in code:
        text.stylize("bold cyan", 0, code.index(" = "))
    return text.append(sign + comment, style="dim")

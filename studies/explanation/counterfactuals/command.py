"""`glassgait explain counterfactual`: what a joint would have had to observe to do otherwise."""

import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
import pandas as pd
from annotated_types import Ge, Lt

from glassgait.diagrams.commands import FixedCommand
from glassgait.diagrams.locomotion import MakeLocomotion
from glassgait.diagrams.pair_replay import ReplayedRobot, save_pair_replay
from glassgait.diagrams.rollout import Rollout
from glassgait.diagrams.scenario import Scenario
from glassgait.models.arrays import Array
from glassgait.models.counterfactuals.question import (
    Answer,
    Answers,
    Intervention,
    Question,
    Room,
    answer,
    refuse_unsearched,
    search_of,
)
from glassgait.models.errors import InputError
from glassgait.models.files import write_atomically
from glassgait.models.policies.controller import AlternatingController
from glassgait.models.policies.policy import Policy
from glassgait.models.robots import quadruped
from glassgait.models.robots.quadruped import joint_index
from glassgait.models.settings import Count, Natural, Seed
from glassgait.models.task.gait import Gait
from glassgait.studies.common.console import console, progress_bar, say
from glassgait.studies.common.figures import save_figure
from glassgait.studies.common.play import Steps, roll_one_out
from glassgait.studies.common.run_folder import open_run
from glassgait.studies.common.tables import print_table, write_metrics, write_table
from glassgait.studies.distillation.students.library import OnePolicy
from glassgait.studies.explanation.counterfactuals.futures import (
    AFTER,
    WAS,
    WOULD_BE,
    Futures,
    course_figure,
)
from glassgait.studies.explanation.counterfactuals.page import (
    answer_table,
    certainty_in_words,
    outcome_in_words,
    question_in_words,
    render_page,
)


def ask_many(
    policy: Policy, observations: Array, room: Room, *, count: int, by: float, seed: int
) -> pd.DataFrame:
    """Asks questions of random moments and joints, up and down by turns.

    Args:
        observations: What it observed (m, n).
        room: What may be observed instead.
        count: Number of questions.
        by: By how much the target is to change (rad), either way.
        seed: Seed of moments and joints.

    Returns:
        A row a question: `joint`, `step` and `by`; the nearest answer's `distance` (spreads), `gap`
        and number of observations `changed`, NaN where there is none; how many change at `fewest`,
        NaN for more than two; and the processor's time of both answers, `seconds` and
        `fewest_seconds`.
    """
    generator = np.random.default_rng(seed)
    steps = generator.integers(len(observations), size=count)
    joints = generator.integers(quadruped.N_JOINTS, size=count)
    rows = []
    with progress_bar(count) as (progress, task):
        for number, (joint, step) in enumerate(zip(joints.tolist(), steps.tolist(), strict=True)):
            way = abs(by) * (1 if number % 2 == 0 else -1)
            question = Question(policy, joint, observations[step], way, room)
            asked = {"joint": quadruped.JOINTS[joint], "step": step, "by": way}
            rows.append(asked | _asked(question))
            progress.update(task, advance=1, text=f"{number + 1} questions")
    return pd.DataFrame(rows)


def _asked(question: Question) -> dict[str, float]:
    start = time.process_time()
    search = search_of(question)
    nearest = search.nearest()
    middle = time.process_time()
    fewest = search.fewest()
    end = time.process_time()
    return {
        "distance": nearest.distance if nearest else np.nan,
        "gap": nearest.gap if nearest else np.nan,
        "changed": len(nearest.changed) if nearest else np.nan,
        "fewest": len(fewest.changed) if fewest else np.nan,
        "seconds": middle - start,
        "fewest_seconds": end - middle,
    }


def summary(table: pd.DataFrame) -> pd.DataFrame:
    """Sums up the questions in one row, under what people call the columns."""
    nearest = table.dropna(subset=["distance"])
    return pd.DataFrame(
        [
            {
                "questions": len(table),
                "answered": len(nearest),
                "largest gap": float(nearest["gap"].max()),
                "median time (s)": float(table["seconds"].median()),
                "longest (s)": float(table["seconds"].max()),
                "median of fewest (s)": float(table["fewest_seconds"].median()),
                "median distance": float(nearest["distance"].median()),
                "observations, nearest": float(nearest["changed"].median()),
                "one is enough": int((table["fewest"] == 1).sum()),
                "two are": int((table["fewest"] == 2).sum()),
                "more": int(table["fewest"].isna().sum()),
            }
        ]
    )


REPETITIONS = 100
"""How often the short replay plays before it stands still."""


@dataclass(frozen=True)
class ExplainCounterfactual(OnePolicy):
    """Ask what a robot would have had to observe for a joint to do otherwise, and let it.

    Attributes:
        joint: The joint.
        step: Control step that the question is about.
        by: By how much the joint's target should have been greater (rad), or smaller, where it is
            negative.
        replayed: The answer that the policy is given: the nearest, or that of the fewest changes.
        lasting: For how many control steps it is given.
        vary_commands: Whether the commanded speed and yaw rate may differ too, within what the gait
            takes.
        command: Commanded speed, yaw rate and rhythm.
        n_steps: Control steps of the rollout that ranges are measured in; more where the step asks
            for it.
        survey: Further questions of random moments and joints, whose times are measured.
        seed: Seed of the sensors' noise, and of the further questions.
        resume: Continue the run that the folder holds.
        output: Folder of the page; by default
            runs/explain/counterfactual/<gait>/<policy>_<joint>_<step>_<by>.
    """

    title: ClassVar[str] = "explain counterfactual"

    joint: str = "FR_calf"
    step: Annotated[int, Ge(0), Lt(180_000)] = 280
    by: float = 0.1
    replayed: Literal["nearest", "fewest"] = "nearest"
    lasting: Count = 1
    vary_commands: bool = False
    command: FixedCommand = field(default_factory=lambda: FixedCommand(speed=0.5))
    n_steps: Steps = 300
    survey: Natural = 0
    seed: Seed = 0
    resume: bool = False
    output: Path | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if abs(self.by) < 1e-6:
            raise InputError(
                f"{self.title}: by is {self.by:g}; give 1e-6 rad or more, or -1e-6 or less"
            )

    def run(self) -> None:
        """Asks, lets the robot walk with the answer, and writes the page."""
        found, name = self.find()
        gait = found.gait
        if name == "expert":
            raise InputError("--policy expert: a network is not searched; name a student")
        controller, joint = found.controller(name), joint_index(self.joint)
        student = controller.policy
        refuse_unsearched(student)
        stem = f"{Path(name).stem}_{self.joint}_{self.step}_{self.by:g}"
        folder = self.output or found.output(self.title) / stem
        inputs = {
            "gait": gait.digest(),
            "expert": controller.expert.digest(),
            "policy": student.digest(),
        }
        with open_run(folder, study=self.title, settings=self, inputs=inputs, resume=self.resume):
            say("rolling out")
            was = self._walk(gait, controller, None)
            self._check_step(was)
            observations = was["observations"]
            names = student.observation_names
            room = Room.of(names, observations, gait if self.vary_commands else None)
            question = Question(student, joint, observations[self.step], self.by, room)
            say(question_in_words(question, self.step))
            answers = answer(question)
            chosen = self._chosen(answers)
            print_table("what would have had to differ", answer_table(question, chosen))
            say(certainty_in_words(chosen))
            offset = chosen.observation - question.observation
            would_be = self._walk(gait, controller, Intervention(offset, self.step, self.lasting))
            futures = Futures(was, would_be, self.step, joint, question.policy.robot)
            outcome = futures.outcome(self.by)
            _write(folder, question, answers, futures)
            metrics = {"outcome": outcome, "question": question_in_words(question, self.step)}
            metrics |= {key: _plain(own) for key, own in vars(answers).items()}
            write_metrics(metrics, folder / "metrics.json")
            page = render_page(
                gait=gait,
                policy_name=Path(name).stem,
                question=question,
                step=self.step,
                answers=vars(answers),
                replayed=self.replayed,
                lasting=self.lasting,
                outcome=outcome,
                futures=futures,
                replay=(folder / "replay.html").read_text(),
                figure=folder / "futures.png",
            )
            write_atomically(folder / "index.html", page)
            if self.survey:
                options = {"count": self.survey, "by": self.by, "seed": self.seed}
                asked = ask_many(student, observations, room, **options)
                write_table(asked, folder / "survey")
                print_table(f"{self.survey} questions", summary(asked))
        say(outcome_in_words(outcome, self.by))
        console.print(f"page written to {folder / 'index.html'}")

    def _walk(
        self, gait: Gait, controller: AlternatingController, intervention: Intervention | None
    ) -> Rollout:
        scenario = Scenario(command=self.command)
        diagram = MakeLocomotion(gait, scenario, policy=controller, intervention=intervention)
        n_steps = max(self.n_steps, self.step + AFTER)
        return roll_one_out(diagram, scenario, n_steps=n_steps, seed=self.seed)

    def _check_step(self, rollout: Rollout) -> None:
        last = len(rollout.time) - 1
        if self.step >= last:
            raise InputError(
                f"--step {self.step}: the rollout ended in a fall at step {last}; name one before"
            )

    def _chosen(self, answers: Answers) -> Answer:
        if self.replayed == "nearest":
            return answers.nearest
        if answers.fewest is None:
            raise InputError(
                "--replayed fewest: no change of one observation or two was found that does what "
                "is asked; replay the nearest, or ask for less with --by"
            )
        return answers.fewest


def _write(folder: Path, question: Question, answers: Answers, futures: Futures) -> None:
    for name, own in vars(answers).items():
        if own is not None:
            write_table(answer_table(question, own), folder / name)
    save_figure(course_figure(futures), folder / "futures")
    was, would_be = futures.shown()
    left = ReplayedRobot("was", "as it was", WAS, was, futures.robot)
    right = ReplayedRobot("other", "given the other observation", WOULD_BE, would_be, futures.robot)
    save_pair_replay(left, right, folder / "replay.html", repetitions=REPETITIONS)


def _plain(own: Answer | None) -> dict[str, Any] | None:
    if own is None:
        return None
    return {
        "observation": np.asarray(own.observation).tolist(),
        "changed": own.changed.tolist(),
        "change_of_target": own.change_of_target,
        "distance": own.distance,
        "bound": own.bound,
        "proved": own.proved,
    }

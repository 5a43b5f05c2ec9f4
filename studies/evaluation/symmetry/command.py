"""`glassgait evaluate symmetry`: whether policies treat left and right alike."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, ClassVar

from annotated_types import Ge

from glassgait.models.errors import InputError
from glassgait.models.settings import Count, Seed, Settings
from glassgait.models.task.gait import load_gait
from glassgait.models.task.symmetry import mirrored_states, reflect_observation
from glassgait.studies.common.console import console, say
from glassgait.studies.common.experts import find_expert
from glassgait.studies.common.figures import save_figure
from glassgait.studies.common.rollouts.seeds import REPORTED_SEEDS
from glassgait.studies.common.run_folder import open_run
from glassgait.studies.common.sweep import (
    Gaits,
    gaits_named,
    refuse_files_of_several,
    tell_refused,
)
from glassgait.studies.common.tables import json_records, print_table, write_metrics, write_table
from glassgait.studies.distillation.collection import collect_alone
from glassgait.studies.evaluation.symmetry.figures import symmetry_figure
from glassgait.studies.evaluation.symmetry.study import measure_symmetry, policies_of, titled


@dataclass(frozen=True)
class Symmetry(Settings):
    """Measure whether an expert and its students treat left and right alike.

    Attributes:
        gait: Names of gaits, or paths of gait files; `all` for every gait that ships. Those whose
            machines favour a side are told and left out.
        n_robots: Robots that the expert is rolled out with.
        n_steps: Control steps of each.
        seed: Seed of all randomness.
        n_samples: Samples of a repeat of importances.
        repeats: Repeats of importances, each with robots drawn anew.
        distillation: Folder of a distillation, for its students; by default those that ship.
        expert: Policy file of the expert, which then has the students of the distillation alone;
            the shipped one by default.
        resume: Continue the run that the folder holds.
        output: Folder of the results; runs/symmetry/<gait> by default. Of several gaits each has
            its folder <gait> in it.
    """

    title: ClassVar[str] = "symmetry"

    gait: Gaits = ("trot",)
    n_robots: Annotated[Count, Ge(2)] = 26
    n_steps: Count = 250
    seed: Seed = REPORTED_SEEDS[0]
    n_samples: Annotated[Count, Ge(2)] = 500
    repeats: Annotated[Count, Ge(2)] = 20
    distillation: Path | None = None
    expert: Path | None = None
    resume: bool = False
    output: Path | None = None

    def run(self) -> None:
        """Runs the study."""
        named = gaits_named(self.gait)
        refuse_files_of_several(named, self.expert, self.distillation)
        names = _with_mirror_image(named)
        if len(named) == 1:
            self._measure(names[0])
            return
        refused = []
        for name in names:
            output = self.output / load_gait(name).name if self.output else None
            try:
                replace(self, gait=(name,), output=output)._measure(name)
            except InputError as error:
                say(f"{name}: refused")
                refused.append(str(error))
        tell_refused(refused, len(names))

    def _measure(self, name: str) -> None:
        gait = load_gait(name)
        states = mirrored_states(gait)
        assert states is not None
        expert = find_expert(gait, self.expert)
        policies = policies_of(expert, self.distillation, shipped=self.expert is None)
        folder = self.output or Path("runs/symmetry") / gait.name
        students = [policy.digest() for kind, policy in policies.items() if kind != "expert"]
        inputs = {
            "gait": gait.digest(),
            "expert": expert.digest(),
            "students": " ".join(students),
        }
        with open_run(
            folder, study="evaluate symmetry", settings=self, inputs=inputs, resume=self.resume
        ):
            say(f"{gait.name}: rolling the expert out")
            episodes = {"n_robots": self.n_robots, "n_steps": self.n_steps, "seed": self.seed}
            samples = collect_alone(gait, expert, expert, **episodes)
            table, left_right = measure_symmetry(
                policies,
                samples,
                reflect_observation(expert.observation_names, states),
                seed=self.seed,
                n_samples=self.n_samples,
                repeats=self.repeats,
            )
            write_table(table, folder / "symmetry")
            write_table(left_right, folder / "left_right")
            metrics = {"symmetry": json_records(table), "left_right": json_records(left_right)}
            write_metrics(metrics, folder / "metrics.json")
            figure = symmetry_figure(table, left_right, gait.name.capitalize())
            save_figure(figure, folder / "symmetry")
        print_table(f"{gait.name}: left and right", titled(table))
        console.print(f"written to {folder}")


def _with_mirror_image(names: Sequence[str]) -> tuple[str, ...]:
    """Returns the gaits whose machines are their own mirror images, and tells the others.

    Raises:
        InputError: if there are none.
    """
    kept = []
    for name in names:
        if mirrored_states(load_gait(name)) is None:
            say(f"{name}: has no mirror image, since its machine favours a side; left out")
        else:
            kept.append(name)
    if not kept:
        raise InputError(
            "--gait: no gait that was named has a mirror image; name another, such as trot"
        )
    return tuple(kept)

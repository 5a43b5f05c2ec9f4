"""What a kind of student is to the studies: a title, settings, a fit, and a line in figures."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, ClassVar, Self

import numpy as np
from joblib import delayed
from numpy.typing import NDArray

from glassgait.models.arrays import Array
from glassgait.models.policies.library import POLICY_CLASSES
from glassgait.models.policies.policy import Policy
from glassgait.models.robots import quadruped
from glassgait.models.robots.library import load_robot
from glassgait.models.robots.robot import Robot
from glassgait.models.settings import Settings, checked
from glassgait.models.task.gait import Gait
from glassgait.models.task.observation import machine_state_entries, overdue
from glassgait.studies.common.parallel.loop import run_parallel

ITSELF = "itself"
"""What settings call the student that collects its own samples, whichever it is."""

RESERVED = ("expert", "students", "of", ITSELF)
"""Names that commands and settings use for something else."""


@dataclass(frozen=True)
class Candidate:
    """Settings to choose from: of those that walk as well, the simplest is taken.

    Attributes:
        title: What tables call them.
        settings: The settings, which leave no choice.
        complexity: How complex the student is that they fit; the order counts alone.
    """

    title: str
    settings: "StudentSettings"
    complexity: tuple[int, ...]


@checked
class StudentSettings(Settings):
    """Settings of a fit; the base of all, and all there is where a fit has no settings.

    Attributes:
        alone_episodes: Episodes, of full length, of a round in which the student acts alone; where
            it is None, the distillation's own, which are shorter.
    """

    alone_episodes: ClassVar[int | None] = None

    def refuse_for(self, gait: Gait) -> None:
        """Refuses what cannot be fitted to a gait, before any of its samples is collected.

        Raises:
            InputError: if it cannot.
        """

    def for_rounds(self) -> Self:
        """Returns the settings of the students that collect samples: small models, soon made."""
        return self

    def for_shuffled_split(self) -> Self:
        """Returns the settings of the fit that is scored by the paper's split."""
        return self

    def candidates(self) -> Sequence[Candidate]:
        """Lists the settings to choose from, if they leave a choice."""
        return ()


@dataclass(frozen=True)
class TrainingSet:
    """What a student is fitted to.

    Attributes:
        observations: Samples (m, n).
        actions: The expert's actions there (m, 12).
        starts: Whether each sample is of an episode's start (m,).
        mirror: State that each state of the machine is in the mirror; None where it favours a side.
    """

    gait: str
    observation_names: tuple[str, ...]
    observations: Array
    actions: Array
    starts: NDArray[np.bool_]
    mirror: tuple[int, ...] | None = None
    robot: Robot = field(default_factory=load_robot)

    def subset(self, index: NDArray[np.int64]) -> "TrainingSet":
        """Returns the samples at an index (k,), which may name one more than once."""
        return replace(
            self,
            observations=self.observations[index],
            actions=self.actions[index],
            starts=self.starts[index],
        )

    def with_overdue(self, weight: int) -> "TrainingSet":
        """Returns the samples, those of robots that wait for a foot as many times as it says."""
        waits = overdue(self.observations, self.observation_names)
        return self.subset(np.repeat(np.arange(len(waits)), np.where(waits, weight, 1)))

    def by_state(self) -> list[NDArray[np.bool_]]:
        """Returns which samples (m,) are in each state of the machine.

        A state that was never visited gets all samples, so that it is fitted like all states
        together.
        """
        visited = self.observations[:, machine_state_entries(self.observation_names)].T > 0.5
        return [mine if mine.any() else np.ones_like(mine) for mine in visited]


@dataclass(frozen=True)
class Student:
    """A kind of student.

    Attributes:
        name: What commands, files and tables' columns call it.
        title: What people call it.
        fit: Fits it: `fit(samples, settings, *, seed, n_jobs)`, joints in parallel.
        color: Colour of its line in figures.
        marker: Marker of its line.
        settings: Its settings by default.
        collector: Name of the student that collects its samples; itself by default.
        fit_models: Fits the library's models behind it, one a joint, like `fit`; None where there
            are none.
        compile: Makes the policy of such models: `compile(gait, names, models, robot)`.
        policy: Class of its policies, where none of the project's holds what it learned. It is
            registered, so that its files can be loaded.
        brevity: Place among the students whose actions are sums of terms, 1 for those that say the
            most in the fewest; None where they are no sums.
        paper_r2: The paper's R² (Table II), by gait; empty where the paper has no such student.

    Raises:
        ValueError: if the name cannot be that of a file and an option.
    """

    name: str
    title: str
    fit: Callable[..., Policy]
    color: str
    marker: str
    settings: StudentSettings = field(default_factory=StudentSettings)
    collector: str | None = None
    fit_models: Callable[..., Sequence[Any]] | None = None
    compile: Callable[..., Policy] | None = None
    policy: type[Policy] | None = None
    brevity: int | None = None
    paper_r2: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not self.name.isidentifier() or self.name in RESERVED:
            raise ValueError(
                f"student {self.name!r}: its name is that of files and options; give one of "
                f"letters, digits and underscores, and none of {', '.join(RESERVED)}"
            )
        if self.policy is not None:
            POLICY_CLASSES[self.policy.kind] = self.policy


def compiled_student(
    name: str,
    title: str,
    fit_joint: Callable[[Array, Array, int, Any], Any],
    compile_models: Callable[..., Policy],
    **options: Any,
) -> Student:
    """Returns a student whose joints are models of a library, which are compiled to a policy.

    Args:
        name: What commands, files and tables' columns call it.
        title: What people call it.
        fit_joint: Fits the model of a joint: `fit_joint(observations, target, seed, settings)`.
        compile_models: Makes the policy: `compile_models(gait, names, models, robot)`.
        options: The other attributes of `Student`.
    """
    fit_models = partial(_fit_models, fit_joint)
    fit = partial(_fit_compiled, fit_models, compile_models)
    return Student(name, title, fit, fit_models=fit_models, compile=compile_models, **options)


def _fit_models(
    fit_joint: Callable[..., Any],
    samples: TrainingSet,
    settings: StudentSettings,
    *,
    seed: int,
    n_jobs: int,
) -> list[Any]:
    jobs = (
        delayed(fit_joint)(samples.observations, samples.actions[:, joint], seed + joint, settings)
        for joint in range(quadruped.N_JOINTS)
    )
    return list(run_parallel(jobs, n_jobs))


def _fit_compiled(
    fit_models: Callable[..., list[Any]],
    compile_models: Callable[..., Policy],
    samples: TrainingSet,
    settings: StudentSettings,
    **options: int,
) -> Policy:
    models = fit_models(samples, settings, **options)
    return compile_models(samples.gait, samples.observation_names, models, samples.robot)

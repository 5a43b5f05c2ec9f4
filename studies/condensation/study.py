"""Making a page of formulas: rounds of samples, each collected with the formulas so far."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from glassgait.models.errors import InputError
from glassgait.models.policies.neural import NeuralPolicy
from glassgait.models.policies.quantities import Vocabulary
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.models.task.gait import Gait
from glassgait.models.task.symmetry import mirrored_states
from glassgait.studies.condensation.config import CondensationConfig
from glassgait.studies.condensation.pursuit import condense
from glassgait.studies.condensation.samples import written_places
from glassgait.studies.distillation.collection import collect
from glassgait.studies.distillation.rounds import Round
from glassgait.studies.distillation.visits import N_SPEEDS
from glassgait.studies.rollouts.config import distilled_speeds
from glassgait.studies.students.dataset import Dataset


def make_page(
    config: CondensationConfig,
    gait: Gait,
    expert: NeuralPolicy,
    folder: Path,
    run: str,
    report: Callable[[str], None],
) -> FormulaPolicy:
    """Collects samples round by round and fits the formulas after each.

    Args:
        config: Settings.
        gait: The gait.
        expert: The expert.
        folder: Where rounds are kept; those that it holds are not collected again.
        run: What tells the run from others.
        report: Called with a line of progress.

    Raises:
        InputError: if there are fewer terms than formulas, or a file of the folder is damaged.
    """
    mirror = mirrored_states(gait) if config.mirrored else None
    names = expert.observation_names
    n_formulas = len(written_places(Vocabulary(names), mirror))
    if config.terms < n_formulas:
        raise InputError(
            f"--terms {config.terms}: the {gait.name} has {n_formulas} formulas with a term each "
            "at least; ask for more terms"
        )
    data, page = None, None
    for number in range(1, config.alone_rounds + 2):
        report(f"round {number} of {config.alone_rounds + 1}: {'formulas' if page else 'expert'}")
        path, of = folder / f"round_{number:02d}.safetensors", f"{run} round {number}"
        if path.exists():
            samples = Dataset.load(path, of=of)
        else:
            samples = _collect(config, gait, expert, page, number)
            samples.save(path, of=of)
        data = samples if data is None else data.union(samples)
        page = condense(data, gait.name, names, mirror, config.terms)
    assert page is not None
    return page


def _collect(
    config: CondensationConfig,
    gait: Gait,
    expert: NeuralPolicy,
    page: FormulaPolicy | None,
    number: int,
) -> Dataset:
    """Lets the formulas act alone, or where there are none yet, the expert."""
    first = 1 + (number - 1) * config.n_robots
    return collect(
        gait,
        expert,
        page or expert,
        plan=Round(number, 0, range(first, first + config.n_robots), config.n_steps),
        speeds=np.linspace(*distilled_speeds(gait), N_SPEEDS),
        worlds=config.worlds,
        generator=np.random.default_rng([config.seed, number]),
    )

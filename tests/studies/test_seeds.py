"""What chooses by rollouts has seeds of its own, and none of them is reported."""

from dataclasses import fields, is_dataclass

import numpy as np
import pytest

from glassgait.models.policies.library import load_expert
from glassgait.models.task.gait import load_gait
from glassgait.models.task.termination import FAILURES
from glassgait.studies.cli import COMMANDS, command_class
from glassgait.studies.common.experiment import REPORTED_SEEDS, SELECTION_SEEDS
from glassgait.studies.common.observers import RolloutLog
from glassgait.studies.common.rollouts import RolloutConfig
from glassgait.studies.distillation import selection

GAIT = load_gait("trot")


@pytest.fixture(scope="module")
def expert():
    return load_expert("trot")


def seeds_of(value):
    """Yields the seeds of all rollouts that settings ask for, by the setting that names them."""
    if isinstance(value, RolloutConfig):
        yield "rollouts", [*value.seeds]
    elif is_dataclass(value):
        for own in fields(value):
            inner = getattr(value, own.name)
            if own.name == "seed":
                yield own.name, [inner]
            yield from seeds_of(inner)


def test_no_reported_seed_selects():
    assert not {*REPORTED_SEEDS} & {*SELECTION_SEEDS}
    assert {seed for seed, _ in selection.SELECTION} <= {*SELECTION_SEEDS}
    assert RolloutConfig().seeds == REPORTED_SEEDS


@pytest.mark.parametrize(
    "command",
    sorted(set(COMMANDS) - {"verify check", "explain formulas", "gait", "robot"}),
)
def test_every_command_keeps_to_the_seeds(command):
    try:
        own = command_class(command)()
    except TypeError:
        pytest.skip("has settings that must be named, and no seed among the others")
    for name, seeds in seeds_of(own):
        if name == "rollouts":
            assert {*seeds} <= {*REPORTED_SEEDS}
        else:
            assert not {*seeds} & {*SELECTION_SEEDS}


def test_candidates_walk_with_seeds_of_selection_alone(expert, monkeypatch):
    walked = []

    def stand(gait, policy, scenario, config):
        walked.extend(config.seeds)
        sizes = {"velocity": (2,), "command": (2,), "action": (12,)}
        sizes["failures"] = (len(FAILURES),)
        flags = ("failures", "expert_acts")
        return RolloutLog(
            **{
                name: np.zeros(
                    (config.n_steps, 2, *sizes.get(name, ())),
                    dtype=bool if name in flags else float,
                )
                for name in RolloutLog.__annotations__
            }
        )

    monkeypatch.setattr(selection, "roll_out", stand)
    # Refinement and distillation choose by this function alone.
    ranked = selection.rank_alone({"a": expert, "b": expert}, GAIT, expert, n_steps=4)
    assert ranked["candidate"].tolist() == ["a", "b"]
    walked = {*walked}
    assert walked and not walked & {*REPORTED_SEEDS}

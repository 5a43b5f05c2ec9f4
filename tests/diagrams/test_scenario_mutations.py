"""Scenario files hurt in every way that a person, an editor or a disk could think of."""

import random
import time
from collections.abc import Callable

import pytest
import yaml

from glassgait.diagrams.scenario import (
    SCENARIO_DIRECTORY,
    Scenario,
    load_scenario,
    scenario_names,
)
from glassgait.models.errors import InputError

LONGEST_MESSAGE = 500
SECONDS = 2.0
HOSTILE = (
    None, True, False, 0, -1, 1, 0.5, 1e300, 5e-324, 10**400, float("nan"), float("inf"), -0.0, "",
    "~", "sap", "1e-5", "x" * 5000, "\x1b[31m", "\u202e", "\ud7ff", "a\nb", [], {}, [[]], [None],
    [0, 1], [1, 0], [0.0] * 500, {"speed": 1}, {"speed_range": [0, 1]}, {"sliders": True},
    {"time_step": 0}, {"friction": {}},
)  # fmt: skip
SNIPPETS = (
    b"\xff", b"\x00", b"\x1b", b"\t", b"!!python/object/apply:os.system ['true']", b"!Pushes ",
    b"&a ", b"*a", b"<<: {a: 1}\n", b"? [a]\n: c\n", b"0b_", b"9" * 5000, b"[" * 3000,
    b"{a: " * 3000, b"- " * 3000, b"'", b'"', b"---\n", b"...\n", b"# ", b".nan", b".inf", b"1e400",
    b"1e-5", b": ", b"- ", b"2020-01-01",
)  # fmt: skip
RENAMED = ("", "station", "Station", "friction", "command", "title", "__class__", "a" * 5000, "\n")


@pytest.mark.parametrize(
    ("seed", "count"), [(0, 100), pytest.param(1, 800, marks=pytest.mark.slow)]
)
def test_damaged_files_are_refused_in_one_sentence_or_are_sound(tmp_path, damaged, seed, count):
    generator, refused = random.Random(seed), 0
    path, again = tmp_path / "hurt.yaml", tmp_path / "again.yaml"
    for case in range(count):
        path.write_bytes(mutated(generator, damaged))
        start = time.monotonic()
        try:
            scenario = load_scenario(path)
        except InputError as error:
            refused += 1
            message = str(error)
            assert message.isprintable(), (case, message)
            assert message.startswith(str(path)), (case, message)
            assert len(message.replace(str(path), "")) < LONGEST_MESSAGE, (case, message)
        else:
            check_sound(scenario)
            again.write_text(yaml.safe_dump(scenario.to_plain()))
            assert load_scenario(again) == scenario
        assert time.monotonic() - start < SECONDS
    # Both ends are met: neither is everything refused, nor is nothing.
    assert count / 4 < refused < count


def check_sound(scenario: Scenario) -> None:
    """Asks a scenario for all that simulators take from it."""
    scenario.randomization()
    continuous = scenario.station.time_step == 0
    assert continuous == (scenario.accuracy is not None)
    assert continuous or 1 <= scenario.station.plant_steps() <= 2000
    assert scenario.title.isprintable()


def mutated(generator: random.Random, damaged: Callable[..., bytes]) -> bytes:
    """Damages a scenario that ships, in one to three ways."""
    data = (SCENARIO_DIRECTORY / f"{generator.choice(scenario_names())}.yaml").read_bytes()
    for _ in range(generator.randint(1, 3)):
        data = damaged(data, generator, SNIPPETS, HOSTILE, RENAMED)
    return data

"""Gait files hurt in every way that a person, an editor or a disk could think of."""

import random
import re
import resource
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest
import yaml

from glassgait.models.errors import InputError
from glassgait.models.robots import quadruped
from glassgait.models.task.drawing import to_mermaid
from glassgait.models.task.formula import STANCES
from glassgait.models.task.gait import GAIT_DIRECTORY, Gait, gait_names, load_gait
from glassgait.models.task.reward_machine import RewardMachine

LONGEST_MESSAGE = 500
SECONDS = 10.0
GROWTH = 300_000
"""Memory that all cases together may take (KiB)."""

HOSTILE = (
    None, True, False, 0, -1, 1e300, 10**400, float("nan"), float("inf"), -0.0, "", " ", "~", "[]",
    "q0", "q0\nq1", "\x00", "\x1b[31m", "\u202e", "\ud7ff", "[bold]", "</script>", '"', "\\", "|",
    "x" * 5000, [], {}, [[]], ["q0"] * 500, [f"q{i}" for i in range(5000)], {"q0": 1}, [None],
    {"from": "q0"}, [{"from": "q0", "to": "q1", "when": "FL"}] * 1000,
)  # fmt: skip
SNIPPETS = (
    b"\xff", b"\xc3\x28", b"\xef\xbb\xbf", b"\x00", b"\x1b", b"\t", b"\r", b"\xe2\x80\xae",
    b"!!python/object/apply:os.system ['true']", b"!!timestamp x", b"!!int x", b"!!binary =",
    b"!!float .", b"!!set {a}", b"!!omap [a]", b"!x ", b"! ", b"&a ", b"*a", b"<<: {a: 1}",
    b"<<: *a",
    b"? [a, b]\n: c\n", b"{a: {b: c}}: 1\n", b"0b_", b"1:" * 5000 + b"1", b"9" * 400, b"9" * 5000,
    b"0x" + b"f" * 3000, b"[" * 3000, b"{a: " * 3000, b"- " * 3000, b"? " * 3000, b"(" * 3000,
    b"~" * 3000, b"FL & " * 3000, b"'", b'"', b'"\\x"', b"|\n", b">\n", b"%YAML 9.9\n---\n",
    b"---\n",
    b"...\n", b"# ", b"2020-01-01", b".nan", b".inf", b"1e400", b"=", b"@", b"`", b":", b": ",
    b"- ",
)  # fmt: skip
FORMULAS = (
    "FL", "~FL", "FL & ~FL", "FL | FR", "(FL", "FL)", "FL FR", "FL & & FR", "fl", "FX", "FL + FR",
    "FL if FR else RL", "lambda: FL", "FL and FR", "FL()", "FL.FR", "FL[FR]", "'FL'", "f'{FL}'",
    "1", "9" * 5000, "0x" + "f" * 900, "\\d", "ＦＬ", "FL\n& FR", "(" * 60 + "FL" + ")" * 60,
    "(" * 5000, "~" * 999 + "FL", "~(" * 40 + "FL" + ")" * 40, "FL|" * 300 + "FR",
    "__import__('os')",
)  # fmt: skip


@pytest.mark.parametrize(("seed", "count"), [(0, 60), pytest.param(1, 800, marks=pytest.mark.slow)])
def test_damaged_files_are_refused_in_one_sentence_or_are_sound(tmp_path, damaged, seed, count):
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    generator = random.Random(seed)
    refused = 0
    for case in range(count):
        path = tmp_path / "hurt.yaml"
        path.write_bytes(mutated(generator, damaged))
        with within(SECONDS):
            try:
                check_sound(load_gait(path))
            except InputError as error:
                refused += 1
                message = str(error)
                assert message.isprintable(), (case, message)
                assert len(message.replace(str(path), "")) < LONGEST_MESSAGE, (case, message)
    # Both ends are met: neither is everything refused, nor is nothing.
    assert count / 2 < refused < count
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < GROWTH


def check_sound(gait: Gait) -> None:
    """Steps the gait's machine in every stance, and draws it."""
    machine = RewardMachine(gait)
    state = machine.initial((len(STANCES),))
    for _ in range(gait.dwell[1] + 1):
        step = machine.step(
            state,
            foot_contact=STANCES,
            foot_height=np.full((len(STANCES), quadruped.N_LEGS), 2.0),
            commanded_dwell=gait.dwell[0],
        )
        state = step.machine
        assert np.all((state.state >= 0) & (state.state < gait.n_states))
        assert np.all(np.isfinite(step.multiplier))
    assert 0 < gait.clearance < 10 and 0 < gait.max_speed < 1000 and 0 < gait.max_yaw_rate < 1000
    assert to_mermaid(gait).count("-->") == len(gait.transitions) + 1


@contextmanager
def within(seconds: float) -> Iterator[None]:
    """Fails where something hangs."""

    def fail(*_: Any) -> None:
        raise TimeoutError(f"more than {seconds} s")

    previous = signal.signal(signal.SIGALRM, fail)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, previous)


def mutated(generator: random.Random, damaged: Callable[..., bytes]) -> bytes:
    """Damages a gait that ships, in one to three ways."""
    data = (GAIT_DIRECTORY / f"{generator.choice(gait_names())}.yaml").read_bytes()
    for _ in range(generator.randint(1, 3)):
        own = generator.choice((None, None, change_formula, rename_state, bomb))
        data = own(data, generator) if own else damaged(data, generator, SNIPPETS, HOSTILE)
    return data


def bomb(data: bytes, generator: random.Random) -> bytes:
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]" for i in range(1, 10)]
    key = generator.choice(("states", "description", "dwell", "bomb"))
    return ("\n".join([*lines, f"{key}: *a9"]) + "\n").encode() + data


def change_formula(data: bytes, generator: random.Random) -> bytes:
    formulas = list(re.finditer(rb"(?<=when: )[^}]*", data))
    if not formulas:
        return data
    place, formula = generator.choice(formulas), repr(generator.choice(FORMULAS)).encode()
    return data[: place.start()] + formula + data[place.end() :]


def rename_state(data: bytes, generator: random.Random) -> bytes:
    name = generator.choice(
        ('"', "a b", "end", "s0", "q|r", "{q", "q;", "/", "[*]", "é", "\\", "#")
    )
    return data.replace(b"q1", yaml.safe_dump(name).splitlines()[0].encode())

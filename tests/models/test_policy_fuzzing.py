"""Damaged and forged policy files of every kind are refused in one sentence, or work."""

import json
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from safetensors.numpy import save

from glassgait.models.errors import InputError
from glassgait.models.policies.additive import AdditivePolicy
from glassgait.models.policies.boosting import BoostedTreesPolicy
from glassgait.models.policies.expression import MAX_TERMS
from glassgait.models.policies.expression_text import parse_expression, variable_names
from glassgait.models.policies.library import POLICY_CLASSES, load_policy
from glassgait.models.policies.linear import LinearPolicy, StatewiseLinearPolicy
from glassgait.models.policies.neural import Network, NeuralPolicy
from glassgait.models.policies.open_loop import OpenLoopPolicy
from glassgait.models.policies.policy import Policy
from glassgait.models.policies.symbolic import (
    FormulaPolicy,
    StatewiseSymbolicPolicy,
    SymbolicPolicy,
)
from glassgait.models.task.observation import ObservationLayout

NAMES = ObservationLayout(2).names
N = len(NAMES)

SECONDS = 10
"""Time that a file may take."""

MESSAGE_LENGTH = 500
"""Characters that a refusal may have."""

# Kinds that say whether a file must be refused, must be taken, or may be either.
BAD, GOOD, EITHER = "must be refused", "must be taken", "either"

NESTED = "@nested@"
"""Stands for lists that are nested deeper than Python writes them."""

JUNK = (
    None,
    True,
    0,
    -1,
    10**400,
    1e308,
    float("nan"),
    float("inf"),
    "",
    "x" * 100_000,
    "two\nlines",
    "\ud800",
    [],
    [0],
    [["x0"]],
    {},
    {"a": {"b": [1]}},
    NESTED,
)

BAD_FORMULAS = (
    "tanh(" * 10_000 + "x0" + ")" * 10_000,
    "tanh(" * 150 + "x0" + ")" * 150,
    "(" * 10_000,
    "-" * 10_000 + "x0",
    "+".join(["x0"] * 20_000),
    "+".join(["x0"] * 500),
    "1" * 400,
    "1" * 5000,
    "1e999",
    "-1e999",
    "nan",
    "inf",
    "1j",
    "x999",
    "x0 ** 1000",
    "9 ** 9 ** 9",
    "__import__('os').getpid()",
    "x0\0",
    "\ud800",
    "",
    "x0 if x1 else x2",
    5,
    None,
    ["x0"],
)

GOOD_FORMULAS = (
    " * ".join(f"(x{i} + {i + 1}.5)" for i in range(22)),
    "*".join(["(x0 - 2.5)"] * 90),
    "tanh(" * 90 + "x0" + ")" * 90,
    "1 / x0",
    "log(x0 - x0)",
    "1e308 * 1e308 * x0",
)


def neural(generator: np.random.Generator) -> Policy:
    def network(*sizes: int) -> Network:
        shapes = list(zip(sizes[1:], sizes[:-1], strict=True))
        return Network(
            # Single precision is what files hold.
            tuple(
                generator.normal(size=shape).astype(np.float32).astype(float) for shape in shapes
            ),
            tuple(np.zeros(n_out) for n_out, _ in shapes),
        )

    return NeuralPolicy("trot", NAMES, network(N, 8, 6, 12), network(N - 7, 8, 7))


def trees(generator: np.random.Generator) -> Policy:
    thresholds = generator.normal(size=(12, 4, 7))
    thresholds[:, :, 3] = np.inf
    return BoostedTreesPolicy(
        "trot",
        NAMES,
        features=generator.integers(N, size=(12, 4, 7), dtype=np.int32),
        thresholds=thresholds,
        leaves=generator.normal(size=(12, 4, 8)),
        intercepts=generator.normal(size=12),
        importances=generator.uniform(size=(12, N)),
    )


def additive(generator: np.random.Generator) -> Policy:
    cuts = np.sort(generator.normal(size=(N, 6)))
    cuts[::2, 4:] = np.inf
    return AdditivePolicy(
        "trot",
        NAMES,
        cuts=cuts,
        pair_cuts=cuts[:, 1:4],
        tables=generator.normal(size=(12, N, 7)),
        pairs=generator.integers(N, size=(5, 2)),
        pair_joints=generator.integers(12, size=5),
        pair_tables=generator.normal(size=(5, 4, 4)),
        deviations=generator.uniform(size=(12, N, 7)),
        pair_deviations=generator.uniform(size=(5, 4, 4)),
        intercepts=generator.normal(size=12),
    )


def formulas(generator: np.random.Generator) -> list:
    texts = [f"0.5*x{j} + tanh(5.0*x40 - 2.0)*({j}.25*x3 - x{j + 1}) - 0.1" for j in range(12)]
    return [parse_expression(text, variable_names(N)) for text in texts]


MAKERS: dict[str, Callable[[np.random.Generator], Policy]] = {
    "neural": neural,
    "open_loop": lambda g: OpenLoopPolicy("trot", NAMES, g.normal(size=(2, 5, 12))),
    "linear": lambda g: LinearPolicy("trot", NAMES, g.normal(size=(12, N)), g.normal(size=12)),
    "statewise_linear": lambda g: StatewiseLinearPolicy(
        "trot", NAMES, g.normal(size=(2, 12, N)), g.normal(size=(2, 12))
    ),
    "boosted_trees": trees,
    "additive": additive,
    "symbolic": lambda g: SymbolicPolicy("trot", NAMES, formulas(g)),
    "statewise_symbolic": lambda g: StatewiseSymbolicPolicy("trot", NAMES, [formulas(g)] * 2),
}

Contents = tuple[dict[str, np.ndarray], dict[str, Any]]


@cache
def sound(kind: str) -> Policy:
    return MAKERS[kind](np.random.default_rng(1))


def contents_of(kind: str) -> Contents:
    policy = sound(kind)
    arrays, values = policy.to_arrays()
    header = {
        "format": 1,
        "kind": kind,
        "gait": "trot",
        "observation_names": list(NAMES),
        "values": json.loads(json.dumps(values)),
    }
    return {name: np.array(array) for name, array in arrays.items()}, header


def to_bytes(arrays: dict[str, np.ndarray], header: Any) -> bytes:
    # Without the checksum that tells most damage at once.
    text = json.dumps(header).replace(f'"{NESTED}"', "[" * 5000 + "]" * 5000)
    whole = {name: np.ascontiguousarray(array) for name, array in arrays.items()}
    return save(whole, metadata={"header": text})


# Mutations: each changes contents in place, or returns bytes, and says what must become of it.


def damage_bytes(generator: np.random.Generator, contents: Contents) -> tuple[str, str, bytes]:
    data = bytearray(to_bytes(*contents))
    # Most bytes are of the arrays; half of the damage goes to what stands before them.
    end = len(data) if generator.random() < 0.5 else min(len(data), 3000)
    for at in generator.integers(end, size=generator.integers(1, 9)):
        data[at] = generator.integers(256)
    return "bytes changed", EITHER, bytes(data)


def cut_bytes(generator: np.random.Generator, contents: Contents) -> tuple[str, str, bytes]:
    data = to_bytes(*contents)
    return "cut short", BAD, data[: generator.integers(len(data))]


def forge_header(generator: np.random.Generator, contents: Contents) -> tuple[str, str]:
    header = contents[1]
    key = generator.choice(list(header))
    value = pick(generator, JUNK)
    header[key] = value
    harmless = key == "values" and isinstance(value, dict) and header["kind"] in ARRAY_KINDS
    named = key == "gait" and isinstance(value, str) and 0 < len(value) < 80 and "\n" not in value
    return f"key {key} is {value!r:.60}", EITHER if harmless or named else BAD


def drop_key(generator: np.random.Generator, contents: Contents) -> tuple[str, str]:
    key = generator.choice(list(contents[1]))
    del contents[1][key]
    return f"without key {key}", BAD


def add_key(generator: np.random.Generator, contents: Contents) -> tuple[str, str]:
    contents[1]["made by"] = pick(generator, JUNK[:-1])
    return "with a key of its own", GOOD


def forge_names(generator: np.random.Generator, contents: Contents) -> tuple[str, str]:
    names = contents[1]["observation_names"]
    at = int(generator.integers(N))
    match generator.integers(5):
        case 0:
            names[at] = names[at - 1]
            return f"observation {at} twice", BAD
        case 1:
            names.append("Command X")
            return "first observation at the end again", BAD
        case 2:
            names[at] = pick(generator, [*(x for x in JUNK if not isinstance(x, str)), "", "\n"])
            return f"observation {at} is {names[at]!r:.60}", BAD
        case 3:
            del names[at]
            return f"without observation {at}", EITHER if "values" in contents[1] else BAD
        case _:
            first = names.index("RM State 0")
            names[first], names[first + 1] = names[first + 1], names[first]
            return "states of the machine the other way round", BAD


def drop_array(generator: np.random.Generator, contents: Contents) -> tuple[str, str]:
    name = generator.choice(list(contents[0]))
    del contents[0][name]
    return f"without array {name}", BAD


def add_array(generator: np.random.Generator, contents: Contents) -> tuple[str, str]:
    name = pick(generator, ["more", "actor.9.weight", "x" * 1000, "a\nb"])
    contents[0][name] = np.zeros(3)
    return f"with an array {name!r:.60}", BAD


def reshape_array(generator: np.random.Generator, contents: Contents) -> tuple[str, str]:
    name = generator.choice(list(contents[0]))
    array = contents[0][name]
    match generator.integers(4):
        case 0:
            changed = array[None]
        case 1:
            changed = array.reshape(-1) if array.ndim > 1 else array.reshape(1, -1, 1)
        case 2:
            changed = np.concatenate([array, array])
        case _:
            changed = array[: generator.integers(len(array))]
    contents[0][name] = changed
    return f"array {name} of shape {changed.shape}", BAD


def recast_array(generator: np.random.Generator, contents: Contents) -> tuple[str, str]:
    name = generator.choice(list(contents[0]))
    array = contents[0][name]
    good = ("f2", "f4", "f8") if array.dtype.kind == "f" else ("u1", "u2", "i4", "i8")
    dtype = pick(generator, ["f2", "f4", "f8", "u1", "u2", "i4", "i8", "u8", "?"])
    with np.errstate(invalid="ignore"):
        contents[0][name] = array.astype(dtype)
    return f"array {name} of type {dtype}", GOOD if dtype in good else BAD


def forge_entry(generator: np.random.Generator, contents: Contents) -> tuple[str, str]:
    name = generator.choice(list(contents[0]))
    array = contents[0][name]
    at = tuple(generator.integers(size) for size in array.shape)
    if array.dtype.kind == "f":
        value = pick(generator, [np.nan, np.inf, -np.inf, 1e35, -1e35])
        infinite = name in ("thresholds", "cuts", "pair_cuts") and value in (np.inf, 1e35)
        array[at] = value
        return f"{value} in array {name}", EITHER if infinite else BAD
    array[at] = pick(generator, [-1, 51, 300, 2**31 - 1, -(2**31)])
    return f"{array[at]} in array {name}", BAD


def forge_formula(generator: np.random.Generator, contents: Contents) -> tuple[str, str]:
    own = contents[1]["values"]["formulas"]
    own = own[generator.integers(2)] if isinstance(own[0], list) else own
    at = int(generator.integers(12))
    match generator.integers(4):
        case 0:
            own[at] = pick(generator, BAD_FORMULAS)
            return f"formula {own[at]!r:.60}", BAD
        case 1:
            own[at] = pick(generator, GOOD_FORMULAS)
            return f"formula {own[at]!r:.60}", GOOD
        case 2:
            del own[at]
            return "11 formulas", BAD
        case _:
            place = int(generator.integers(len(own[at])))
            sign = pick(generator, list("()+-*/^x0.e9,#'\\\n["))
            own[at] = own[at][:place] + sign + own[at][place + 1 :]
            return f"formula {own[at]!r:.60}", EITHER


def pick(generator: np.random.Generator, values: Any) -> Any:
    return values[generator.integers(len(values))]


ANYWHERE = (damage_bytes, cut_bytes, forge_header, drop_key, add_key, forge_names, add_array)
IN_ARRAYS = (drop_array, reshape_array, recast_array, forge_entry)
FORMULA_KINDS = tuple(k for k, c in POLICY_CLASSES.items() if issubclass(c, FormulaPolicy))
ARRAY_KINDS = tuple(kind for kind in POLICY_CLASSES if kind not in FORMULA_KINDS)


def forged(kind: str, generator: np.random.Generator) -> tuple[str, str, bytes]:
    """Returns what was done to a sound file, what must become of it, and the file."""
    contents = contents_of(kind)
    own = (forge_formula,) * 4 if kind in FORMULA_KINDS else IN_ARRAYS * 2
    mutation = pick(generator, (*ANYWHERE, *own))
    told, verdict, *data = mutation(generator, contents)
    return told, verdict, data[0] if data else to_bytes(*contents)


@contextmanager
def time_limit(seconds: int) -> Iterator[None]:
    def stop(*_: Any) -> None:
        raise TimeoutError(f"took more than {seconds} s")

    before = signal.signal(signal.SIGALRM, stop)
    signal.alarm(seconds)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def observations() -> np.ndarray:
    generator = np.random.default_rng(3)
    rows = generator.normal(size=(5, N))
    first = NAMES.index("RM State 0")
    rows[:, first : first + 2] = np.eye(2)[generator.integers(2, size=5)]
    return rows


def load_and_use(path: Path) -> None:
    """Loads a policy, acts with it and splits its actions."""
    policy = load_policy(path)
    rows = observations()[:, : len(policy.observation_names)]
    action = policy(rows)
    assert action.shape == (5, 12)
    assert action.dtype == np.float64
    assert policy(rows[0]).shape == (12,)
    assert policy.kind in FORMULA_KINDS or np.isfinite(action).all()
    explains = policy.kind not in ("neural", "open_loop", "boosted_trees")
    for joint in (0, "FL_calf") if explains else ():
        parts = policy.explain(rows, joint)
        assert parts.values.shape == (5, len(parts.terms))
        assert len(parts.terms) <= 2 * (MAX_TERMS + N)


def refusal_of(path: Path) -> str | None:
    try:
        with time_limit(SECONDS):
            load_and_use(path)
    except InputError as error:
        return str(error)
    return None


def check(kind: str, seed: int, path: Path) -> None:
    told, verdict, data = forged(kind, np.random.default_rng(seed))
    path.write_bytes(data)
    where = f"{kind}, seed {seed}: {told}"
    try:
        refusal = refusal_of(path)
    except Exception as error:
        raise AssertionError(f"{where} ended in a {type(error).__name__}: {error}") from error
    if refusal is None:
        assert verdict != BAD, f"{where} was taken"
    else:
        assert verdict != GOOD, f"{where} was refused: {refusal}"
        assert len(refusal) < MESSAGE_LENGTH, where
        assert "\n" not in refusal, where
        assert refusal.startswith(str(path)), where


@pytest.mark.parametrize("kind", MAKERS)
def test_sound_files_are_taken(kind, tmp_path):
    path = tmp_path / "policy.safetensors"
    path.write_bytes(to_bytes(*contents_of(kind)))
    load_and_use(path)
    np.testing.assert_array_equal(load_policy(path)(observations()), sound(kind)(observations()))


@pytest.mark.parametrize("kind", MAKERS)
def test_damaged_and_forged_files_are_refused_or_work(kind, tmp_path):
    for seed in range(40):
        check(kind, seed, tmp_path / "policy.safetensors")


@pytest.mark.slow
@pytest.mark.parametrize("kind", MAKERS)
def test_many_damaged_and_forged_files_are_refused_or_work(kind, tmp_path):
    for seed in range(1000, 1400):
        check(kind, seed, tmp_path / "policy.safetensors")


def test_every_kind_is_forged():
    assert set(MAKERS) == set(POLICY_CLASSES)

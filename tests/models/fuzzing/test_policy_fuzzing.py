"""Damaged and forged policy files of arrays are refused in one sentence, or work."""

import json
from typing import Any

import numpy as np
import pytest
from safetensors.numpy import save

from glassgait.models.policies.library import load_policy
from glassgait.models.policies.policy import Policy
from glassgait.models.task.observation import ObservationLayout

NAMES = ObservationLayout(2).names
N = len(NAMES)

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

Contents = tuple[dict[str, np.ndarray], dict[str, Any]]


def contents_of(policy: Policy) -> Contents:
    arrays, values = policy.to_arrays()
    header = {
        "format": 1,
        "kind": policy.kind,
        "gait": "trot",
        "observation_names": list(NAMES),
        "values": json.loads(json.dumps(values)),
    }
    return {name: np.array(array) for name, array in arrays.items()}, header


def to_bytes(arrays: dict[str, np.ndarray], header: Any) -> bytes:
    # Without the checksum that shows most damage at once.
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
    harmless = key == "values" and isinstance(value, dict)
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


def pick(generator: np.random.Generator, values: Any) -> Any:
    return values[generator.integers(len(values))]


ANYWHERE = (damage_bytes, cut_bytes, forge_header, drop_key, add_key, forge_names, add_array)
IN_ARRAYS = (drop_array, reshape_array, recast_array, forge_entry)
ARRAY_KINDS = (
    "neural",
    "linear",
    "statewise_linear",
    "boosted_trees",
    "additive",
)


def forged(policy: Policy, generator: np.random.Generator) -> tuple[str, str, bytes]:
    """Returns what was done to a sound file, what must become of it, and the file."""
    contents = contents_of(policy)
    mutation = pick(generator, (*ANYWHERE, *IN_ARRAYS * 2))
    message, verdict, *data = mutation(generator, contents)
    return message, verdict, data[0] if data else to_bytes(*contents)


@pytest.fixture
def check(sound_policies, assert_refused_or_works):
    def run(kind: str, seed: int) -> None:
        message, verdict, data = forged(sound_policies[kind], np.random.default_rng(seed))
        where = f"{kind}, seed {seed}: {message}"
        assert_refused_or_works(data, where, verdict != BAD, verdict != GOOD)

    return run


@pytest.mark.parametrize("kind", ARRAY_KINDS)
def test_sound_files_are_taken(kind, tmp_path, sound_policies, load_and_use, samples):
    path, policy = tmp_path / "policy.safetensors", sound_policies[kind]
    path.write_bytes(to_bytes(*contents_of(policy)))
    load_and_use(path)
    observations, _ = samples(5, seed=3)
    np.testing.assert_array_equal(load_policy(path)(observations), policy(observations))


@pytest.mark.parametrize("kind", ARRAY_KINDS)
def test_damaged_and_forged_files_are_refused_or_work(kind, check):
    for seed in range(40):
        check(kind, seed)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ARRAY_KINDS)
def test_many_damaged_and_forged_files_are_refused_or_work(kind, check):
    for seed in range(1000, 1400):
        check(kind, seed)

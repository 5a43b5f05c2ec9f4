"""Damaged and forged policy files with arrays are refused in one sentence, or work."""

import json
from typing import Any

import numpy as np
import pytest
from safetensors.numpy import save

from glassgait.models.errors import InputError
from glassgait.models.policies.library import load_policy
from glassgait.models.policies.policy import Policy
from glassgait.models.task.observation import ObservationLayout

NAMES = ObservationLayout(2).names

BAD, EITHER = "must be refused", "either"

LONGEST_REFUSAL = 500

NESTED = "@nested@"
"""Placeholder for lists that are nested deeper than Python can write them."""

JUNK = (
    *(None, True, 0, -1, 10**400, 1e308, float("nan"), [], [0], [["x0"]], {}, {"a": {"b": [1]}}),
    *("", "x" * 100_000, "two\nlines", "\ud800", NESTED),
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
    # Leave out the checksum, which would reveal most damage at once.
    text = json.dumps(header).replace(f'"{NESTED}"', "[" * 5000 + "]" * 5000)
    whole = {name: np.ascontiguousarray(array) for name, array in arrays.items()}
    return save(whole, metadata={"header": text})


# Mutations: each changes arrays or header in place, and returns a description and the expected
# verdict.


def forge_header(generator: np.random.Generator, contents: Contents) -> tuple[str, str]:
    header = contents[1]
    key = generator.choice(list(header))
    value = pick(generator, JUNK)
    header[key] = value
    harmless = key == "values" and isinstance(value, dict)
    named = key == "gait" and isinstance(value, str) and 0 < len(value) < 80 and "\n" not in value
    return f"key {key} is {value!r:.60}", EITHER if harmless or named else BAD


def drop_array(generator: np.random.Generator, contents: Contents) -> tuple[str, str]:
    name = generator.choice(list(contents[0]))
    del contents[0][name]
    return f"without array {name}", BAD


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


MUTATIONS = (forge_header, drop_array, reshape_array, forge_entry)


def damaged(generator: np.random.Generator, data: bytes) -> tuple[str, str, bytes]:
    """Truncates a file, or changes some of its bytes."""
    if generator.random() < 0.5:
        return "cut short", BAD, data[: generator.integers(len(data))]
    changed = bytearray(data)
    # Most bytes belong to arrays, so half of the damage is limited to the part before them.
    end = len(data) if generator.random() < 0.5 else min(len(data), 3000)
    for at in generator.integers(end, size=generator.integers(1, 9)):
        changed[at] = generator.integers(256)
    return "bytes changed", EITHER, bytes(changed)


def forged(generator: np.random.Generator, policy: Policy) -> tuple[str, str, bytes]:
    """Mutates a valid file; returns a description, the expected verdict and the file."""
    contents = contents_of(policy)
    if generator.random() < 0.2:
        return damaged(generator, to_bytes(*contents))
    return *pick(generator, MUTATIONS)(generator, contents), to_bytes(*contents)


@pytest.fixture(params=["neural", "linear", "per_state", "boosted_trees", "additive"])
def policy(request) -> Policy:
    """A valid policy of each kind that is saved as arrays."""
    generator = np.random.default_rng(1)
    match request.param:
        case "boosted_trees":
            return request.getfixturevalue("random_trees")(generator, rounded=False)
        case "additive":
            return request.getfixturevalue("random_additive")(generator, n_pairs=5)
        case name:
            return request.getfixturevalue(name)


@pytest.fixture
def act(samples):
    """Loads a policy, acts with it and splits its actions."""

    def run(path):
        policy = load_policy(path)
        rows = samples(5, seed=3)[0][:, : len(policy.observation_names)]
        action = policy(rows)
        assert action.shape == (5, 12)
        assert not np.isinf(action).any()
        for joint in (0, "FL_calf") if policy.kind not in ("neural", "boosted_trees") else ():
            parts = policy.explain(rows, joint)
            assert parts.values.shape == (5, len(parts.terms))
        return action

    return run


@pytest.mark.timeout(60)
@pytest.mark.parametrize("seeds", [range(40), pytest.param(range(99, 400), marks=pytest.mark.slow)])
def test_damaged_and_forged_files_are_refused_or_work(seeds, policy, act, tmp_path):
    path = tmp_path / "policy.safetensors"
    for seed in seeds:
        message, verdict, data = forged(np.random.default_rng(seed), policy)
        where = f"seed {seed}: {message}"
        path.write_bytes(data)
        try:
            act(path)
        except InputError as error:
            refusal = str(error)
            assert refusal.startswith(str(path)), where
            assert len(refusal) < LONGEST_REFUSAL and "\n" not in refusal, where
        except Exception as error:
            raise AssertionError(f"{where} ended in a {type(error).__name__}: {error}") from error
        else:
            assert verdict != BAD, f"{where} was taken"

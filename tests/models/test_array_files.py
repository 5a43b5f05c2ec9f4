"""Files of arrays with a header: they come back, and damage is noticed."""

import json
import math
import random
import struct
import subprocess
import sys

import numpy as np
import pytest

from glassgait.models.errors import InputError
from glassgait.models.files import (
    digest,
    load_arrays,
    save_arrays,
)

ARRAYS = {"a": np.arange(6.0).reshape(2, 3).T, "flags": np.array([True, False])}


HEADER = {"name": "x", "big": 2**100, "none": math.nan}


def file_of(header: str, dtype: str = "F64", n_bytes: int = 8) -> bytes:
    """Writes a safetensors file by hand."""
    array = {"dtype": dtype, "shape": [1], "data_offsets": [0, n_bytes]}
    text = json.dumps({"__metadata__": {"header": header}, "a": array}).encode()
    return struct.pack("<Q", len(text)) + text + bytes(n_bytes)


def test_arrays_and_header_come_back(tmp_path):
    path = tmp_path / "deep" / "file.safetensors"
    arrays = {
        "a": np.arange(6.0).reshape(2, 3).T,
        "flags": np.array([True, False]),
        "none": np.zeros((0, 3), dtype=np.float32),
        "foreign": np.array([1, 2], dtype=">i4"),
    }
    save_arrays(path, arrays, {"name": "x", "big": 2**100})
    found, header = load_arrays(path)
    assert list(found) == sorted(arrays)
    for name, value in arrays.items():
        np.testing.assert_array_equal(found[name], value)
    assert header == {"name": "x", "big": 2**100}


def test_equal_arrays_give_equal_files(tmp_path):
    program = (
        "import sys; from pathlib import Path; import numpy as np\n"
        "from glassgait.models.files import save_arrays\n"
        "save_arrays(Path(sys.argv[1]), {'b': np.ones(2), 'a': np.ones(3)}, {'k': 1, 'j': 2})"
    )
    paths = [tmp_path / f"{i}.safetensors" for i in range(3)]
    for path in paths:
        subprocess.run([sys.executable, "-c", program, str(path)], check=True)
    assert len({digest(path) for path in paths}) == 1


def test_files_of_before_the_checksum_are_read(tmp_path):
    path = tmp_path / "old.safetensors"
    path.write_bytes(file_of('{"name": "x"}'))
    arrays, header = load_arrays(path)
    assert (arrays["a"].tolist(), header) == ([0.0], {"name": "x"})


def test_missing_and_damaged_files_are_refused(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        load_arrays(tmp_path / "none.safetensors")
    damaged = tmp_path / "damaged.safetensors"
    save_arrays(damaged, {"a": np.zeros(100)}, {})
    damaged.write_bytes(damaged.read_bytes()[:200])
    with pytest.raises(InputError, match="damaged"):
        load_arrays(damaged)


def test_every_cut_and_every_flipped_byte_of_arrays_is_noticed(tmp_path):
    path = tmp_path / "file.safetensors"
    save_arrays(path, ARRAYS, HEADER)
    whole, (arrays, header) = path.read_bytes(), load_arrays(path)
    generator = random.Random(0)
    noticed = 0
    for i in range(len(whole)):
        flipped = bytearray(whole)
        flipped[i] ^= generator.choice((1, 4, 128, 255))
        for hurt in (whole[:i], bytes(flipped)):
            path.write_bytes(hurt)
            try:
                found, seen = load_arrays(path)
            except InputError as error:
                noticed += 1
                assert str(error).startswith(f"{path}: is damaged")
            else:
                # The name of the checksum itself was hurt, and nothing else.
                assert repr(header)[:-1] in repr(seen)
                assert found.keys() == arrays.keys()
                assert all(np.array_equal(found[name], arrays[name]) for name in arrays)
    assert noticed >= 2 * len(whole) - len("sha256")


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"\xff" * 100,
        file_of("[]"),
        file_of("null"),
        file_of('"text"'),
        file_of("{"),
        file_of("[" * 100_000),
        file_of('{"a": ' + "9" * 5000 + "}"),
        file_of('{"sha256": 7}'),
        file_of("{}", dtype="BF16", n_bytes=2),
        file_of("{}", dtype="F8_E4M3", n_bytes=1),
        file_of("{}", dtype="F8_E5M2", n_bytes=1),
        file_of("{}", n_bytes=2**20)[: -(2**19)],
        struct.pack("<Q", 2**62) + b"{}",
        struct.pack("<Q", 2) + b"{}",
    ],
)
def test_containers_of_other_kinds_are_refused(tmp_path, data):
    path = tmp_path / "file.safetensors"
    path.write_bytes(data)
    with pytest.raises(InputError, match="is damaged") as raised:
        load_arrays(path)
    assert str(path) in str(raised.value)
    assert len(str(raised.value)) < 300

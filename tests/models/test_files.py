"""Files that are whole or not there."""

import numpy as np
import pytest

from models.errors import InputError
from models.files import load_arrays, save_arrays, write_atomically


def test_arrays_and_header_come_back(tmp_path):
    path = tmp_path / "deep" / "file.safetensors"
    arrays = {"a": np.arange(6.0).reshape(2, 3).T, "flags": np.array([True, False])}
    save_arrays(path, arrays, {"name": "x", "big": 2**100})
    found, header = load_arrays(path)
    np.testing.assert_array_equal(found["a"], arrays["a"])
    np.testing.assert_array_equal(found["flags"], arrays["flags"])
    assert header == {"name": "x", "big": 2**100}


def test_a_failed_write_leaves_the_old_file_and_nothing_else(tmp_path):
    path = tmp_path / "file"
    write_atomically(path, "old")
    with pytest.raises(TypeError):
        write_atomically(path, None)  # type: ignore[arg-type]
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_missing_and_damaged_files_are_refused(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        load_arrays(tmp_path / "none.safetensors")
    damaged = tmp_path / "damaged.safetensors"
    save_arrays(damaged, {"a": np.zeros(100)}, {})
    damaged.write_bytes(damaged.read_bytes()[:200])
    with pytest.raises(InputError, match="damaged"):
        load_arrays(damaged)

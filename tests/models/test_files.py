"""Atomic files, records, texts, YAML and arrays."""

import errno
import math
import os
import random
from pathlib import Path

import numpy as np
import pytest

from glassgait.models.errors import InputError
from glassgait.models.files import (
    digest,
    load_arrays,
    read_record,
    read_text,
    read_yaml,
    resolve_paths,
    save_arrays,
    write_atomically,
    write_record,
)


@pytest.mark.parametrize(
    ("failure", "raised"),
    [
        (OSError(errno.ENOSPC, "full"), InputError),
        (OSError(errno.EIO, "broken"), InputError),
        (KeyboardInterrupt(), KeyboardInterrupt),
    ],
)
def test_a_failed_write_leaves_the_old_file_and_nothing_else(
    tmp_path, monkeypatch, failure, raised
):
    path = tmp_path / "file"
    write_atomically(path, "old")

    def fail(_: int) -> None:
        raise failure

    monkeypatch.setattr(os, "fsync", fail)
    with pytest.raises(raised):
        write_atomically(path, "new" * 1000)
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_places_that_cannot_be_written_are_refused_in_one_sentence(tmp_path):
    file, folder, pipe = (tmp_path / name for name in ("file", "folder", "pipe"))
    file.write_text("kept")
    folder.mkdir()
    os.mkfifo(pipe)
    for path in (file / "below", file / "far" / "below", folder, pipe, tmp_path / ("x" * 300)):
        with pytest.raises(InputError, match=r"cannot be written .*; choose another") as raised:
            write_atomically(path, "new")
        assert "\n" not in str(raised.value)
    assert file.read_text() == "kept"
    assert sorted(tmp_path.rglob("*")) == [file, folder, pipe]


def test_folders_pipes_and_missing_files_are_refused(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    readers = (load_arrays, read_record, read_text, read_yaml, digest)
    for path, why in ((tmp_path, "regular file"), (tmp_path / "pipe", "regular file")):
        for read in readers:
            with pytest.raises(InputError, match=f"^{path}: cannot be read .*{why}"):
                read(path)
    for read in readers:
        with pytest.raises(InputError, match="no such file"):
            read(tmp_path / "none")


def test_records_come_back_with_every_digit_and_know_their_run(tmp_path):
    path = tmp_path / "record.json"
    values = {"scores": [0.1 + 0.2, math.nan, math.inf, -0.0, 5e-324, 2**70], "text": 'é "\n\ud800'}
    write_record(path, values, of="run a")
    assert repr(read_record(path, of="run a")) == repr(values)
    with pytest.raises(InputError, match="another run"):
        read_record(path, of="run b")


@pytest.mark.parametrize("text", ["", "[]", "1", "{}", '{"of": "x"', "[" * 100_000])
def test_damaged_records_are_refused(tmp_path, text):
    path = tmp_path / "record.json"
    path.write_text(text)
    with pytest.raises(InputError, match="damaged"):
        read_record(path)


@pytest.mark.parametrize(
    ("text", "values"),
    [("a: [1, 2.5, yes, ~, b]", {"a": [1, 2.5, True, None, "b"]}), ("2020-01-01", "2020-01-01")],
)
def test_yaml_holds_plain_values(tmp_path, text, values):
    path = tmp_path / "file.yaml"
    path.write_text(text)
    assert read_yaml(path) == values


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("a: &x [1]\nb: *x", "line 1: anchors and aliases"),
        ("a: 1\nb: !!python/object:os.system x", "line 2: tags"),
        ("a: {b: 1, b: 2}", "line 1: key 'b' is given twice"),
        ("[1]: 2", "line 1: a key is not text"),
        ("a: [", "line 1"),
        ("a: " + "9" * 5000, "number that cannot be read"),
        ("[" * 5000, "nested too deep"),
        ("a: \x07", "control character"),
        ("a: " + "b" * 100_000, "larger than 100,000 bytes"),
    ],
)
def test_yaml_that_is_more_than_plain_values_is_refused(tmp_path, text, why):
    path = tmp_path / "file.yaml"
    path.write_text(text)
    with pytest.raises(InputError, match=why) as raised:
        read_yaml(path)
    assert str(raised.value).startswith(f"{path}: ") and "\n" not in str(raised.value)


def test_paths_in_a_file_of_settings_are_relative_to_it():
    values = {"gait": ["trot", "hop.yaml"], "title": "a.yaml", "a": {"robot": "/r.yaml"}}
    found = values | {"gait": ["trot", str(Path("in/hop.yaml").resolve())]}
    assert resolve_paths(Path("here/../in/file.yaml"), values) == found


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


def test_every_cut_and_every_flipped_byte_of_arrays_is_noticed(tmp_path):
    path = tmp_path / "file.safetensors"
    save_arrays(path, {"a": np.arange(3.0), "flags": np.array([True])}, {"name": "x"})
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
                # Only the name of the checksum was damaged.
                assert repr(header)[:-1] in repr(seen)
                assert all(np.array_equal(found[name], arrays[name]) for name in arrays)
    assert noticed >= 2 * len(whole) - len("sha256")

"""Files that are whole or not there, records, and texts."""

import errno
import hashlib
import math
import os
import random
import subprocess
import sys
from pathlib import Path

import pytest

from glassgait.models.errors import InputError
from glassgait.models.files import (
    digest,
    load_arrays,
    read_record,
    read_text,
    read_yaml,
    remove_litter,
    write_atomically,
    write_record,
)


@pytest.fixture(scope="module")
def dead():
    """Number of a process that lives no more."""
    process = subprocess.Popen([sys.executable, "-c", ""])
    process.wait()
    return process.pid


def test_a_failed_write_leaves_the_old_file_and_nothing_else(tmp_path):
    path = tmp_path / "file"
    write_atomically(path, "old")
    with pytest.raises(TypeError):
        write_atomically(path, None)  # type: ignore[arg-type]
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(
    ("code", "remedy"), [(errno.ENOSPC, "free some space"), (errno.EIO, "choose another place")]
)
def test_a_full_disk_is_refused_and_leaves_the_old_file(tmp_path, monkeypatch, code, remedy):
    path = tmp_path / "file"
    write_atomically(path, "old")

    def full(_: int) -> None:
        raise OSError(code, os.strerror(code))

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(InputError, match=remedy) as raised:
        write_atomically(path, "new" * 1000)
    assert str(raised.value).startswith(f"{path}: cannot be written ({os.strerror(code)}); ")
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_an_interrupted_write_leaves_nothing(tmp_path, monkeypatch):
    def interrupted(_: int) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "fsync", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_atomically(tmp_path / "file", "new")
    assert list(tmp_path.iterdir()) == []


def test_places_that_cannot_be_written_are_refused_in_one_sentence(tmp_path):
    file = tmp_path / "file"
    file.write_text("kept")
    folder = tmp_path / "folder"
    folder.mkdir()
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    for path, remedy in (
        (file / "below", "choose another folder"),
        (file / "far" / "below", "choose another folder"),
        (folder, "path of a file, not of a folder"),
        (pipe, "path of a file, not of a folder"),
        (tmp_path / ("x" * 300), "choose a shorter name"),
        (tmp_path / "x".join(["y" * 200] * 30) / "z", "choose a shorter name"),
    ):
        with pytest.raises(InputError, match=f"cannot be written .*; .*{remedy}") as raised:
            write_atomically(path, "new")
        assert "\n" not in str(raised.value)
    assert file.read_text() == "kept"
    assert sorted(tmp_path.rglob("*")) == [file, folder, pipe]


@pytest.mark.skipif(not Path("/proc/self").is_dir(), reason="this system has no /proc")
def test_a_system_folder_cannot_be_written():
    with pytest.raises(InputError, match="cannot be written"):
        write_atomically(Path("/proc/glassgait/file"), "new")


def test_litter_of_dead_processes_is_removed_and_that_of_living_ones_kept(tmp_path, dead):
    deep = tmp_path / "a" / "b"
    deep.mkdir(parents=True)
    ours = [deep / f".file.json.{dead}.partial", tmp_path / f".x.{dead}.partial"]
    kept = [
        deep / f".file.json.{os.getpid()}.partial",
        deep / ".file.json.x.partial",
        deep / f"file.json.{dead}.partial",
        deep / f".{dead}.partial",
        deep / "file.json",
    ]
    for path in (*ours, *kept):
        path.write_text("")
    remove_litter(tmp_path)
    assert sorted(path for path in tmp_path.rglob("*") if path.is_file()) == sorted(kept)
    remove_litter(tmp_path / "none")


def test_a_write_removes_the_litter_of_its_own_file_alone(tmp_path, dead):
    mine, other = tmp_path / f".[f].{dead}.partial", tmp_path / f".f.{dead}.partial"
    for path in (mine, other):
        path.write_text("half")
    write_atomically(tmp_path / "[f]", "whole")
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(["[f]", other.name])


def test_folders_and_pipes_are_never_read(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path, tmp_path / "pipe"):
        for read in (load_arrays, read_record, read_text, read_yaml, digest):
            with pytest.raises(InputError, match=f"^{path}: cannot be read .*regular file"):
                read(path)


def test_digest_is_that_of_the_bytes(tmp_path):
    path = tmp_path / "file"
    path.write_bytes(b"abc" * 100_000)
    assert digest(path) == hashlib.sha256(b"abc" * 100_000).hexdigest()
    with pytest.raises(InputError, match="no such file"):
        digest(tmp_path / "none")


def test_records_come_back_with_every_digit(tmp_path):
    path = tmp_path / "record.json"
    values = {
        "scores": [0.1 + 0.2, math.nan, math.inf, -0.0, 5e-324, 2**70],
        "text": 'é "\n\ud800',
        "none": None,
        "nested": {"a": [True, {}]},
    }
    write_record(path, values)
    assert repr(read_record(path)) == repr(values)


def test_every_cut_and_every_flipped_byte_of_a_record_is_noticed(tmp_path):
    path = tmp_path / "record.json"
    values = {"scores": [0.1, math.nan], "name": "x", "n": 12}
    write_record(path, values)
    whole = path.read_bytes()
    generator = random.Random(0)
    noticed = 0
    for i in range(len(whole)):
        flipped = bytearray(whole)
        flipped[i] ^= generator.choice((1, 4, 128, 255))
        for hurt in (whole[:i], bytes(flipped)):
            path.write_bytes(hurt)
            try:
                assert repr(read_record(path)) == repr(values)
            except InputError as error:
                noticed += 1
                assert str(error) == f"{path}: is damaged; delete it, and --resume makes it anew"
    # Spaces between values may be hurt without harm.
    assert noticed >= 2 * len(whole) - 10


@pytest.mark.parametrize(
    "text",
    ["", "[]", "1", "null", "{}", '{"sha256": "x"}', '{"sha256": [], "values": 1}', "[" * 100_000,
     '{"sha256": "x", "values": ' + "9" * 5000 + "}"],
)  # fmt: skip
def test_records_of_other_kinds_are_damaged(tmp_path, text):
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


def test_texts_may_be_as_long_as_the_bound(tmp_path):
    path = tmp_path / "file.txt"
    path.write_text("é" * 50)
    assert read_text(path, limit=100) == "é" * 50
    with pytest.raises(InputError, match="99 bytes"):
        read_text(path, limit=99)

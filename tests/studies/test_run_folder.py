"""A folder holds one run: of the same settings, inputs and software, and one process at a time."""

import subprocess
import sys
from dataclasses import dataclass, replace

import pytest
import yaml

from glassgait.models.errors import InputError
from glassgait.studies.common import run_folder
from glassgait.studies.common.run_folder import (
    CONFIG_NAME,
    digest_of_files,
    open_run,
    read_settings,
    refuse_run,
)

HOLD = """
import sys, time
from pathlib import Path
from glassgait.studies.common.run_folder import open_run
with open_run(Path(sys.argv[1]), study="train", settings={}, inputs={}, resume=False):
    print("at work", flush=True)
    time.sleep(60)
"""


@dataclass(frozen=True)
class Part:
    friction: float = 1.0


@dataclass(frozen=True)
class Run:
    gait: str = "trot"
    seed: int = 0
    n_jobs: int = 2
    part: Part = Part()
    sizes: tuple[int, ...] = (3, 4)


INPUTS = {"gait": "a1", "expert": "b2"}


def opened(folder, settings=None, inputs=INPUTS, study="distill", **options):
    options = {"resume": True, "free": ("n_jobs",), **options}
    return open_run(folder, study=study, settings=settings or Run(), inputs=inputs, **options)


@pytest.fixture
def run(tmp_path):
    folder = tmp_path / "run"
    with opened(folder, resume=False):
        pass
    return folder


def refusal(folder, *arguments, **options):
    with pytest.raises(InputError) as raised, opened(folder, *arguments, **options):
        pytest.fail("the run was opened")
    return str(raised.value)


def test_what_a_run_is_made_of_is_written(run):
    written = yaml.safe_load((run / CONFIG_NAME).read_text())
    assert written["study"] == "distill"
    assert written["settings"]["sizes"] == [3, 4]
    assert written["inputs"] == INPUTS
    assert {"python", "drake", "numpy"} < written["software"].keys()
    assert read_settings(run, "distill")["part"] == {"friction": 1.0}


def test_a_run_is_continued_only_when_asked(run):
    with opened(run):
        pass
    assert "holds a run of 'distill' already; continue it with --resume" in refusal(
        run, resume=False
    )


def test_a_run_that_is_not_there_yet_is_started(tmp_path):
    with opened(tmp_path / "new"):
        pass
    assert (tmp_path / "new" / CONFIG_NAME).exists()


def test_other_settings_are_named(run):
    assert "made with seed = 0, not 1;" in refusal(run, replace(Run(), seed=1))
    assert "part.friction = 1.0, not 0.5" in refusal(run, Run(part=Part(0.5)))
    assert "sizes = [3, 4], not [3, 5]" in refusal(run, Run(sizes=(3, 5)))


def test_free_settings_may_change(run):
    with opened(run, Run(n_jobs=8)):
        pass
    assert read_settings(run, "distill")["n_jobs"] == 8


def test_other_inputs_are_named_wherever_they_lie(run):
    assert "made with another expert;" in refusal(run, inputs={**INPUTS, "expert": "c3"})
    assert "made with another gait;" in refusal(run, inputs={**INPUTS, "gait": "c3"})
    with opened(run, Run(gait="elsewhere/trot.yaml")):
        pass


def test_other_software_is_named(run, monkeypatch):
    monkeypatch.setattr(run_folder, "version", lambda name: "9.9")
    message = refusal(run)
    assert "drake = '1." in message and "not '9.9'" in message


def test_other_studies_and_other_files_are_left_alone(run, tmp_path):
    assert "holds a run of 'distill', not of 'glassgait train'" in refusal(run, study="train")
    (tmp_path / "notes.txt").write_text("mine")
    assert "holds files of something else" in refusal(tmp_path)
    assert not (tmp_path / CONFIG_NAME).exists()


@pytest.mark.parametrize("text", ["", "[", "study: distill", "3", "study: &a [*a]", "\0", "a: {b"])
def test_a_damaged_record_is_refused(run, text):
    (run / CONFIG_NAME).write_text(text)
    assert str(run) in refusal(run)


def test_two_runs_do_not_share_a_folder(tmp_path):
    folder = tmp_path / "run"
    process = subprocess.Popen(
        [sys.executable, "-c", HOLD, str(folder)], stdout=subprocess.PIPE, text=True
    )
    try:
        assert process.stdout is not None
        assert process.stdout.readline() == "at work\n"
        held = {"study": "train", "settings": {}, "inputs": {}}
        message = "another run is at work here"
        with pytest.raises(InputError, match=message), open_run(folder, **held, resume=True):
            pytest.fail("two runs share a folder")
    finally:
        process.kill()
        process.communicate()
    # A killed process holds the folder no more.
    with open_run(folder, **held, resume=True):
        pass


def test_what_is_refused_before_it_made_anything_leaves_nothing(tmp_path):
    folder = tmp_path / "run"
    with pytest.raises(InputError), opened(folder):
        raise InputError("no")
    assert not folder.exists()
    with pytest.raises(InputError), opened(folder):
        (folder / "level.safetensors").write_text("work")
        raise InputError("no")
    assert (folder / "level.safetensors").exists()
    with opened(folder):
        pass


def test_what_is_refused_leaves_no_empty_folder_above_it_but_those_that_were_there(tmp_path):
    (tmp_path / "kept").mkdir()
    with pytest.raises(InputError, match="no"), opened(tmp_path / "kept" / "gait" / "policy"):
        raise InputError("no")
    assert [path.name for path in tmp_path.rglob("*")] == ["kept"]


def test_a_folder_above_it_that_another_run_is_in_stays(tmp_path):
    folder, other = tmp_path / "gait" / "policy", tmp_path / "gait" / "other"
    with pytest.raises(InputError, match="no"), opened(folder):
        with opened(other):
            pass
        raise InputError("no")
    assert (other / "config.yaml").exists()
    assert not folder.exists()


def test_hidden_files_of_a_persons_own_are_left(tmp_path):
    (tmp_path / ".git").mkdir()
    (tmp_path / ".git" / "HEAD").write_text("mine")
    with pytest.raises(InputError, match="no"), opened(tmp_path):
        raise InputError("no")
    assert {path.name for path in tmp_path.iterdir()} == {".git"}
    assert (tmp_path / ".git" / "HEAD").read_text() == "mine"


def test_a_refusal_is_reported_whatever_the_folder_is(tmp_path):
    (tmp_path / "folder").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "folder")
    with pytest.raises(InputError, match="no"), opened(tmp_path / "link"):
        raise InputError("no")
    assert not list((tmp_path / "folder").iterdir())


def test_a_refused_continuation_leaves_the_record_as_it_was(run):
    before = (run / CONFIG_NAME).read_text()
    with pytest.raises(InputError), opened(run, Run(n_jobs=8)):
        raise InputError("no")
    assert (run / CONFIG_NAME).read_text() == before


def test_runs_are_distinguished_by_all_but_what_is_free(run, tmp_path):
    identities = []
    for folder, settings in (
        (run, Run()),
        (run, Run(n_jobs=9)),
        (tmp_path / "copy", Run()),
        (tmp_path / "other", Run(seed=1)),
    ):
        with opened(folder, settings) as identity:
            identities.append(identity)
    assert identities[0] == identities[1] == identities[2] != identities[3]


def test_a_folder_that_holds_a_run_is_no_place_for_other_results(run, tmp_path):
    with pytest.raises(InputError, match="holds a run"):
        refuse_run(run)
    refuse_run(tmp_path)


def test_what_a_killed_process_half_wrote_is_removed(run):
    litter = run / "levels" / ".round_01.safetensors.999999999.partial"
    litter.parent.mkdir()
    litter.write_text("half")
    with opened(run):
        assert not litter.exists()


def test_a_place_that_cannot_be_written_to_is_refused(tmp_path):
    (tmp_path / "file").write_text("")
    assert "file" in refusal(tmp_path / "file" / "run")
    assert "file" in refusal(tmp_path / "file")


def test_files_are_distinguished_by_name_and_contents(tmp_path):
    paths = [tmp_path / name for name in ("a", "b")]
    for path in paths:
        path.write_text(path.name)
    before = digest_of_files(paths)
    assert digest_of_files(paths[::-1]) == before
    paths[0].write_text("other")
    assert digest_of_files(paths) != before

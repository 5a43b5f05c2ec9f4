"""Run folders: a run of the same settings, inputs and software, or nothing."""

from dataclasses import dataclass, replace

import pytest
import yaml

from glassgait.models.errors import InputError
from glassgait.studies.common import run as run_module
from glassgait.studies.common.run import CONFIG_NAME, open_run, read_run, refuse_run


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


def test_a_run_records_settings_inputs_and_software(run):
    written = yaml.safe_load((run / CONFIG_NAME).read_text())
    assert written["study"] == "distill" and written["inputs"] == INPUTS
    assert written["settings"]["sizes"] == [3, 4]
    assert {"python", "drake", "numpy"} < written["software"].keys()
    assert read_run(run, "distill")["settings"]["part"] == {"friction": 1.0}


def test_a_run_is_continued_only_with_resume(run):
    with opened(run, Run(gait="elsewhere/trot.yaml", n_jobs=8)):
        pass
    assert read_run(run, "distill")["settings"]["n_jobs"] == 8
    assert "continue it with --resume" in refusal(run, resume=False)


@pytest.mark.parametrize(
    ("settings", "inputs", "reported"),
    [
        (replace(Run(), seed=1), INPUTS, "made with seed = 0, not 1;"),
        (Run(part=Part(0.5)), INPUTS, "part.friction = 1.0, not 0.5"),
        (Run(sizes=(3, 5)), INPUTS, "sizes = [3, 4], not [3, 5]"),
        (Run(), {**INPUTS, "expert": "c3"}, "inputs.expert = 'b2', not 'c3'"),
    ],
)
def test_other_settings_and_inputs_are_refused(settings, inputs, reported, run):
    assert reported in refusal(run, settings, inputs)


def test_other_software_is_refused(run, monkeypatch):
    monkeypatch.setattr(run_module, "version", lambda name: "9.9")
    assert "software.drake = '1." in refusal(run)


def test_other_studies_and_other_files_are_left_alone(run, tmp_path):
    assert "holds a run of 'distill', not of 'glassgait train'" in refusal(run, study="train")
    (tmp_path / "notes.txt").write_text("mine")
    assert "holds other files" in refusal(tmp_path)
    assert not (tmp_path / CONFIG_NAME).exists()
    assert "notes.txt" in refusal(tmp_path / "notes.txt" / "run")


@pytest.mark.parametrize("text", ["", "[", "study: distill", "3", "study: &a [*a]", "\0", "a: {b"])
def test_a_damaged_record_is_refused(run, text):
    (run / CONFIG_NAME).write_text(text)
    assert str(run) in refusal(run)


def test_a_run_that_is_refused_before_it_made_anything_leaves_nothing(tmp_path):
    folder = tmp_path / "run"
    with pytest.raises(InputError), opened(folder):
        raise InputError("no")
    assert not folder.exists()
    with pytest.raises(InputError), opened(folder):
        (folder / "level.safetensors").write_text("work")
        raise InputError("no")
    assert (folder / CONFIG_NAME).exists() and (folder / "level.safetensors").exists()


def test_other_results_are_not_written_into_a_run(run, tmp_path):
    with pytest.raises(InputError, match="holds a run"):
        refuse_run(run)
    refuse_run(tmp_path)

"""Several gaits and seeds in one command: a job each, in a folder of its own."""

import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest
from filelock import FileLock

from glassgait.models.errors import InputError
from glassgait.models.files import digest
from glassgait.models.task.gait import GAIT_DIRECTORY, gait_names
from glassgait.studies.common import sweep
from glassgait.studies.common.console import console
from glassgait.studies.common.run_folder import LOCK_NAME
from glassgait.studies.common.sweep import SweepConfig, gaits_named, jobs_of, run_sweep

HERE = SweepConfig(n_workers=1)
SMALL = ["--n-robots", "8", "--n-groups", "1", "--fine-steps", "--updates", "4"]
SMALL += ["--checkpoint-updates", "2"]


def _jobs(names=("trot", "walk"), seeds=2, output=None, first_seed=0):
    config = SweepConfig(n_seeds=seeds)
    return jobs_of(names, first_seed, config, root=Path("runs/train"), output=output)


@pytest.fixture(autouse=True)
def place(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize(
    ("names", "seeds", "output", "folders"),
    [
        (["trot"], 1, None, ["runs/train/trot"]),
        (["trot"], 1, "mine", ["mine"]),
        (["trot"], 2, None, ["runs/train/trot/seed_5", "runs/train/trot/seed_6"]),
        (["trot", "walk"], 1, "mine", ["mine/trot", "mine/walk"]),
        (["trot", "walk"], 1, None, ["runs/train/trot", "runs/train/walk"]),
    ],
)
def test_each_gait_and_seed_has_its_folder(names, seeds, output, folders):
    jobs = _jobs(names, seeds, output and Path(output), first_seed=5)
    assert [job.folder for job in jobs] == list(map(Path, folders))
    assert [job.seed for job in jobs] == [5 + i % seeds for i in range(len(jobs))]


def test_all_stands_for_every_gait_that_ships():
    assert gaits_named(["all"]) == gait_names()
    with pytest.raises(InputError, match="others"):
        gaits_named(["all", "trot"])


def test_two_gaits_of_one_name_are_refused():
    Path("trot.yaml").write_text((GAIT_DIRECTORY / "trot.yaml").read_text())
    with pytest.raises(InputError, match="trot"):
        gaits_named(["trot", "trot.yaml"])


def test_a_job_that_is_refused_stops_no_other(capsys):
    def run(job):
        if job.gait == "walk" and job.seed == 0:
            raise InputError("the walk: is refused")
        (job.folder / "result").write_text(job.title)

    jobs = _jobs()
    with pytest.raises(InputError, match=r"^1 of 4 .* seed 0: the walk: "):
        run_sweep(jobs, run, HERE)
    assert [(job.folder / "result").exists() for job in jobs] == [True, True, False, True]
    assert not jobs[2].folder.exists()
    message = capsys.readouterr().out
    assert message.count("sent to a worker") == 4
    assert message.count("done (") == 3
    assert message.count("walk, seed 0: refused (3 of 4)") == 1


def test_results_come_in_the_order_of_the_jobs_and_jobs_are_silent(capsys):
    def run(job):
        console.print("what a single run prints")
        return job.title

    jobs = _jobs()
    assert run_sweep(jobs, run, HERE) == [job.title for job in jobs]
    assert "single run" not in capsys.readouterr().out
    assert not console.quiet


def test_an_error_of_the_program_is_none_of_a_job_alone():
    with pytest.raises(ZeroDivisionError):
        run_sweep(_jobs(), lambda job: 1 / 0, HERE)


@pytest.mark.parametrize("home", ["missing", "other"])
def test_a_worker_that_sees_other_files_refuses_its_job(home):
    Path("other").mkdir()
    job, here = _jobs()[0], Path.cwd()
    _, _, sentence = sweep._run_job(0, job, lambda job: None, here / home)
    assert "run in a folder that all nodes share" in sentence


def test_a_job_waits_for_the_lock_of_one_whose_node_was_lost():
    job = _jobs()[0]
    job.folder.mkdir(parents=True)
    held = FileLock(job.folder / LOCK_NAME, thread_local=False)
    held.acquire()
    threading.Timer(0.5, held.release).start()
    began = time.monotonic()
    _, free, _ = sweep._run_job(0, job, lambda job: not held.is_locked, Path.cwd())
    assert free
    assert time.monotonic() - began > 0.4


def test_folders_that_hold_runs_are_refused_before_any_job_is_begun(refused):
    folder = Path("runs/train/walk")
    folder.mkdir(parents=True)
    (folder / "mine.txt").touch()
    assert "runs/train/walk: holds files of something else" in refused(
        ["train", "--gait", "trot", "walk", *SMALL]
    )
    assert not Path("runs/train/trot").exists()


@pytest.mark.parametrize("command", ["train", "distill", "evaluate scenarios", "reproduce report"])
def test_a_gait_that_is_none_is_refused_before_any_work(command, refused):
    assert "gallop" in refused([*command.split(), "--gait", "trot", "gallop"])
    assert not list(Path.cwd().iterdir())


def _command(*arguments):
    return subprocess.Popen(
        [sys.executable, "-m", "glassgait.studies.cli", *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def _experts(root="runs/train"):
    paths = [path for name in gait_names() for path in Path(root).rglob(f"{name}.safetensors")]
    return {str(path.relative_to(root)): digest(path) for path in paths}


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_an_interrupted_sweep_goes_on_by_the_same_command(number):
    sweep = ["train", "--gait", "trot", "walk", "--n-seeds", "2", *SMALL]
    process = _command(*sweep)
    while "done (" not in (line := process.stdout.readline()):
        pass
    process.send_signal(number)
    _, message = process.communicate(timeout=60)
    if number == signal.SIGKILL:
        assert process.returncode == -number
    else:
        assert process.returncode == 128 + number
        assert message.strip().endswith("what was finished is kept")
    done = Path(line.split()[-1]) / "checkpoint.safetensors"
    saved = done.stat().st_mtime_ns
    process = _command(*sweep, "--resume")
    process.communicate(timeout=300)
    assert process.returncode == 0
    assert done.stat().st_mtime_ns == saved, "what was done was done again"
    alone = _command("train", "--gait", "walk", "--seed", "1", *SMALL, "--output", "alone")
    alone.communicate(timeout=300)
    assert len(_experts()) == 4
    assert _experts()["walk/seed_1/walk.safetensors"] == digest(Path("alone/walk.safetensors"))

"""How commands start and end: help at once, and one sentence whatever goes wrong."""

import errno
import os
import random
import re
import signal
import subprocess
import sys
import time
from collections import Counter
from importlib.metadata import version
from inspect import getdoc
from pathlib import Path

import pytest

from glassgait.models.errors import InputError
from glassgait.studies.cli import COMMANDS, MOVED, command_class, main
from glassgait.studies.common.exit_codes import (
    BAD_INPUT,
    BROKEN_PIPE,
    HUNG_UP,
    INTERRUPTED,
    TERMINATED,
    report_errors,
)

HEAVY = {"matplotlib", "numpy", "pydantic", "pydrake", "rich", "torch", "tyro"}


def start(code, **options):
    """Starts Python on some code, in a group of its own as a shell would."""
    return subprocess.Popen(
        [sys.executable, "-c", code],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        **options,
    )


CLASSES = Counter(place for place, _ in COMMANDS.values())


# What starts one class from several files of settings has a summary of its own.
@pytest.mark.parametrize("name", [n for n, (place, _) in COMMANDS.items() if CLASSES[place] == 1])
def test_the_help_shows_the_docstring_of_the_class(name):
    _, summary = COMMANDS[name]
    assert getdoc(command_class(name)).splitlines()[0] == summary


@pytest.mark.parametrize("arguments", [[], ["--help"], ["-h", "train"]])
def test_help_lists_every_command(arguments, capsys):
    main(arguments)
    printed = capsys.readouterr().out
    assert all(f"  {name} " in printed for name in COMMANDS)


def test_version_is_that_of_the_package(capsys):
    main(["--version"])
    assert capsys.readouterr().out == version("glassgait") + "\n"


@pytest.mark.parametrize("name", ["bogus", "--bogus", "", "x" * 1000, "Train"])
def test_an_unknown_command_is_refused_with_those_there_are(name, refused):
    assert refused([name]).endswith("export, drive, reproduce")


@pytest.mark.parametrize(
    ("words", "meant"),
    [
        ("exprot", "export"),
        ("robustnes", "evaluate scenarios"),
        ("evaluate push", "evaluate pushes"),
        ("evaluate", "transitions"),
        ("verify --gait trot", "check"),
    ],
)
def test_a_mistyped_command_is_refused_with_the_one_that_was_meant(words, meant, refused):
    assert meant in refused(words.split())


@pytest.mark.parametrize("name", MOVED)
def test_an_earlier_command_is_refused_with_where_it_is_now(name, refused):
    assert f"it is now '{MOVED[name]}'" in refused([name, "--gait", "trot"])
    assert MOVED[name] in COMMANDS


@pytest.mark.parametrize("group", ["evaluate", "explain", "verify"])
def test_help_of_a_group_lists_its_commands(group, capsys):
    main([group, "--help"])
    listed = re.findall(r"^  (.+?)  ", capsys.readouterr().out, flags=re.MULTILINE)
    assert listed == [name for name in COMMANDS if name.startswith(f"{group} ")]


def test_an_option_that_selects_a_command_may_stand_anywhere(refused):
    printed = refused(["distill", "--terms", "0", "--sweep", "terms"])
    assert "terms" in printed


@pytest.mark.parametrize("argument", ["--help", "--version", "bogus"])
def test_nothing_heavy_is_imported_before_a_command_is_known(argument):
    code = (
        "import sys\nfrom glassgait.studies.cli import main\n"
        f"try: main([{argument!r}])\nexcept SystemExit: pass\n"
        f"print(sorted({HEAVY!r} & set(sys.modules)), file=sys.stderr)"
    )
    _, printed = start(code).communicate(timeout=60)
    assert printed.splitlines()[-1] == "[]"


NO_ROOM = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
ENDINGS = [
    (InputError("a: is not b; mend it"), BAD_INPUT, "a: is not b; mend it"),
    (KeyboardInterrupt(), INTERRUPTED, "interrupted; what was finished is kept"),
    (KeyboardInterrupt(signal.SIGTERM), TERMINATED, "terminated; what was finished is kept"),
    (KeyboardInterrupt(signal.SIGHUP), HUNG_UP, "hung up; what was finished is kept"),
    (InputError("a\nb\x1b[31m\u202eé: mend it"), BAD_INPUT, "a\\nb\\x1b[31m\\u202eé: mend it"),
    (MemoryError(), BAD_INPUT, "there is not enough memory"),
    (RuntimeError("DefaultCPUAllocator: can't allocate memory"), BAD_INPUT, "there is not enough"),
    (PermissionError(errno.EACCES, "Permission denied", "runs/a"), BAD_INPUT, "runs/a: Permission"),
    (PermissionError(errno.EACCES, "Denied", b"runs/\xff"), BAD_INPUT, "runs/"),
    (NO_ROOM, BAD_INPUT, "No space left on device; make room there"),
    (OSError("two\nlines"), BAD_INPUT, "two lines; check the path"),
    (OSError(), BAD_INPUT, "OSError; check the path"),
]


@pytest.mark.parametrize(("error", "code", "printed"), ENDINGS)
def test_an_error_ends_in_one_sentence(error, code, printed, capsys):
    with pytest.raises(SystemExit) as ended, report_errors():
        raise error
    assert ended.value.code == code
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert line.startswith(f"glassgait: {printed}")


@pytest.mark.parametrize("error", [ZeroDivisionError, RuntimeError])
def test_an_error_of_the_program_keeps_its_traceback(error):
    with pytest.raises(error), report_errors():
        raise error


@pytest.mark.parametrize(
    "place", ["file/drawing.dot", "file/deep/drawing.dot", "folder", "a" * 300]
)
def test_a_place_that_cannot_be_written_is_refused(place, refused, tmp_path):
    (tmp_path / "file").touch()
    (tmp_path / "folder").mkdir()
    assert str(tmp_path) in refused(["gait", "trot", "--output", str(tmp_path / place)])
    assert {path.name for path in tmp_path.iterdir()} == {"file", "folder"}


@pytest.mark.parametrize("command", [["gait", "trot"], ["--help"]])
def test_a_reader_that_wants_no_more_is_left_in_silence(command):
    process = start(f"from glassgait.studies.cli import main; main({command!r})")
    process.stdout.close()
    assert process.stderr.read() == ""
    assert process.wait() == BROKEN_PIPE


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a disk that is always full")
@pytest.mark.parametrize(
    ("command", "unbuffered"),
    [
        (["gait", "trot"], ""),
        (["--help"], "1"),
        pytest.param(["gait", "trot"], "1", marks=pytest.mark.slow),
        pytest.param(["--help"], "", marks=pytest.mark.slow),
    ],
)
def test_a_full_disk_is_reported(command, unbuffered):
    with Path("/dev/full").open("w") as full:
        process = subprocess.run(
            [sys.executable, "-m", "glassgait.studies.cli", *command],
            stdout=full,
            stderr=subprocess.PIPE,
            env=os.environ | {"PYTHONUNBUFFERED": unbuffered},
            text=True,
            check=False,
        )
    assert process.returncode == BAD_INPUT
    (line,) = process.stderr.splitlines()
    assert line.startswith("glassgait: No space left on device; make room there")


ASKED = {"gait trot": 0, "--help": 0, "gait gallop": BAD_INPUT}
CLOSED = (">&-", "2>&-", ">&- 2>&-")


@pytest.mark.parametrize(
    ("arguments", "code", "closed"),
    [
        pytest.param(*asked, closed, marks=() if i == j else pytest.mark.slow)
        for i, asked in enumerate(ASKED.items())
        for j, closed in enumerate(CLOSED)
    ],
)
def test_output_that_is_closed_is_done_without(arguments, code, closed):
    process = subprocess.run(
        ["sh", "-c", f"exec '{sys.executable}' -m glassgait.studies.cli {arguments} {closed}"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert process.returncode == code
    assert "Traceback" not in process.stderr
    assert bool(process.stdout) == (code == 0 and not closed.startswith(">"))


def test_a_working_folder_that_is_gone_is_reported(tmp_path):
    gone = tmp_path / "gone"
    gone.mkdir()
    code = (
        "import os\nfrom glassgait.studies.cli import main\nos.rmdir(os.getcwd())\nmain(['train'])"
    )
    process = start(code, cwd=gone)
    _, printed = process.communicate(timeout=60)
    assert process.returncode == BAD_INPUT
    assert printed == "glassgait: the working folder is gone; change to one that is there\n"


# A command that is at work as soon as it has started, and that may be slow to unwind. Tests that
# `nohup` has begun hand down that a hang-up is ignored, which commands keep to.
AT_WORK = """
import os, signal, sys, time
from glassgait.studies import cli
from glassgait.studies.common import exit_codes as ending

signal.signal(signal.SIGHUP, signal.SIG_DFL)

class Work:
    def run(self):
        try:
            os.write(1, b".")
            time.sleep(60)
        finally:
            os.write(1, b".")
            %s

ending.PATIENCE = 1.0
cli._parse = lambda *_: Work()
sys.argv[1:] = ["train"]
cli.main()
"""


@pytest.mark.parametrize(
    ("number", "code", "word"),
    [
        (signal.SIGINT, INTERRUPTED, "interrupted"),
        (signal.SIGTERM, TERMINATED, "terminated"),
        (signal.SIGHUP, HUNG_UP, "hung up"),
    ],
)
def test_a_signal_ends_a_command_in_one_sentence(number, code, word):
    process = start(AT_WORK % "pass")
    assert process.stdout.read(1) == "."
    process.send_signal(number)
    _, printed = process.communicate(timeout=30)
    assert (process.returncode, printed) == (
        code,
        f"\nglassgait: {word}; what was finished is kept\n",
    )


def test_a_terminal_that_closes_and_says_so_twice_lets_the_command_unwind():
    process = start(AT_WORK % "time.sleep(0.5); os.write(1, b'!')")
    for _ in range(2):
        assert process.stdout.read(1) == "."
        process.send_signal(signal.SIGHUP)
    left, _ = process.communicate(timeout=30)
    assert (process.returncode, left) == (HUNG_UP, "!")


@pytest.mark.parametrize("again", [0, 1])
def test_a_command_that_hangs_on_its_way_out_ends_all_the_same(again):
    process = start(AT_WORK % "import threading; threading.Event().wait()")
    for _ in range(1 + again):
        assert process.stdout.read(1) == "."
        process.send_signal(signal.SIGINT)
    _, printed = process.communicate(timeout=30)
    assert (process.returncode, printed) == (INTERRUPTED, "\nglassgait: interrupted\n")


# An exception in a finalizer goes nowhere, like one in a compiled callback.
LOST = """
import os, time
from glassgait.studies.common import exit_codes as ending

class Finalizer:
    def __del__(self, write=os.write, sleep=time.sleep):
        write(1, b".")
        sleep(60)

ending.take_signals()
with ending.report_errors():
    Finalizer()
    time.sleep(60)
"""


def test_an_interrupt_that_is_lost_ends_the_command_at_once():
    process = start(LOST)
    assert process.stdout.read(1) == "."
    process.send_signal(signal.SIGINT)
    _, printed = process.communicate(timeout=30)
    assert (process.returncode, printed) == (INTERRUPTED, "\nglassgait: interrupted\n")


AT_EXIT = """
import atexit, os, sys, time

# The last that Python does, and later than all that it calls at the exit: modules are gone by then.
class Last:
    def __del__(self, write=os.write, sleep=time.sleep):
        write(1, b".")
        sleep(1.0)

sys.last = Last()
"""


def test_an_interrupt_after_the_sentence_keeps_the_exit_code():
    process = start(AT_EXIT + AT_WORK % "pass")
    assert process.stdout.read(1) == "."
    process.send_signal(signal.SIGINT)
    assert process.stdout.read(2) == ".."
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=30)
    assert process.returncode == INTERRUPTED


def interrupt_after(seconds, arguments, folder):
    """Sends Ctrl-C to a command and its workers after some seconds, and returns how it ended."""
    code = (
        "import os, sys\nfrom glassgait.studies.cli import main\n"
        f"os.write(1, b'.'); sys.argv[1:] = {arguments!r}; main()"
    )
    process = start(code, cwd=folder)
    assert process.stdout.read(1) == "."
    time.sleep(seconds)
    os.killpg(process.pid, signal.SIGINT)
    _, printed = process.communicate(timeout=60)
    return process.returncode, printed


def test_an_interrupt_while_importing_is_reported(tmp_path):
    code, printed = interrupt_after(0.05, ["train"], tmp_path)
    assert (code, printed) == (INTERRUPTED, "\nglassgait: interrupted\n")
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
@pytest.mark.parametrize("moment", range(10))
def test_an_interrupt_never_ends_in_a_traceback(moment, tmp_path):
    seconds = random.Random(moment).uniform(0.05, 5.0)
    endless = ["--n-seeds", "9", "--n-steps", "100000", "--scenario", "training"]
    code, printed = interrupt_after(seconds, ["evaluate", "scenarios", *endless], tmp_path)
    assert code == INTERRUPTED
    # Before it there may stand where the policies are from.
    (sentence,) = [line for line in printed.splitlines() if line and not line.startswith("· ")]
    assert sentence.startswith("glassgait: interrupted")

"""How commands end on a mistake, a full disk or Ctrl-C: in one sentence, never in a traceback.

Nothing heavy is imported here, so that the sentence comes even while all else is imported.
"""

import errno
import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from io import TextIOWrapper
from typing import NoReturn

from models.errors import InputError

BROKEN_PIPE = 1
BAD_INPUT = 2
INTERRUPTED = 130


@contextmanager
def told_plainly() -> Iterator[None]:
    """Turns bad input, and what the system refuses, into one sentence and exit code 2.

    Ctrl-C ends with exit code 130, and a reader that wants no more output in silence.
    """
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            # What a terminal cannot write, such as a path that is not UTF-8, goes by its codes.
            stream.reconfigure(errors="backslashreplace")
    try:
        yield
        sys.stdout.flush()
    except InputError as error:
        _end(str(error), BAD_INPUT)
    except KeyboardInterrupt:
        print(file=sys.stderr)
        _end("interrupted; what was finished is kept", INTERRUPTED)
    except BrokenPipeError:
        # Python flushes the output once more when it ends.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(BROKEN_PIPE)
    except MemoryError:
        _end("there is not enough memory; ask for fewer robots, samples or bins", BAD_INPUT)
    except OSError as error:
        _end(_refusal(error), BAD_INPUT)


@contextmanager
def ended_at_once() -> Iterator[None]:
    """Has Ctrl-C end the process at once, where an exception would be lost inside of an import."""
    before = signal.signal(signal.SIGINT, _end_at_once)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def end_at_once_from_now_on() -> None:
    """Has Ctrl-C end the process at once, which is about to end: there is nothing to unwind."""
    signal.signal(signal.SIGINT, _end_at_once)


def _end_at_once(*_: object) -> NoReturn:
    os.write(sys.__stderr__.fileno(), b"\nglassgait: interrupted\n")  # type: ignore[union-attr]
    os._exit(INTERRUPTED)


def _end(sentence: str, code: int) -> NoReturn:
    sys.stdout.flush()
    print(f"glassgait: {sentence}", file=sys.stderr)
    sys.exit(code)


def _refusal(error: OSError) -> str:
    where = f"{os.fsdecode(error.filename)}: " if isinstance(error.filename, str | bytes) else ""
    what = error.strerror or " ".join(str(error).split()) or type(error).__name__
    if error.errno in (errno.ENOSPC, errno.EDQUOT):
        return f"{where}{what}; make room there, or name another folder with --output"
    return f"{where}{what}; check the path and who may use it"

"""How commands end on a mistake, a full disk or a signal: in one sentence, never in a traceback.

Nothing heavy is imported here, so that the sentence comes even while all else is imported.
"""

import _thread
import atexit
import errno
import os
import signal
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from io import TextIOWrapper
from typing import NoReturn

from glassgait.models.errors import InputError

BROKEN_PIPE = 1
BAD_INPUT = 2
INTERRUPTED = 130
TERMINATED = 143
HUNG_UP = 129

PATIENCE = 15.0
"""Seconds after a signal in which the process may unwind, before it ends all the same."""

SIGNALS = {signal.SIGINT: "interrupted", signal.SIGTERM: "terminated"}
"""Signals that end a command, and how its sentence names them."""

if sys.platform != "win32":
    # The terminal is gone; a robot that is driven from it is not left to its last command.
    SIGNALS[signal.SIGHUP] = "hung up"
_taken: list[signal.Signals] = []
"""Signals that unwind this process. Ray raises a KeyboardInterrupt of its own, which names none."""

_NO_MEMORY = "there is not enough memory; ask for fewer robots, samples or bins"


@contextmanager
def report_errors() -> Iterator[None]:
    """Turns bad input, and what the system refuses, into one sentence and exit code 2.

    Ctrl-C ends with exit code 130, SIGTERM with 143, SIGHUP with 129, and a reader that wants no
    more output in silence.
    """
    _open_streams()
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            # What a terminal cannot write, such as a path that is not UTF-8, goes by its codes.
            stream.reconfigure(errors="backslashreplace")
    try:
        yield
        sys.stdout.flush()
    except KeyboardInterrupt as interrupt:
        _replace_handlers(_end_at_once, _end_quietly)
        # What is unwound late, such as joblib's loops and threads, would report the work that
        # it drops.
        warnings.simplefilter("ignore")
        threading.excepthook = lambda _: None
        named = [number for number in (*interrupt.args, *_taken) if number in SIGNALS]
        number = named[-1] if named else signal.SIGINT
        _print_error("")
        _end(f"{SIGNALS[number]}; what was finished is kept", 128 + number)
    except BrokenPipeError:
        _drop_output()
        sys.exit(BROKEN_PIPE)
    except Exception as error:
        sentence = sentence_of(error)
        if sentence is None:
            raise
        _end(sentence, BAD_INPUT)


def sentence_of(error: Exception) -> str | None:
    """Describes bad input, and what the system refuses, in a sentence; None is an error of ours."""
    match error:
        case InputError():
            return str(error)
        case MemoryError():
            return _NO_MEMORY
        case RuntimeError() if "allocate memory" in str(error):
            # torch has no class of its own for it.
            return _NO_MEMORY
        case OSError():
            return _refusal(error)
        case _:
            return None


def take_signals() -> None:
    """Has the first Ctrl-C, SIGTERM or SIGHUP unwind this process, and the next end it at once.

    A second SIGHUP does nothing.
    """
    for number in SIGNALS:
        # A shell has its background commands ignore Ctrl-C: they still do.
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _interrupt)
    sys.unraisablehook = _end_where_lost
    # What is registered first runs last: only Python's own ending follows, which would drop the
    # handlers and have a signal end the process with its own code.
    atexit.register(_ignore_signals)


@contextmanager
def ended_at_once() -> Iterator[None]:
    """Has signals end the process at once, where an exception would be lost inside of an import."""
    taken = [number for number in SIGNALS if signal.getsignal(number) is not signal.SIG_IGN]
    with handlers_kept(taken):
        for number in taken:
            signal.signal(number, _end_at_once)
        yield


@contextmanager
def handlers_kept(numbers: Iterable[signal.Signals]) -> Iterator[None]:
    """Sets the handlers of signals back in the end."""
    before = {number: signal.getsignal(number) for number in numbers}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def end_at_once_from_now_on() -> None:
    """Has signals end the process at once, which is about to end: there is nothing to unwind."""
    _replace_handlers(_interrupt, _end_at_once)


def _interrupt(number: int, _: object) -> NoReturn:
    # A terminal that closes sends SIGHUP twice, as its shell does too: the second is no wish.
    if sys.platform != "win32" and signal.getsignal(signal.SIGHUP) is _interrupt:
        signal.signal(signal.SIGHUP, signal.SIG_IGN)
    _replace_handlers(_interrupt, _end_at_once)
    _taken.append(signal.Signals(number))
    # A thread of `threading` would need locks that the interrupted code may hold.
    _thread.start_new_thread(_end_late, (number,))
    raise KeyboardInterrupt(number)


def _end_where_lost(unraisable: "sys.UnraisableHookArgs") -> None:
    """Ends the process where compiled code drops the interrupt that should unwind it."""
    if _taken and isinstance(unraisable.exc_value, KeyboardInterrupt):
        _end_at_once(_taken[-1])
    sys.__unraisablehook__(unraisable)


def _end_late(number: int) -> None:
    time.sleep(PATIENCE)
    if signal.getsignal(number) is _end_at_once:
        _end_at_once(number)
    _end_quietly(number)


def _end_at_once(number: int, *_: object) -> NoReturn:
    with suppress(OSError):
        os.write(2, f"\nglassgait: {SIGNALS[signal.Signals(number)]}\n".encode())
    os._exit(128 + number)


def _end_quietly(number: int, *_: object) -> NoReturn:
    os._exit(128 + number)


def _ignore_signals() -> None:
    for number in SIGNALS:
        signal.signal(number, signal.SIG_IGN)


def _replace_handlers(old: Callable[..., NoReturn], new: Callable[..., NoReturn]) -> None:
    for number in SIGNALS:
        if signal.getsignal(number) is old:
            signal.signal(number, new)


def _open_streams() -> None:
    """Has output that was closed before the start go nowhere, rather than into other files."""
    for descriptor, name in ((1, "stdout"), (2, "stderr")):
        if getattr(sys, name) is None:
            os.dup2(os.open(os.devnull, os.O_WRONLY), descriptor)
            os.set_inheritable(descriptor, True)
            setattr(sys, name, os.fdopen(descriptor, "w", closefd=False))


def _end(sentence: str, code: int) -> NoReturn:
    end_at_once_from_now_on()
    try:
        sys.stdout.flush()
    except OSError:
        # A full disk, which the sentence reports, refuses what is left as well.
        _drop_output()
    _print_error(f"glassgait: {_on_one_line(sentence)}")
    sys.exit(code)


def _print_error(line: str) -> None:
    # A terminal that hung up takes no more lines.
    with suppress(OSError):
        print(line, file=sys.stderr, flush=True)


def _drop_output() -> None:
    """Has what was printed and not yet written go nowhere: Python writes it when it ends."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _on_one_line(sentence: str) -> str:
    # A path may hold line breaks, and codes that a terminal obeys.
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in sentence)


def _refusal(error: OSError) -> str:
    where = f"{os.fsdecode(error.filename)}: " if isinstance(error.filename, str | bytes) else ""
    what = error.strerror or " ".join(str(error).split()) or type(error).__name__
    if error.errno in (errno.ENOSPC, errno.EDQUOT):
        return f"{where}{what}; make room there, or name another folder with --output"
    return f"{where}{what}; check the path and its permissions"

"""Progress and errors on the terminal."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import MofNCompleteColumn, Progress, TaskID, TextColumn
from rich.text import Text

from glassgait.models.errors import InputError

BAD_INPUT, INTERRUPTED = 2, 130  # exit codes

# Markup is off, since paths and names of gaits may contain brackets. A file has wide lines.
_width = None if sys.stdout.isatty() else 160
console = Console(markup=False, emoji=False, highlight=False, width=_width)
_notes = Console(stderr=True, markup=False, emoji=False, highlight=False, soft_wrap=True)


def note(line: str) -> None:
    """Prints an automatic choice to standard error."""
    _notes.print(Text.assemble(("·", "dim"), " ", line))


def say(line: str) -> None:
    """Prints a line of progress."""
    console.print(Text.assemble(("·", "dim"), " ", line))


@contextmanager
def progress_bar(total: int, done: int = 0) -> Iterator[tuple[Progress, TaskID]]:
    """Shows a progress bar with the time left; a study may set its task's field `text`."""
    _, *columns = Progress.get_default_columns()
    columns += [MofNCompleteColumn(), TextColumn("{task.fields[text]}", markup=False)]
    with Progress(*columns, console=console, refresh_per_second=2) as progress:
        yield progress, progress.add_task("", total=total, completed=done, text="")


@contextmanager
def report_errors() -> Iterator[None]:
    """Ends the process with one sentence, on bad input with exit code 2, on Ctrl-C with 130."""
    try:
        yield
    except InputError as error:
        sentence, code = str(error), BAD_INPUT
    except KeyboardInterrupt:
        sentence, code = "interrupted; what was finished is kept", INTERRUPTED
    else:
        return
    # Escape line breaks and terminal control codes, which a path may contain.
    plain = (c if c.isprintable() else c.encode("unicode_escape").decode() for c in sentence)
    print(f"glassgait: {''.join(plain)}", file=sys.stderr)
    sys.exit(code)

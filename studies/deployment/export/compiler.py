"""Compiling a controller with the system's C compiler."""

import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path

from glassgait.models.errors import InputError, brief
from glassgait.models.export.binding import LoadedController
from glassgait.models.export.controller import ControllerSource
from glassgait.models.files import write_atomically

COMPILER = "cc"

FLAGS = ("-O2", "-Wall", "-Wextra", "-Werror", "-std=c99", "-ffp-contract=off")
"""How a controller's file is compiled, without a warning."""


def has_compiler() -> bool:
    """Returns whether the system has a C compiler."""
    return shutil.which(COMPILER) is not None


def write_source(written: ControllerSource, folder: Path) -> Path:
    """Writes a controller's two files, the header first, and returns the C file's path.

    Raises:
        InputError: if they cannot be written there.
    """
    header, path = (folder / f"{written.name}.{end}" for end in "hc")
    write_atomically(header, written.header)
    try:
        write_atomically(path, written.source)
    except InputError:
        header.unlink(missing_ok=True)
        raise
    return path


def compile_c(source: Path, output: Path, flags: Sequence[str] = FLAGS) -> None:
    """Compiles a C file.

    Raises:
        InputError: if there is no compiler, or it refuses the file.
    """
    if not has_compiler():
        raise InputError(f"there is no C compiler {COMPILER!r}; install one, such as gcc")
    command = [COMPILER, *flags, str(source), "-o", str(output), "-lm"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise InputError(f"{source}: cannot be compiled ({brief(done.stderr)}); mend it")


def load_controller(written: ControllerSource, folder: Path) -> LoadedController:
    """Writes a controller's files into a folder, compiles them there and loads what comes out.

    Raises:
        InputError: if one of these fails.
    """
    source = write_source(written, folder)
    library = source.with_suffix(".so")
    compile_c(source, library, (*FLAGS, "-shared", "-fPIC"))
    return LoadedController(library, written)

"""What importing the project leaves as it was: a person's own process."""

import os
import subprocess
import sys

import pytest

MODULES = """
import importlib, pkgutil, sys
ROOTS = tuple(f"glassgait.{name}" for name in ("models", "systems", "diagrams", "studies"))
MODULES = [*ROOTS]
for root in ROOTS:
    package = importlib.import_module(root)
    MODULES += [found.name for found in pkgutil.walk_packages(package.__path__, f"{root}.")]
"""

OF_OTHERS = (
    MODULES
    + """
for name in MODULES:
    importlib.import_module(name)
print(*(name for name in sys.modules if name.partition(".")[0] != "glassgait"))
"""
)

CHANGES = (
    MODULES
    + """
import logging, os, signal, warnings

# What other packages do when they are imported is theirs.
for name in sys.stdin.read().split():
    try:
        importlib.import_module(name)
    except Exception:
        pass
import matplotlib, numpy

def loggers():
    every = {"": logging.root, **logging.root.manager.loggerDict}
    return {
        name: (list(logger.filters), list(logger.handlers), logger.level)
        for name, logger in every.items()
        if isinstance(logger, logging.Logger)
    }

def state():
    return {
        "environment": dict(os.environ),
        "matplotlib": dict.copy(matplotlib.rcParams),
        "loggers": loggers(),
        "warnings": list(warnings.filters),
        "signals": {number: signal.getsignal(number) for number in signal.valid_signals()},
        "numpy": (numpy.geterr(), numpy.get_printoptions()),
        "hooks": (sys.excepthook, sys.displayhook, sys.unraisablehook),
        "directory": os.getcwd(),
        "path": list(sys.path),
    }

before = state()
for name in MODULES:
    importlib.import_module(name)
    after = state()
    for key in after:
        if after[key] != before[key]:
            print(f"{name} changes {key}")
    before = after
"""
)


def run(code, given=""):
    return subprocess.run(
        [sys.executable, "-c", code],
        input=given,
        capture_output=True,
        text=True,
        check=True,
    ).stdout


@pytest.fixture(scope="module")
def of_others():
    return run(OF_OTHERS)


@pytest.mark.slow
def test_importing_a_module_changes_nothing_of_the_process(of_others):
    assert "numpy" in of_others.split()
    assert run(CHANGES, of_others) == ""


@pytest.mark.skipif(sys.platform != "linux", reason="asks GNU's OpenMP")
@pytest.mark.slow
@pytest.mark.parametrize("command", ["train", "reproduce benchmark"])
def test_threads_of_torch_sleep_between_operations_where_it_trains(command):
    code = f"from glassgait.studies.cli import main; main([*{command!r}.split(), '--help'])"
    message = subprocess.run(
        [sys.executable, "-c", code],
        env=os.environ | {"OMP_DISPLAY_ENV": "VERBOSE"},
        capture_output=True,
        text=True,
        check=True,
    ).stderr
    assert "GOMP_SPINCOUNT = '0'" in message

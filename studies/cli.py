"""The command `glassgait`."""

import os
import sys
from argparse import ArgumentParser
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from typing import Any

from glassgait.models.errors import InputError, unknown_name
from glassgait.studies.common.arguments import refuse_early
from glassgait.studies.common.console import report_errors

COMMANDS = {
    "demo": ("reproduction.demo:Demo", "Replay a trot, distil it quickly, and compare."),
    "train": ("training.command:Train", "Train a neural expert by PPO."),
    "distill": ("distillation.command:Distill", "Distil an expert into readable students."),
    "refine": ("distillation.command:Refine", "Train the numbers of formulas in closed loop."),
    "gait": ("training.descriptions:ShowGait", "Check a gait file, and draw its machine."),
    "robot": ("training.descriptions:CheckRobot", "Check a robot, and let it stand."),
    "evaluate scenarios": ("evaluation.scenarios:Scenarios", "Score policies in scenarios."),
    "evaluate alternation": (
        "evaluation.alternation:Alternation",
        "Let expert and student act in turns, and report the return at every ratio.",
    ),
    "evaluate pushes": ("evaluation.pushes:Pushes", "Draw which pushes policies survive."),
    "importance": ("importance.command:Importance", "Measure which observations students use."),
    "explain page": ("explanation.command:ExplainPage", "Explain every action on a page."),
    "explain formulas": ("explanation.command:ExplainFormulas", "Print formulas as text or LaTeX."),
    "explain interventions": (
        "explanation.interventions:ExplainInterventions",
        "Change a term of a formula, and see whether the robot moves as it says.",
    ),
    "explain counterfactual": (
        "explanation.counterfactual:ExplainCounterfactual",
        "Find the value of an observation at which a joint acts otherwise.",
    ),
    "view": ("view.command:View", "Watch one robot, live in Meshcat or as a replay."),
    "studio": ("studio.command:OpenStudio", "Edit a formula while the robot walks."),
    "verify prove": ("verification.command:Prove", "Prove claims about a policy of formulas."),
    "verify check": ("verification.command:Check", "Check a certificate by independent code."),
    "export": ("export.command:Export", "Write a controller in C, or a network as ONNX."),
    "reproduce paper": ("reproduction.report:Report", "Do what the paper did by its settings."),
    "reproduce report": ("reproduction.report:Report", "Report the shipped experts' students."),
    "reproduce benchmark": ("reproduction.benchmark:Benchmark", "Measure the speed."),
}
"""Class and summary of each command; a class is imported when its command is called."""


def main(arguments: list[str] | None = None) -> None:
    """Runs a command, by default that of the process; bad input ends with exit code 2."""
    with report_errors():
        _run(sys.argv[1:] if arguments is None else arguments)


def command_class(name: str) -> Any:
    """Imports the class of a command."""
    module, _, attribute = COMMANDS[name][0].partition(":")
    return getattr(import_module(f"glassgait.studies.{module}"), attribute)


def _run(arguments: list[str]) -> None:
    # A command is one word or two.
    name, rest = " ".join(arguments[:2]), arguments[2:]
    if arguments and arguments[0] in COMMANDS:
        name, rest = arguments[0], arguments[1:]
    if sys.getfilesystemencoding() != "utf-8":
        raise InputError("Drake needs a locale of UTF-8; set PYTHONUTF8=1, or LC_ALL=C.UTF-8")
    if arguments == ["--version"]:
        print(version("glassgait"))
    elif name in COMMANDS or (name.startswith("reproduce ") and name.endswith(".yaml")):
        refuse_early(name, rest)
        command = _parse(name, rest)
        if getattr(command, "print_settings", False):
            print(command.text(), end="")
        else:
            command.run()
    elif not arguments or arguments[-1] in ("-h", "--help"):
        print(_help([known for known in COMMANDS if known.startswith(" ".join(arguments[:-1]))]))
    else:
        raise unknown_name("command", name, COMMANDS)


def _parse(name: str, arguments: list[str]) -> Any:
    """Returns a command with its settings."""
    import tyro

    if name.split(maxsplit=1)[0] in ("train", "refine", "reproduce"):
        # Between two operations torch's threads would spin, on the cores that physics needs:
        # training would be a seventh slower. OpenMP reads this once, when torch is loaded.
        os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    flags = (tyro.conf.FlagCreatePairsOff, tyro.conf.SuppressFixed)
    prog = f"glassgait {name}"
    if not name.startswith("reproduce ") or name == "reproduce benchmark":
        kind = command_class(name)
        # The file's settings are the defaults of the options.
        parser = ArgumentParser(add_help=False, allow_abbrev=False)
        parser.add_argument("--settings", nargs="?", type=Path)
        path = parser.parse_known_args(arguments)[0].settings
        given = {"default": kind.from_file(path)} if path and hasattr(kind, "from_file") else {}
        return tyro.cli(kind, prog=prog, args=arguments, config=flags, **given)
    from glassgait.studies.reproduction.settings import load_settings, settings_file

    path = settings_file(name.removeprefix("reproduce "))
    kind = command_class("reproduce report")
    published = load_settings(kind, path, quick="--quick" in arguments)
    return tyro.cli(kind, default=published, prog=prog, args=arguments, config=flags)


def _help(names: list[str]) -> str:
    width = max(map(len, names or COMMANDS))
    lines = [f"  {name:{width}}  {COMMANDS[name][1]}" for name in names or COMMANDS]
    purpose = "Legged-robot controllers that a person can read, check and trust."
    head = f"usage: glassgait COMMAND [SETTINGS]\n\n{purpose}\n\n"
    return head + "\n".join(lines) + "\n\n'glassgait COMMAND --help' lists a command's settings."


if __name__ == "__main__":
    main()

"""The command `glassgait`."""

import os
import sys
from argparse import ArgumentParser
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from typing import Any

from glassgait.models.errors import InputError, unknown_name
from glassgait.studies.common.arguments import check_arguments
from glassgait.studies.common.console import report_errors

COMMANDS = {
    "demo": ("reproduction.demo:Demo", "Replay a trot, distil it quickly, and compare."),
    "train": ("training.command:Train", "Train a neural expert by PPO."),
    "distill": ("distillation.command:Distill", "Distil an expert into readable students."),
    "refine": ("distillation.command:Refine", "Fine-tune the numbers of formulas in closed loop."),
    "gait": ("evaluation.descriptions:ShowGait", "Check a gait file and draw its reward machine."),
    "robot": ("evaluation.descriptions:CheckRobot", "Check a robot description and let it stand."),
    "policy check": ("evaluation.policy_check:CheckPolicy", "Try a network of another project."),
    "policy convert": ("evaluation.policy_conversion:ConvertPolicy", "Describe such a network."),
    "evaluate scenarios": ("evaluation.scenarios:Scenarios", "Score policies in scenarios."),
    "evaluate alternation": (
        "evaluation.alternation:Alternation",
        "Report the return at each alternation ratio of expert and student.",
    ),
    "evaluate pushes": ("evaluation.pushes:Pushes", "Plot which pushes policies survive."),
    "importance": ("importance.command:Importance", "Measure which observations students use."),
    "explain page": ("explanation.command:ExplainPage", "Explain every action on a page."),
    "explain formulas": ("explanation.command:ExplainFormulas", "Print formulas as text or LaTeX."),
    "explain interventions": (
        "explanation.interventions:ExplainInterventions",
        "Change a term of a formula and compare the robot's response with its prediction.",
    ),
    "explain counterfactual": (
        "explanation.counterfactual:ExplainCounterfactual",
        "Find the observation value that changes a joint's action.",
    ),
    "view": ("view.command:View", "Watch one robot, live in Meshcat or as a replay."),
    "studio": ("studio.command:OpenStudio", "Edit a formula while the robot walks."),
    "verify prove": ("verification.command:Prove", "Prove claims about a formula policy."),
    "verify check": ("verification.command:Check", "Check a certificate with independent code."),
    "export": ("export.command:Export", "Write a controller in C, or a network as ONNX."),
    "reproduce paper": ("reproduction.report:Report", "Reproduce the paper with its settings."),
    "reproduce report": ("reproduction.report:Report", "Report the shipped experts' students."),
    "reproduce benchmark": ("reproduction.benchmark:Benchmark", "Measure the speed."),
}
"""Class and summary of each command; a class is imported only when its command runs."""


def main(arguments: list[str] | None = None) -> None:
    """Runs a command, by default from `sys.argv`; bad input ends the process with exit code 2."""
    with report_errors():
        _run(sys.argv[1:] if arguments is None else arguments)


def command_class(name: str) -> Any:
    """Imports the class of a command."""
    module, _, attribute = COMMANDS[name][0].partition(":")
    return getattr(import_module(f"glassgait.studies.{module}"), attribute)


def _run(arguments: list[str]) -> None:
    # The name of a command is one word or two.
    name, rest = " ".join(arguments[:2]), arguments[2:]
    if arguments and arguments[0] in COMMANDS:
        name, rest = arguments[0], arguments[1:]
    if sys.getfilesystemencoding() != "utf-8":
        raise InputError("Drake needs a UTF-8 locale; set PYTHONUTF8=1 or LC_ALL=C.UTF-8")
    if arguments == ["--version"]:
        print(version("glassgait"))
    elif name in COMMANDS or (name.startswith("reproduce ") and name.endswith(".yaml")):
        check_arguments(name, rest)
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
        # Keep PyTorch's idle threads from spinning on cores that physics needs, which slows
        # training by a seventh. OpenMP reads this variable once, when PyTorch is loaded.
        os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    flags = (tyro.conf.FlagCreatePairsOff, tyro.conf.SuppressFixed)
    prog = f"glassgait {name}"
    if not name.startswith("reproduce ") or name == "reproduce benchmark":
        cls = command_class(name)
        # A settings file gives the defaults of the options.
        parser = ArgumentParser(add_help=False, allow_abbrev=False)
        parser.add_argument("--settings", nargs="?", type=Path)
        path = parser.parse_known_args(arguments)[0].settings
        default = {"default": cls.from_file(path)} if path and hasattr(cls, "from_file") else {}
        return tyro.cli(cls, prog=prog, args=arguments, config=flags, **default)
    from glassgait.studies.reproduction.settings import load_settings, settings_file

    path = settings_file(name.removeprefix("reproduce "))
    cls = command_class("reproduce report")
    settings = load_settings(cls, path, quick="--quick" in arguments)
    return tyro.cli(cls, default=settings, prog=prog, args=arguments, config=flags)


def _help(names: list[str]) -> str:
    width = max(map(len, names or COMMANDS))
    lines = [f"  {name:{width}}  {COMMANDS[name][1]}" for name in names or COMMANDS]
    purpose = "Legged-robot controllers that a person can read, check and trust."
    head = f"usage: glassgait COMMAND [SETTINGS]\n\n{purpose}\n\n"
    return head + "\n".join(lines) + "\n\n'glassgait COMMAND --help' lists a command's settings."


if __name__ == "__main__":
    main()

"""The command `glassgait`."""

import os
import sys
from importlib import import_module
from importlib.metadata import version
from typing import Any

from glassgait.models.errors import InputError, shown
from glassgait.studies.common.console import report_errors

COMMANDS = {
    "demo": ("reproduction.demo:Demo", "Replay a trot, distil it quickly, and compare."),
    "train": ("training.command:Train", "Train a neural expert by PPO."),
    "distill": (
        "distillation.command:Distill",
        "Distil an expert into readable students by DAgger with alternation.",
    ),
    "refine": (
        "distillation.command:Refine",
        "Continue to train the numbers of a policy of formulas in closed loop, by PPO.",
    ),
    "gait": ("training.gait_command:ShowGait", "Check a gait file, and draw its reward machine."),
    "robot": (
        "training.robot_command:CheckRobot",
        "Check a robot description, robot.yaml and URDF, and let the robot stand.",
    ),
    "evaluate scenarios": (
        "evaluation.scenarios:Scenarios",
        "Let policies walk alone in every scenario, and report scores and falls.",
    ),
    "evaluate alternation": (
        "evaluation.alternation:Alternation",
        "Let expert and student act by turns, and report the return at every ratio.",
    ),
    "evaluate pushes": (
        "evaluation.pushes:Pushes",
        "Push walking robots from every side, and draw which pushes each policy survives.",
    ),
    "importance": (
        "importance.command:Importance",
        "Measure which observations each student uses, and draw its trees and functions.",
    ),
    "explain page": (
        "explanation.command:ExplainPage",
        "Roll a student out alone and write a page that explains its every action.",
    ),
    "explain formulas": (
        "explanation.command:ExplainFormulas",
        "Print the formulas of a policy, as the text of its file or as LaTeX.",
    ),
    "explain interventions": (
        "explanation.interventions:ExplainInterventions",
        "Change a term of a policy of formulas, and see whether the robot moves as it says.",
    ),
    "explain counterfactual": (
        "explanation.counterfactual:ExplainCounterfactual",
        "Find the value of an observation at which a joint would do otherwise.",
    ),
    "view": (
        "view.command:View",
        "Watch one robot, live in Meshcat with sliders or as fast as it goes.",
    ),
    "studio": (
        "studio.command:OpenStudio",
        "Change a formula in the browser and watch the robot answer.",
    ),
    "verify prove": (
        "verification.command:Prove",
        "Prove what a policy can never do, or find the observation where it does.",
    ),
    "verify check": (
        "verification.command:Check",
        "Check a certificate by independent code.",
    ),
    "export": (
        "export.command:Export",
        "Write a controller as one C file, or a network as ONNX, and check it against Python.",
    ),
    "reproduce paper": (
        "reproduction.report:Report",
        "Do what the paper did by its settings: train, distil, evaluate and explain.",
    ),
    "reproduce report": (
        "reproduction.report:Report",
        "Distil, evaluate and explain the shipped experts, and report them beside the paper.",
    ),
    "reproduce benchmark": (
        "reproduction.benchmark:Benchmark",
        "Measure training throughput and the time of one action, as ratios.",
    ),
}
"""Class and summary of each command; a class is imported when its command is called."""


def main(arguments: list[str] | None = None) -> None:
    """Runs a command; bad input ends in one sentence and exit code 2.

    Args:
        arguments: The command and its settings; those that the process was called with by default.
    """
    with report_errors():
        _run(sys.argv[1:] if arguments is None else arguments)


def command_class(name: str) -> Any:
    """Imports the class of a command."""
    module, _, attribute = COMMANDS[name][0].partition(":")
    return getattr(import_module(f"glassgait.studies.{module}"), attribute)


def _run(arguments: list[str]) -> None:
    name, rest = " ".join(arguments[:2]), arguments[2:]
    if arguments and arguments[0] in COMMANDS:
        name, rest = arguments[0], arguments[1:]
    if arguments == ["--version"]:
        print(version("glassgait"))
    elif name in COMMANDS or (name.startswith("reproduce ") and name.endswith(".yaml")):
        _parse(name, rest).run()
    elif not arguments or arguments[-1] in ("-h", "--help"):
        print(_help([known for known in COMMANDS if known.startswith(" ".join(arguments[:-1]))]))
    else:
        raise InputError(f"unknown command {shown(name)}; 'glassgait --help' lists the commands")


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
        return tyro.cli(command_class(name), prog=prog, args=arguments, config=flags)
    from glassgait.studies.reproduction.settings import load_settings, settings_file

    path = settings_file(name.removeprefix("reproduce "))
    kind = command_class("reproduce report")
    published = load_settings(kind, path, quick="--quick" in arguments)
    return tyro.cli(kind, default=published, prog=prog, args=arguments, config=flags)


def _help(names: list[str]) -> str:
    width = max(map(len, names or COMMANDS))
    lines = [f"  {name:{width}}  {COMMANDS[name][1]}" for name in names or COMMANDS]
    return "\n".join(
        [
            "usage: glassgait COMMAND [SETTINGS]",
            "",
            "Legged-robot controllers that a person can read, check and trust.",
            "",
            *lines,
            "",
            "'glassgait COMMAND --help' lists a command's settings.",
        ]
    )


if __name__ == "__main__":
    main()

"""The command `glassgait`."""

import os
import sys
from difflib import get_close_matches
from importlib import import_module
from pathlib import Path
from typing import Any

from glassgait.models.errors import InputError, shown
from glassgait.studies.common.exit_codes import (
    end_at_once_from_now_on,
    ended_at_once,
    report_errors,
    take_signals,
)

PURPOSES: dict[str, dict[str, tuple[str, str]]] = {
    "see it all in minutes": {
        "demo": (
            "reproduction.demo:Demo",
            "Distil the trot's expert quickly, compare, and write runs/demo/report.html.",
        ),
    },
    "make controllers": {
        "train": ("training.command:Train", "Train a neural expert by PPO."),
        "distill": (
            "distillation.command:Distill",
            "Distil an expert into glass-box students by DAgger with alternation.",
        ),
        "refine": (
            "distillation.refinement:Refine",
            "Let a policy of formulas learn on in closed loop, by PPO: its numbers change alone.",
        ),
        "gait": (
            "training.gait_command:ShowGait",
            "Check a gait file and draw its reward machine.",
        ),
        "robot": (
            "training.robot_command:CheckRobot",
            "Check a robot description, robot.yaml and URDF, and let the robot stand.",
        ),
    },
    "measure": {
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
            "Measure what each student looks at, and take it away to see whether that is true.",
        ),
    },
    "read": {
        "explain page": (
            "explanation.command:ExplainPage",
            "Roll a student out alone and write a page that explains its every action.",
        ),
        "explain formulas": (
            "explanation.command:ExplainFormulas",
            "Print the formulas of a policy, as the text of its file or as LaTeX.",
        ),
        "explain interventions": (
            "explanation.interventions.command:ExplainInterventions",
            "Test what a policy of formulas says: change a term, and see whether the robot moves "
            "so.",
        ),
        "explain counterfactual": (
            "explanation.counterfactual:ExplainCounterfactual",
            "Find the value of each observation at which a joint's target passes a level.",
        ),
        "view": (
            "view.command:View",
            "Watch one robot, live in Meshcat with sliders or as fast as it goes.",
        ),
        "studio": (
            "studio.command:OpenStudio",
            "Change a formula in the browser and watch the robot answer.",
        ),
    },
    "prove": {
        "verify prove": (
            "verification.command:Prove",
            "Prove what a policy can never do, or find the observation where it does.",
        ),
        "verify check": (
            "verification.command:Check",
            "Check a certificate by arithmetic of its own, without the program that proved it.",
        ),
    },
    "take to a robot": {
        "export": (
            "export.command:Export",
            "Write a controller as one C file, or its policy as ONNX, and check it against Python.",
        ),
    },
    "reproduce": {
        "reproduce paper": (
            "reproduction.report:Report",
            "Do what the paper did by its own settings: train, distil, evaluate and explain.",
        ),
        "reproduce report": (
            "reproduction.report:Report",
            "Distil, evaluate and explain the shipped experts, and write one report beside the "
            "paper.",
        ),
        "reproduce benchmark": (
            "reproduction.benchmark:Benchmark",
            "Measure training throughput and the time of one action, as ratios.",
        ),
    },
}
"""Class and summary of each command by purpose: the help imports neither Drake nor torch."""

COMMANDS = {name: entry for commands in PURPOSES.values() for name, entry in commands.items()}
"""Class and summary of each command. A command is a word, or a group and one of its members."""

TRAINS = ("train", "refine", "reproduce")

MOVED = {
    "robustness": "evaluate scenarios",
    "compare": "evaluate scenarios",
    "pushes": "evaluate pushes",
    "show": "explain formulas",
    "claims": "explain interventions",
    "counterfactual": "explain counterfactual",
    "certify": "verify prove",
    "check": "verify check",
    "rollout": "view",
    "report": "reproduce report",
    "benchmark": "reproduce benchmark",
}
"""Where the commands of an earlier version are now."""


def main(arguments: list[str] | None = None) -> None:
    """Runs a command; bad input ends in one sentence and exit code 2.

    Ctrl-C ends in one with exit code 130, SIGTERM with 143, SIGHUP with 129.

    Args:
        arguments: The command and its settings; those that the process was called with by default.
    """
    if arguments is None:
        take_signals()
    try:
        with report_errors():
            _run(sys.argv[1:] if arguments is None else arguments)
    finally:
        if arguments is None:
            end_at_once_from_now_on()


def command_class(name: str) -> Any:
    """Imports the class of a command."""
    module, _, attribute = COMMANDS[name][0].partition(":")
    return getattr(import_module(f"glassgait.studies.{module}"), attribute)


def _run(arguments: list[str]) -> None:
    match arguments:
        case [] | ["-h" | "--help", *_]:
            print(_help(PURPOSES))
        case ["--version", *_]:
            with ended_at_once():
                print(_version())
        case [group] | [group, "-h" | "--help", *_] if group not in COMMANDS and _members(group):
            if len(arguments) == 1:
                raise InputError(f"{group}: name what to do, {_one_of(_members(group))}")
            print(_help({group: {name: COMMANDS[name] for name in _members(group)}}, f"{group} …"))
        case _:
            name, rest = _command_of(arguments)
            _check_working_folder()
            with ended_at_once():
                command = _parse(name, rest)
            command.run()


def _command_of(arguments: list[str]) -> tuple[str, list[str]]:
    """Splits arguments into the name of a command and its settings; the longest name counts."""
    match arguments:
        case ["reproduce", file, *rest] if Path(file).suffix == ".yaml":
            return f"reproduce {file}", rest
    for name in sorted(COMMANDS, key=lambda name: -len(name.split())):
        first, *further = name.split()
        if arguments[0] != first:
            continue
        # An option may stand anywhere after the command, a member of a group only first.
        last = len(arguments) if name.count("--") else 2
        for start in range(1, last):
            end = start + len(further)
            if arguments[start:end] == further:
                return name, arguments[1:start] + arguments[end:]
    raise InputError(_unknown(arguments))


def _unknown(arguments: list[str]) -> str:
    first = arguments[0]
    if members := _members(first):
        known = [name.split()[1] for name in members]
        near = get_close_matches(arguments[1], known, n=1)
        meant = f"did you mean '{first} {near[0]}'? It is " if near else ""
        return f"{first}: unknown {shown(arguments[1])}; {meant}{_one_of(members)}"
    if first in MOVED:
        return f"unknown command {shown(first)}; it is now '{MOVED[first]}'"
    words = list(dict.fromkeys(name.split()[0] for name in COMMANDS))
    near = get_close_matches(first, [*words, *MOVED], n=1)
    meant = f"did you mean '{MOVED.get(near[0], near[0])}'? The" if near else "the"
    return f"unknown command {shown(first)}; {meant} commands are {', '.join(words)}"


def _members(group: str) -> list[str]:
    return [name for name in COMMANDS if name.startswith(f"{group} ") and "--" not in name]


def _one_of(members: list[str]) -> str:
    return f"one of {', '.join(name.split()[1] for name in members)}"


def _check_working_folder() -> None:
    # The libraries that are imported next would end the process where it is gone.
    try:
        Path.cwd()
    except FileNotFoundError as error:
        raise InputError("the working folder is gone; change to one that is there") from error


def _parse(name: str, arguments: list[str]) -> Any:
    # Imported here: Ctrl-C is handled by now, and other commands' modules stay out.
    import tyro  # noqa: PLC0415

    if name.split(maxsplit=1)[0] in TRAINS:
        # Between two operations torch's threads would spin, on the cores that physics needs:
        # training would be a seventh slower. OpenMP reads this once, when torch is loaded.
        os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    flags = (tyro.conf.FlagCreatePairsOff, tyro.conf.SuppressFixed)
    prog = f"glassgait {name}"
    if not name.startswith("reproduce "):
        return tyro.cli(command_class(name), prog=prog, args=arguments, config=flags)
    # Imported here: YAML and pandas are not for the help.
    from glassgait.studies.reproduction.settings import (  # noqa: PLC0415
        load_settings,
        settings_file,
        study_of,
    )

    path = settings_file(name.removeprefix("reproduce "))
    kind = command_class(f"reproduce {study_of(path)}")
    published = load_settings(kind, path, quick="--quick" in arguments)
    return tyro.cli(kind, default=published, prog=prog, args=arguments, config=flags)


def _version() -> str:
    from importlib.metadata import PackageNotFoundError, version  # noqa: PLC0415

    try:
        return version("glassgait")
    except PackageNotFoundError as error:
        raise InputError("the version is not known; install the project with pip") from error


def _help(purposes: dict[str, dict[str, tuple[str, str]]], command: str = "COMMAND") -> str:
    width = max(len(name) for commands in purposes.values() for name in commands)
    lines = []
    for purpose, commands in purposes.items():
        lines += ["", f"{purpose}:"]
        lines += [f"  {name:{width}}  {summary}" for name, (_, summary) in commands.items()]
    return "\n".join(
        [
            f"usage: glassgait {command} [SETTINGS]",
            "",
            "Legged-robot controllers that a person can read, check and trust.",
            *lines,
            "",
            f"'glassgait {command} --help' lists a command's settings;",
            "'glassgait --version' prints the version.",
        ]
    )


if __name__ == "__main__":
    main()

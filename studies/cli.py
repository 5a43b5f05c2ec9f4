"""The command `glassgait`."""

import os
import sys
from importlib import import_module
from pathlib import Path
from typing import Any

from glassgait.models.errors import InputError, shown
from glassgait.studies.common.exit_codes import (
    end_at_once_from_now_on,
    ended_at_once,
    take_signals,
    told_plainly,
)

COMMANDS = {
    "demo": (
        "glassgait.studies.reproduction.demo.command:Demo",
        "Distil the shipped trot expert quickly, compare, and write runs/demo/report.html.",
    ),
    "train": ("glassgait.studies.training.command:Train", "Train a neural expert by PPO."),
    "distill": (
        "glassgait.studies.distillation.command:Distill",
        "Distil an expert into glass-box students by DAgger with alternation.",
    ),
    "refine": (
        "glassgait.studies.distillation.refinement.command:Refine",
        "Let a policy of formulas learn on in closed loop, by PPO: its numbers change alone.",
    ),
    "evaluate": (
        "glassgait.studies.evaluation.command:Evaluate",
        "Roll policies out in closed loop and score them.",
    ),
    "robustness": (
        "glassgait.studies.evaluation.robustness.command:Robustness",
        "Let the expert and every student walk alone in every scenario, and tell who falls where.",
    ),
    "assurance": (
        "glassgait.studies.evaluation.assurance.command:Assurance",
        "Let a student act in distribution, and the expert elsewhere, and count falls.",
    ),
    "compare": (
        "glassgait.studies.evaluation.compare.command:Compare",
        "Set two policies side by side: their lines, targets, scores, and one replay of both.",
    ),
    "convergence": (
        "glassgait.studies.reproduction.convergence.command:Convergence",
        "Drop the robot and roll an expert out with every contact solver and time step.",
    ),
    "pareto": (
        "glassgait.studies.distillation.pareto.command:Pareto",
        "Fit formulas of growing size, let each walk alone, and name the smallest that walk.",
    ),
    "curricula": (
        "glassgait.studies.reproduction.curricula.command:Curricula",
        "Distil by other curricula with as many samples, and let the students walk alone.",
    ),
    "importance": (
        "glassgait.studies.importance.command:Importance",
        "Measure what each student looks at, and take it away to see whether that is true.",
    ),
    "symmetry": (
        "glassgait.studies.evaluation.symmetry.command:Symmetry",
        "Measure whether an expert and its students treat left and right alike.",
    ),
    "pushes": (
        "glassgait.studies.evaluation.pushes.command:PushBasin",
        "Push walking robots from every side, and draw which pushes each policy survives.",
    ),
    "transitions": (
        "glassgait.studies.evaluation.transitions.command:Transitions",
        "Change the gait of walking robots, each to each, and tell who falls and how soon.",
    ),
    "stability": (
        "glassgait.studies.evaluation.stability.command:Stability",
        "Tell whether small differences grow or fade from one stride to the next, and test it.",
    ),
    "claims": (
        "glassgait.studies.explanation.interventions.command:Claims",
        "Test what a policy of formulas says: change a term, and see whether the robot moves so.",
    ),
    "certify": (
        "glassgait.studies.verification.command:Certify",
        "Prove what a policy can never do, or find the observation where it does.",
    ),
    "check": (
        "glassgait.studies.verification.check_command:Check",
        "Check a certificate by arithmetic of its own, without the program that proved it.",
    ),
    "explain": (
        "glassgait.studies.explanation.command:Explain",
        "Roll a student out alone and write a page that explains its every action.",
    ),
    "counterfactual": (
        "glassgait.studies.explanation.counterfactuals.command:Counterfactual",
        "Ask what a robot would have had to observe for a joint to do otherwise, and let it.",
    ),
    "show": (
        "glassgait.studies.explanation.show_command:Show",
        "Print the formulas of a policy: the lines that its file holds, and that act.",
    ),
    "export": (
        "glassgait.studies.deployment.export.command:Export",
        "Write a controller as one C file, or its policy as ONNX, and check it against Python.",
    ),
    "drive": (
        "glassgait.studies.deployment.drive.command:Drive",
        "Run a robot and its controller as two processes over LCM, and count what is late or lost.",
    ),
    "report": (
        "glassgait.studies.reproduction.report.command:Report",
        "Distil, evaluate and explain the shipped experts, and write one report beside the paper.",
    ),
    "reproduce": (
        "glassgait.studies.reproduction.command:Reproduce",
        "Do what the paper did by its own settings: train, distil, evaluate and explain.",
    ),
    "rollout": (
        "glassgait.studies.view.command:ShowRollout",
        "Watch one robot, live in Meshcat with sliders or as fast as it goes.",
    ),
    "gait": (
        "glassgait.studies.training.gait_command:ShowGait",
        "Check a gait file and draw its reward machine.",
    ),
    "benchmark": (
        "glassgait.studies.reproduction.benchmark.command:Benchmark",
        "Measure training throughput and the time of one action, as ratios.",
    ),
}
"""Class and summary of each command: the help is told without importing Drake and torch."""

TRAINS = ("train", "refine", "benchmark", "reproduce")


def main(arguments: list[str] | None = None) -> None:
    """Runs a command; bad input ends in one sentence and exit code 2.

    Ctrl-C ends in one with exit code 130, SIGTERM with 143.

    Args:
        arguments: The command and its settings; those that the process was called with by default.
    """
    if arguments is None:
        take_signals()
    try:
        with told_plainly():
            _run(sys.argv[1:] if arguments is None else arguments)
    finally:
        if arguments is None:
            end_at_once_from_now_on()


def _run(arguments: list[str]) -> None:
    match arguments:
        case [] | ["-h" | "--help", *_]:
            print(_help())
        case ["--version", *_]:
            with ended_at_once():
                print(_version())
        case [name, *rest] if name in COMMANDS:
            _check_working_folder()
            with ended_at_once():
                command = _parse(name, rest)
            command.run()
        case [name, *_]:
            raise InputError(
                f"there is no command {shown(name)}; the commands are {', '.join(COMMANDS)}"
            )


def _check_working_folder() -> None:
    # The libraries that are imported next would end the process where it is gone.
    try:
        Path.cwd()
    except FileNotFoundError as error:
        raise InputError("the working folder is gone; change to one that is there") from error


def _parse(name: str, arguments: list[str]) -> Any:
    # Imported here: Ctrl-C is told plainly by now, and other commands' modules stay out.
    import tyro  # noqa: PLC0415

    if name in TRAINS:
        # Between two operations torch's threads would spin, on the cores that physics needs:
        # training would be a seventh slower. OpenMP reads this once, when torch is loaded.
        os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    module, _, attribute = COMMANDS[name][0].partition(":")
    kind = getattr(import_module(module), attribute)
    flags = (tyro.conf.FlagCreatePairsOff,)
    return tyro.cli(kind, prog=f"glassgait {name}", args=arguments, config=flags)


def _version() -> str:
    from importlib.metadata import PackageNotFoundError, version  # noqa: PLC0415

    try:
        return version("glassgait")
    except PackageNotFoundError as error:
        raise InputError("the version is not known; install the project with pip") from error


def _help() -> str:
    width = max(map(len, COMMANDS))
    return "\n".join(
        [
            "usage: glassgait COMMAND [SETTINGS]",
            "",
            "Legged-robot controllers that a person can read, check and trust.",
            "",
            "commands:",
            *(f"  {name:{width}}  {summary}" for name, (_, summary) in COMMANDS.items()),
            "",
            "'glassgait COMMAND --help' lists a command's settings;",
            "'glassgait --version' tells the version.",
        ]
    )


if __name__ == "__main__":
    main()

"""The command `glassgait`."""

import sys
from importlib import import_module
from typing import Any

import tyro

from studies.console import told_plainly

COMMANDS = {
    "demo": "studies.demo.command:Demo",
    "train": "studies.training.command:Train",
    "distill": "studies.distillation.command:Distill",
    "evaluate": "studies.evaluation.command:Evaluate",
    "convergence": "studies.convergence.command:Convergence",
    "front": "studies.front.command:Front",
    "curricula": "studies.curricula.command:Curricula",
    "importance": "studies.importance.command:Importance",
    "explain": "studies.explanation.command:Explain",
    "report": "studies.report.command:Report",
    "rollout": "studies.rollout.command:ShowRollout",
    "gait": "studies.gait_command:ShowGait",
    "benchmark": "studies.benchmark.command:Benchmark",
}


def main(arguments: list[str] | None = None) -> None:
    """Runs a subcommand; bad input ends in one sentence and exit code 2."""
    arguments = sys.argv[1:] if arguments is None else arguments
    flags = (tyro.conf.FlagCreatePairsOff,)
    with told_plainly():
        if arguments and arguments[0] in COMMANDS:
            # Only the command that runs is imported: the others bring Drake and torch along.
            name, *rest = arguments
            command = tyro.cli(_load(name), prog=f"glassgait {name}", args=rest, config=flags)
        else:
            command = tyro.extras.subcommand_cli_from_dict(
                {name: _load(name) for name in COMMANDS},
                prog="glassgait",
                description="Legged-robot controllers that a person can read, check and trust.",
                args=arguments,
                config=flags,
            )
        command.run()


def _load(name: str) -> Any:
    module, _, attribute = COMMANDS[name].partition(":")
    return getattr(import_module(module), attribute)


if __name__ == "__main__":
    main()

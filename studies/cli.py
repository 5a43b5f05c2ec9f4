"""The command `glassgait`."""

import tyro

from studies.benchmark.command import Benchmark
from studies.console import told_plainly
from studies.demo.command import Demo
from studies.distillation.command import Distill
from studies.evaluation.command import Evaluate
from studies.gait_command import ShowGait
from studies.rollout.command import ShowRollout
from studies.training.command import Train

COMMANDS = {
    "demo": Demo,
    "train": Train,
    "distill": Distill,
    "evaluate": Evaluate,
    "rollout": ShowRollout,
    "gait": ShowGait,
    "benchmark": Benchmark,
}


def main(arguments: list[str] | None = None) -> None:
    """Runs a subcommand; bad input ends in one sentence and exit code 2."""
    with told_plainly():
        command = tyro.extras.subcommand_cli_from_dict(
            COMMANDS,
            prog="glassgait",
            description="Legged-robot controllers that a person can read, check and trust.",
            args=arguments,
            config=(tyro.conf.FlagCreatePairsOff,),
        )
        command.run()


if __name__ == "__main__":
    main()

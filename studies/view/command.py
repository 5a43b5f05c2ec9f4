"""`glassgait view`: watches one robot."""

from dataclasses import field, replace
from pathlib import Path
from typing import ClassVar

import yaml

from glassgait.diagrams.commands import DrawnCommands, FixedCommand, SliderCommand
from glassgait.diagrams.rollout import Rollout
from glassgait.diagrams.scenario import NOMINAL_SCENARIO, load_scenario, scenario_name
from glassgait.diagrams.visualization import open_meshcat
from glassgait.models.errors import InputError
from glassgait.models.files import write_atomically
from glassgait.models.policies.controller import Controller
from glassgait.models.policies.described import DescribedPolicy
from glassgait.models.robots import kinematics
from glassgait.models.settings import Seed, checked
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.gait import Gait
from glassgait.studies.common.console import console
from glassgait.studies.common.experiment import OneGait
from glassgait.studies.common.figures import gait_figure, save_figure
from glassgait.studies.common.jobs import Steps
from glassgait.studies.common.rollouts import CommandOverride, play
from glassgait.studies.common.run import default_folder, refuse_run, to_plain
from glassgait.studies.view.live import play_live


@checked
class ViewCommand(CommandOverride):
    """A command override that can also command a speed to the left.

    Attributes:
        left: Speed to the left (m/s), also with --live; only for a network of another project.
    """

    left: float = 0.0

    def override(self, gait: Gait, command: object = None) -> FixedCommand:
        return CommandOverride(self.speed, self.yaw_rate, self.dwell).override(gait, command)

    def commanding(self, controller: Controller) -> Controller:
        """Returns the controller, with `left` as its policy's command."""
        if self.left == 0.0:
            return controller
        policy = controller.policy
        if not isinstance(policy, DescribedPolicy):
            raise InputError(
                "view: --command.left works only with networks of other projects; leave it out"
            )
        least, greatest = policy.description.commands.left
        if not least <= self.left <= greatest:
            raise InputError(
                f"--command.left is {self.left:g}; give {least:g} to {greatest:g}, as "
                "'commands.left' of the description allows"
            )
        return Controller(policy.commanded_left(self.left))


@checked
class View(OneGait):
    """Watch one robot: record a replay, or steer it live in Meshcat.

    Attributes:
        policy: `expert`, a kind of student, or the path of a policy file.
        live: Run in real time in Meshcat, with commands from sliders, until the button `stop and
            save` or Ctrl-C; a robot that falls restarts, and the last minute is saved.
        scenario: Name of a scenario that ships, or path of a scenario file.
        command: Command that replaces the scenario's, without --live. Missing values are the
            scenario's or, if it has none, 0.5 m/s or the gait's greatest speed.
        n_steps: Control steps of the rollout, 500 by default; a fall ends it earlier. Not with
            --live.
        seed: Seed of the sensors' noise, of pushes and of drawn commands.
        output: Folder of the replay, or its file, ending in .html; runs/view/<gait> by default.
    """

    title: ClassVar[str] = "view"

    policy: str = "expert"
    live: bool = False
    scenario: str = NOMINAL_SCENARIO
    command: ViewCommand = field(default_factory=ViewCommand)
    n_steps: Steps | None = None
    seed: Seed = 0
    output: Path | None = None

    def __post_init__(self) -> None:
        if self.live and self.n_steps is not None:
            raise InputError("view: --live runs until it is stopped; leave --n-steps out")

    def run(self) -> None:
        # Load the policy and the scenario.
        policies = self.policies()
        gait, controller = policies.gait, self.command.commanding(policies.controller(self.policy))
        scenario = load_scenario(self.scenario)
        if self.live:
            scenario = replace(scenario, command=SliderCommand())
        elif self.command != ViewCommand() or scenario.command == DrawnCommands():
            scenario = replace(scenario, command=self.command.override(gait, scenario.command))

        # File names contain the policy and the scenario.
        folder = self.output or default_folder(self.title, controller.robot.name) / gait.name
        parts = [Path(self.policy).stem, scenario_name(self.scenario)]
        stem = folder / "_".join(part for part in parts if part != NOMINAL_SCENARIO)
        if folder.suffix == ".html":
            folder, stem = folder.parent, folder.with_suffix("")
        refuse_run(folder)

        # Roll out in real time, or as fast as possible.
        meshcat, replay = open_meshcat(), Path(f"{stem}.html")
        if self.live:
            rollout = play_live(gait, controller, scenario, meshcat, replay, seed=self.seed)
            ending = "stopped"
        else:
            options = {"n_steps": self.n_steps or 500, "seed": self.seed}
            rollout = play(gait, controller, scenario, meshcat, replay, **options)
            ending = "fell" if rollout.failed else "stayed up"

        # Write the settings beside the replay, so that it can be repeated.
        record = {**to_plain(self), "scenario": to_plain(scenario)}
        write_atomically(Path(f"{stem}.yaml"), yaml.safe_dump(record, sort_keys=False))
        save_figure(gait_figure(rollout, gait, f"{gait.name}, {self.policy}"), stem)
        console.print(f"{ending} after {rollout.time[-1]:.2f} s; {_summary(rollout, gait)}")
        console.print(f"replay, gait diagram and settings written to {stem}.*")


def _summary(rollout: Rollout, gait: Gait) -> str:
    speed = kinematics.base_velocity(rollout["state"])[0][:, 0].mean()
    commanded = rollout["command"][:, 0].mean()
    n_steps = len(rollout.time) - 1
    rhythm = rollout["served_dwell"][1:].sum() / max(n_steps, 1)
    reward = rollout["reward"][1:].sum()
    kept = f", rhythm {rhythm:.2f} of the commanded" if gait.transitions else ""
    return (
        f"return {reward:.0f}, mean speed {speed:.2f} m/s ({commanded:.2f} commanded), "
        f"{speed * n_steps * CONTROL_PERIOD:.2f} m forward{kept}"
    )

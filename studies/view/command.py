"""`glassgait view`: watches one robot."""

from dataclasses import asdict, field, replace
from pathlib import Path
from typing import Annotated, ClassVar

import yaml
from annotated_types import Ge

from glassgait.diagrams.commands import FixedCommand, SliderCommand
from glassgait.diagrams.rollout import Rollout
from glassgait.diagrams.scenario import TRAINING, Scenario, load_scenario, scenario_name
from glassgait.diagrams.visualization import open_meshcat
from glassgait.models.errors import InputError
from glassgait.models.files import write_atomically
from glassgait.models.policies.controller import AlternatingController
from glassgait.models.policies.library import find_gait
from glassgait.models.robots import kinematics
from glassgait.models.settings import Seed, Settings, checked
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.alternation import parse_ratio, ratio_title
from glassgait.models.task.gait import Gait
from glassgait.studies.common.console import console
from glassgait.studies.common.experiment import PolicySource
from glassgait.studies.common.figures import save_figure
from glassgait.studies.common.gait_figure import gait_figure
from glassgait.studies.common.policies import EXPERT, Policies, find_policies_of
from glassgait.studies.common.rollouts import Steps, play
from glassgait.studies.common.run import default_folder, refuse_run, to_plain
from glassgait.studies.view.live import play_live
from glassgait.studies.view.stills import gait_strip

N_STEPS = 500
"""Control steps of a rollout that nobody watches, unless a person names others."""


@checked
class OwnCommand(Settings):
    """A command in place of the scenario's.

    Attributes:
        speed: Forward speed (m/s).
        yaw_rate: Yaw rate (rad/s).
        dwell: Iterations to stay in a state of the reward machine (control steps).
    """

    title: ClassVar[str] = "command"

    speed: float | None = None
    yaw_rate: float | None = None
    dwell: Annotated[int, Ge(1)] | None = None

    @property
    def given(self) -> dict[str, float]:
        """What is not left out, by name."""
        return {name: value for name, value in asdict(self).items() if value is not None}

    def over(self, scenario: Scenario) -> Scenario:
        """Returns a scenario with this command."""
        given = self.given
        if scenario.names_a_command and not given:
            return scenario
        own = scenario.command
        fixed = own if isinstance(own, FixedCommand) else FixedCommand()
        return replace(scenario, command=replace(fixed, **given))


@checked
class View(PolicySource):
    """Watch one robot, live in Meshcat with sliders or as fast as it goes.

    Attributes:
        gait: Name of a gait, or path of a gait file.
        policy: `expert`, a kind of student, or the path of a policy file.
        ratio: Share of steps at which the expert acts: 1, 1/2, …, or 0 for the student alone; by
            default the policy acts alone.
        stills: Also draw stills of the last cycle above the feet's contacts; needs EGL.
        live: Play at real time in Meshcat, commands from sliders, until the button `stop and save`
            or Ctrl-C; a robot that falls is put back on its feet, and the last minute is kept.
        scenario: Name of a scenario that ships, or path of a scenario file.
        command: The command, in place of the scenario's, where there are no sliders; what is left
            out is the scenario's. A scenario that names no command asks for 0.5 m/s.
        n_steps: Control steps of the rollout, 500 by default; a fall ends it before. Not with
            --live.
        seed: Seed of the sensors' noise, of pushes and of drawn commands.
        output: Folder of the replay; runs/view/<gait> by default.
    """

    title: ClassVar[str] = "view"

    gait: str = "trot"
    policy: str = "expert"
    ratio: str | None = None
    stills: bool = False
    live: bool = False
    scenario: str = TRAINING
    command: OwnCommand = field(default_factory=OwnCommand)
    n_steps: Steps | None = None
    seed: Seed = 0
    output: Path | None = None

    def __post_init__(self) -> None:
        if self.live and self.n_steps is not None:
            raise InputError("view: --live goes on until it is stopped; leave --n-steps out")

    def run(self) -> None:
        """Plays, and writes replay, gait diagram and, beside them, these settings."""
        gait = find_gait(self.gait, self.robot)
        (found,) = find_policies_of([gait], self.source, [self.policy], self.robot).values()
        gait, policy = found.gait, self._controller(found)
        scenario = load_scenario(self.scenario)
        if self.live:
            scenario = replace(scenario, command=SliderCommand())
        else:
            scenario = self.command.over(scenario)
        stem = self._stem(gait, policy)
        refuse_run(stem.parent)
        rollout, ending = self._play(gait, policy, scenario, stem)
        record = {**to_plain(self), "scenario": scenario.to_plain()}
        write_atomically(_beside(stem, ".yaml"), yaml.safe_dump(record, sort_keys=False))
        self._draw(gait, policy, rollout, stem)
        console.print(ending)
        console.print(_summary(rollout, scenario))
        stills = f"; stills to {stem}_stills.png and .pdf" if self.stills else ""
        console.print(f"replay and gait diagram written to {stem}.html, .png and .pdf{stills}")

    def _controller(self, found: Policies) -> AlternatingController:
        """Loads the controller."""
        controller = found.controller(self.policy)
        student = None if self.policy == EXPERT else controller.policy
        period = parse_ratio(
            ("1" if student is None else "0") if self.ratio is None else self.ratio
        )
        if student is None and self.ratio is not None:
            raise InputError("--ratio shares steps with a student; name one with --policy")
        return AlternatingController(controller.expert, student, period)

    def _ratio(self, policy: AlternatingController) -> str | None:
        """Returns the ratio as the paper writes it, so that 0.25 and 1/4 are one."""
        return None if self.ratio is None else ratio_title(policy.period)

    def _stem(self, gait: Gait, policy: AlternatingController) -> Path:
        """Returns the path of what is written, without its ending."""
        ratio = (self._ratio(policy) or "alone").replace("/", "-")
        world = scenario_name(self.scenario)
        parts = [Path(self.policy).stem, ratio]
        parts += [world] if world != TRAINING else []
        folder = default_folder(self.title, policy.robot.name) / gait.name
        return (self.output or folder) / "_".join(parts)

    def _play(
        self,
        gait: Gait,
        policy: AlternatingController,
        scenario: Scenario,
        stem: Path,
    ) -> tuple[Rollout, str]:
        """Returns what the robot did, and how it ended."""
        replay, meshcat = _beside(stem, ".html"), open_meshcat()
        if self.live:
            rollout = play_live(gait, policy, scenario, meshcat, replay, seed=self.seed)
            return rollout, f"stopped after {rollout.time[-1]:.2f} s"
        n_steps = N_STEPS if self.n_steps is None else self.n_steps
        rollout = play(gait, policy, scenario, meshcat, replay, n_steps=n_steps, seed=self.seed)
        end = "fell" if rollout.failed else "stayed up"
        reward = rollout["reward"][1:].sum()
        return rollout, f"{end} after {rollout.time[-1]:.2f} s, return {reward:.0f}"

    def _draw(
        self,
        gait: Gait,
        policy: AlternatingController,
        rollout: Rollout,
        stem: Path,
    ) -> None:
        """Draws the gait diagram and, where they are asked for, stills."""
        ratio = f", ratio {self._ratio(policy)}" if self.ratio is not None else ""
        title = f"{gait.name}, {self.policy}{ratio}"
        save_figure(gait_figure(rollout, gait, title), stem)
        if self.stills:
            strip = gait_strip(policy.robot, rollout, gait)
            save_figure(strip, stem.with_name(f"{stem.name}_stills"))


def _beside(stem: Path, ending: str) -> Path:
    return stem.with_name(stem.name + ending)


def _summary(rollout: Rollout, scenario: Scenario) -> str:
    """Says how far the robot came, and what it observed that no sensor measures."""
    speed = kinematics.base_velocity(rollout["state"])[0][:, 0].mean()
    commanded = rollout["command"][:, 0].mean()
    n_steps = len(rollout.time) - 1
    rhythm = rollout["served_dwell"][1:].sum() / max(n_steps, 1)
    observed = "estimated velocity and foot heights"
    if scenario.true_body_state:
        observed = "true velocity and foot heights, which no sensor measures"
    return (
        f"mean speed {speed:.2f} m/s ({commanded:.2f} commanded), "
        f"{speed * n_steps * CONTROL_PERIOD:.2f} m forward, rhythm {rhythm:.2f} of the commanded; "
        f"observed: {observed}"
    )

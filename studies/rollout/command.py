"""`glassgait rollout`: watches one robot."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar

import yaml

from glassgait.diagrams.locomotion import FixedCommand, LocomotionConfig, SliderCommand
from glassgait.diagrams.station import StationConfig
from glassgait.diagrams.visualization import open_meshcat
from glassgait.models.errors import InputError
from glassgait.models.files import write_atomically
from glassgait.models.policies.alternating import AlternatingPolicy
from glassgait.models.policies.library import load_expert
from glassgait.models.policies.policy import Policy
from glassgait.models.settings import Seed, Settings
from glassgait.models.task.alternation import parse_ratio, ratio_title
from glassgait.models.task.gait import load_gait
from glassgait.studies.console import console
from glassgait.studies.figures import save_figure
from glassgait.studies.records import to_plain
from glassgait.studies.rollout.live import play_live
from glassgait.studies.rollout.stills import gait_strip
from glassgait.studies.rollouts.gait_figure import gait_figure
from glassgait.studies.rollouts.play import Seconds, play
from glassgait.studies.run_folder import refuse_run
from glassgait.studies.students.library import find_student

SECONDS = 10.0
"""Length of a rollout that nobody watches (s), unless a person names another."""


@dataclass(frozen=True)
class ShowRollout(Settings):
    """Watch one robot, live in Meshcat with sliders or as fast as it goes.

    Attributes:
        gait: Name of a gait.
        policy: `expert`, a kind of student, or the path of a policy file.
        ratio: Share of steps at which the expert acts: 1, 1/2, …, or 0 for the student alone; by
            default the policy acts alone.
        stills: Also draw stills of the last cycle above the feet's contacts; needs EGL.
        live: Play at real time in Meshcat, commands from sliders, until the button `stop and save`
            or Ctrl-C; a robot that falls is put back on its feet, and the last minute is kept.
        command: The command where there are no sliders.
        seconds: Length of the rollout (s), 10 by default and 3600 at most; a fall ends it before.
            Not with --live.
        seed: Seed of the sensors' noise.
        station: Physics.
        distillation: Folder of a distillation; by default runs/distillation/<gait>, and where that
            lacks the student, the shipped one.
        expert: Policy file of the expert; the shipped one by default.
        output: Folder of the replay; runs/rollout/<gait> by default.
    """

    title: ClassVar[str] = "rollout"

    gait: str = "trot"
    policy: str = "expert"
    ratio: str | None = None
    stills: bool = False
    live: bool = False
    command: FixedCommand = field(default_factory=FixedCommand)
    seconds: Seconds | None = None
    seed: Seed = 0
    station: StationConfig = field(default_factory=StationConfig)
    distillation: Path | None = None
    expert: Path | None = None
    output: Path | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.live and self.seconds is not None:
            raise InputError("rollout: --live goes on until it is stopped; leave --seconds out")

    def run(self) -> None:
        """Plays, and writes replay, gait diagram and, beside them, these settings."""
        gait = load_gait(self.gait)
        expert = load_expert(gait, self.expert)
        student: Policy | None = None
        if self.policy != "expert":
            student = find_student(self.policy, expert, self.distillation)
        period = parse_ratio(
            ("1" if student is None else "0") if self.ratio is None else self.ratio
        )
        if student is None and self.ratio is not None:
            raise InputError("--ratio shares steps with a student; name one with --policy")
        policy = AlternatingPolicy(expert, student, period)
        config = LocomotionConfig(
            station=self.station,
            command=SliderCommand() if self.live else self.command,
            alternation_period=period,
            sensor_noise=1.0,
        )
        # As the paper writes it, so that 0.25 and 1/4 are one.
        ratio = None if self.ratio is None else ratio_title(period)
        name = f"{Path(self.policy).stem}_{(ratio or 'alone').replace('/', '-')}"
        stem = (self.output or Path("runs/rollout") / gait.name) / name
        refuse_run(stem.parent)
        replay, meshcat = stem.with_name(f"{name}.html"), open_meshcat()
        if self.live:
            rollout = play_live(gait, policy, config, meshcat, replay, seed=self.seed)
            console.print(f"stopped after {rollout.time[-1]:.2f} s")
        else:
            seconds = SECONDS if self.seconds is None else self.seconds
            rollout = play(gait, policy, config, meshcat, replay, seconds=seconds, seed=self.seed)
            end = "fell" if rollout.failed else "stayed up"
            reward = rollout["reward"][1:].sum()
            console.print(f"{end} after {rollout.time[-1]:.2f} s, reward {reward:.0f}")
        record = yaml.safe_dump(to_plain(self), sort_keys=False)
        write_atomically(stem.with_name(f"{name}.yaml"), record)
        title = f"{gait.name}, {self.policy}" + (f", ratio {ratio}" if ratio else "")
        save_figure(gait_figure(rollout, gait, title), stem)
        if self.stills:
            save_figure(gait_strip(rollout, gait), stem.with_name(f"{name}_stills"))
        stills = f"; stills to {stem}_stills.png and .pdf" if self.stills else ""
        console.print(f"replay and gait diagram written to {stem}.html, .png and .pdf{stills}")

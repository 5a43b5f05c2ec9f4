"""`glassgait rollout`: watches one robot."""

from dataclasses import dataclass, field
from pathlib import Path

from diagrams.locomotion import FixedCommand, LocomotionConfig, SliderCommand
from diagrams.rollout import Rollout
from diagrams.station import StationConfig
from diagrams.visualization import open_meshcat
from models.errors import InputError
from models.policies.library import load_expert
from models.policies.policy import Policy
from models.task.alternation import parse_ratio
from models.task.gait import load_gait
from studies.console import console
from studies.distillation.library import find_student
from studies.evaluation.figures import gait_figure
from studies.evaluation.team import Team
from studies.figures import save_figure
from studies.rollout.play import play
from studies.rollout.stills import gait_strip

STOP_BUTTON = "stop and save"


@dataclass(frozen=True)
class ShowRollout:
    """Watch one robot, live in Meshcat with sliders or as fast as it goes.

    Attributes:
        gait: Name of a gait.
        policy: `expert`, a kind of student, or the path of a policy file.
        ratio: Share of steps at which the expert acts: 1, 1/2, …, or 0 for the student alone; by
            default the policy acts alone.
        stills: Also draw stills of the last cycle above the feet's contacts; needs EGL.
        live: Play at real time in Meshcat, commands from sliders.
        command: The command where there are no sliders.
        seconds: Length of the rollout (s); live, the button `stop and save` ends it before.
        seed: Seed of the sensors' noise.
        station: Physics.
        students: Folder of a distillation; by default runs/distillation/<gait>, and where that
            lacks the student, the shipped one.
        expert: Policy file of the expert; the shipped one by default.
        output: Folder of the replay; runs/rollout/<gait> by default.
    """

    gait: str = "trot"
    policy: str = "expert"
    ratio: str | None = None
    stills: bool = False
    live: bool = False
    command: FixedCommand = field(default_factory=FixedCommand)
    seconds: float = 10.0
    seed: int = 0
    station: StationConfig = field(default_factory=StationConfig)
    students: Path | None = None
    expert: Path | None = None
    output: Path | None = None

    def run(self) -> None:
        """Plays, and writes replay and gait diagram."""
        gait = load_gait(self.gait)
        expert = load_expert(self.gait, self.expert)
        student: Policy | None = None
        if self.policy != "expert":
            student = find_student(self.policy, expert, self.students)
        period = parse_ratio(self.ratio or ("1" if student is None else "0"))
        if student is None and self.ratio is not None:
            raise InputError("--ratio shares steps with a student; name one with --policy")
        config = LocomotionConfig(
            station=self.station,
            command=SliderCommand() if self.live else self.command,
            alternation_period=period,
            sensor_noise=1.0,
        )
        name = f"{Path(self.policy).stem}_{(self.ratio or 'alone').replace('/', '-')}"
        stem = (self.output or Path("runs/rollout") / gait.name) / name
        meshcat = open_meshcat()
        meshcat.AddButton(STOP_BUTTON, "Escape")
        if self.live:
            console.print(f"open {meshcat.web_url()}, move the sliders, and stop when you like")
        rollout = play(
            gait,
            Team(expert, student, period),
            config,
            meshcat,
            stem.with_suffix(".html"),
            seconds=self.seconds,
            seed=self.seed,
            realtime_rate=1.0 if self.live else 0.0,
            stopped=lambda: meshcat.GetButtonClicks(STOP_BUTTON) > 0,
        )
        save_figure(gait_figure(rollout, gait, f"{gait.name}, {self.policy}"), stem)
        if self.stills:
            save_figure(gait_strip(rollout, gait), stem.with_name(f"{stem.name}_stills"))
        _tell(rollout, stem)


def _tell(rollout: Rollout, stem: Path) -> None:
    seconds = rollout.time[-1]
    end = "fell" if rollout.failed else "stayed up"
    console.print(f"{end} after {seconds:.2f} s, reward {rollout['reward'][1:].sum():.0f}")
    console.print(f"replay and gait diagram written to {stem}.html, .png and .pdf")

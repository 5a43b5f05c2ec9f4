"""Scenarios: the world that a robot is in and how the loop around it is closed."""

import hashlib
import json
import os
from collections.abc import Sequence
from dataclasses import asdict, field, fields, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar

from annotated_types import Ge, Le, MaxLen

from glassgait.diagrams.commands import CommandConfig, DrawnCommands, FixedCommand, SliderCommand
from glassgait.diagrams.station import StationConfig
from glassgait.models.errors import InputError, shown
from glassgait.models.estimation.imu import ImuErrors
from glassgait.models.files import read_yaml
from glassgait.models.policies.controller import Controller
from glassgait.models.policies.policy import Policy
from glassgait.models.robots.joint_law import OWN_LAW, JointLaw
from glassgait.models.robots.library import load_robot
from glassgait.models.robots.robot import Robot
from glassgait.models.settings import Count, NotNegative, Settings, checked
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.randomization import (
    NOMINAL,
    ContactFlips,
    EncoderBias,
    Heading,
    Latency,
    Legs,
    Randomization,
)
from glassgait.models.task.reward import RewardWeights
from glassgait.models.task.termination import TerminationLimits

TRAINING = "training"
"""Name of the scenario that is meant where none is named."""

SCENARIO_DIRECTORY = Path(__file__).resolve().parent / "scenarios"

SCENARIO_GROUPS = {
    "all": SCENARIO_DIRECTORY,
    "grounds": SCENARIO_DIRECTORY / "ground",
    "harsh": SCENARIO_DIRECTORY / "harsh",
}
"""Folders of the scenarios that ship: `all` for those that differ in one thing on level ground,
other grounds, and lives harder than those."""

LONGEST_NAME = 80
"""Greatest length of a scenario's name (bytes), which stands in the names of files."""

LONGEST_TITLE = 80
"""Greatest number of characters of a title, which stands in tables."""


@checked
class Pushes(Settings):
    """Pushes of a robot's trunk, between two control steps.

    Attributes:
        speed: Greatest horizontal velocity that a push adds, along each axis (m/s); 0 for none.
        interval: Mean time between two pushes of a robot (s).
    """

    title: ClassVar[str] = "pushes"

    speed: NotNegative = 0.0
    interval: Annotated[float, Ge(CONTROL_PERIOD)] = NOMINAL.push_interval


@checked
class Scenario(Settings):
    """The world, and how the loop is closed; by default those of training, without disturbances.

    Attributes:
        title: What tables and refusals call it.
        station: Physics.
        accuracy: Accuracy of the error-controlled contact integrator, for a continuous plant.
        command: Where commands come from.
        heading: Greatest angle between the world's x axis, up which slopes and steps lead, and
            where a robot faces at the start (°), drawn to either side; 180 for any.
        sensor_noise: Factor on the noise of the joints' sensors and of the IMU; 0 for none, 1 for
            the task's.
        encoder_bias: Greatest constant error of each measured joint position (rad).
        imu: What is wrong with the IMU's readings, besides their noise.
        contact_flips: Share of the contact sensors' readings that are wrong.
        stuck_open: Legs whose contact sensors never read a contact.
        stuck_closed: Legs whose contact sensors always do.
        latency: Time from an observation until its action reaches the joints (s), in whole steps
            of a discrete plant.
        pushes: Pushes of the trunk; of discrete plants alone.
        limit_targets: Whether joints follow targets within their ranges alone, the nearest ones
            there; by default they do where the policy is to be run so, as formulas are. What a
            policy's own limits leave lies there in any case.
        true_body_state: Whether policies observe the true body state, and the reward machine reads
            the true heights of the feet. Both are the estimator's otherwise: the loop is closed on
            sensors only.
        max_robots: Robots to roll out at most for a seed, where the physics is slow.
        weights: Weights of the reward.
        limits: Bounds that the fall monitor watches.
        robot: Name of a robot that ships, or path of a `robot.yaml` of one's own; by default that
            of the policy that acts.
    """

    title: str = "SAP 10 ms (training)"
    station: StationConfig = field(default_factory=StationConfig)
    accuracy: Annotated[float, Ge(1e-10), Le(1.0)] | None = None
    command: CommandConfig = field(default_factory=DrawnCommands)
    heading: Heading = 0.0
    sensor_noise: NotNegative = 1.0
    encoder_bias: EncoderBias = 0.0
    imu: ImuErrors = field(default_factory=ImuErrors)
    contact_flips: ContactFlips = 0.0
    stuck_open: Legs = ()
    stuck_closed: Legs = ()
    latency: Latency = 0.0
    pushes: Pushes = field(default_factory=Pushes)
    limit_targets: bool | None = None
    true_body_state: bool = False
    max_robots: Count | None = None
    weights: RewardWeights = field(default_factory=RewardWeights)
    limits: TerminationLimits = field(default_factory=TerminationLimits)
    robot: Annotated[str, MaxLen(1000)] | None = None

    def __post_init__(self) -> None:
        if isinstance(self.title, str):
            _check_title(self.title)
        self.station.terrain.check(load_robot() if self.robot is None else load_robot(self.robot))
        if self.station.time_step > 0:
            # Otherwise the plant and the controller would drift apart.
            self.station.plant_steps()
            self._check_latency()
        self._check_integrator()
        if both := set(self.stuck_open) & set(self.stuck_closed):
            raise InputError(
                f"{self.refused_as()}: stuck_open and stuck_closed both name {sorted(both)[0]}; "
                "name a leg in one of them"
            )

    def refused_as(self) -> str:
        """Returns what a refusal calls the scenario: its title is its own, not of all."""
        return f"scenario {shown(self.title)}"

    def _check_latency(self) -> None:
        step = self.station.time_step
        if abs(round(self.latency / step) * step - self.latency) > 1e-12:
            raise InputError(
                f"{self.refused_as()}: latency is {self.latency:g}, no multiple of "
                f"station.time_step, {step:g}; give one that is, up to {2 * CONTROL_PERIOD:g}"
            )

    def _check_integrator(self) -> None:
        step, pushed = self.station.time_step, self.pushes.speed
        problem = None
        if step == 0 and self.accuracy is None:
            problem = (
                "station.time_step is 0, which makes the plant continuous; give the accuracy of "
                "its integrator, such as 1.0e-5, or a time_step"
            )
        elif step > 0 and self.accuracy is not None:
            problem = (
                f"accuracy is {self.accuracy:g}, which is of continuous plants, but "
                f"station.time_step is {step:g}; make it 0, or leave accuracy out"
            )
        elif step == 0 and not self.station.terrain.is_plane:
            problem = (
                f"station.terrain.kind is {self.station.terrain.kind!r}, but only discrete plants "
                "are moved back on ground that repeats; give station.time_step and leave accuracy "
                "out"
            )
        elif step == 0 and pushed > 0:
            problem = (
                f"pushes.speed is {pushed:g}, but only discrete scenarios have pushes; give "
                "station.time_step and leave accuracy out"
            )
        if problem:
            raise InputError(f"{self.refused_as()}: {problem}")

    def robot_of(self, policy: Controller | Policy | None = None) -> Robot:
        """Returns the robot that a policy moves here; without one, that of the scenario.

        Raises:
            InputError: if the policy was made for another robot.
        """
        if self.robot is None:
            return load_robot() if policy is None else policy.robot
        own = load_robot(self.robot)
        if policy is not None and policy.robot is not own:
            raise InputError(
                f"{self.refused_as()}: robot is {own.name!r}, and the policy was made for "
                f"{policy.robot.name!r}; take a policy of the {own.name}, or leave robot out"
            )
        return own

    def joint_law(self, policy: Controller | Policy | None) -> JointLaw:
        """Returns how joints follow a policy's targets: as the scenario says, or as it learned.

        Gains that it names alone stand in place of the policy's, or else of the robot's.
        """
        law = OWN_LAW if policy is None else policy.joint_law
        gains = self.station.gains(self.robot_of(policy), law)
        limited = law.limited if self.limit_targets is None else self.limit_targets
        # What a controller limits itself, it limits wherever it is.
        return JointLaw(gains, limited, law.limits)

    def station_of(self, policy: Controller | Policy | None) -> StationConfig:
        """Returns the station whose joints have the gains by which a policy's are to be driven."""
        return self.station.with_gains(self.robot_of(policy), self.joint_law(policy))

    @property
    def names_a_command(self) -> bool:
        """Whether it asks for anything but commands drawn over a gait's whole range."""
        return self.command != DrawnCommands()

    def randomization(self) -> Randomization:
        """Returns what differs between the robots of an evaluation here."""
        # A station has one friction, and its robots the same.
        ground = (self.station.friction, self.station.friction)
        return replace(
            NOMINAL,
            friction=ground,
            heading=self.heading,
            push_speed=self.pushes.speed,
            push_interval=self.pushes.interval,
            observation_noise=self.sensor_noise,
            encoder_bias=self.encoder_bias,
            imu=self.imu,
            contact_flips=self.contact_flips,
            stuck_open=self.stuck_open,
            stuck_closed=self.stuck_closed,
            latency=(self.latency, self.latency),
        )

    def to_plain(self) -> dict[str, Any]:
        """Returns every setting as values that YAML and JSON can hold."""
        return json.loads(json.dumps(asdict(self)))

    def digest(self) -> str:
        """Returns what differs where scenarios differ in anything."""
        return hashlib.sha256(json.dumps(self.to_plain()).encode()).hexdigest()[:16]


def scenario_names(group: str = "all") -> tuple[str, ...]:
    """Lists the scenarios of a group that ship, the training world first."""
    names = (path.stem for path in SCENARIO_GROUPS[group].glob("*.yaml"))
    return tuple(sorted(names, key=lambda name: (name != TRAINING, name)))


def scenario_name(scenario: str | Path) -> str:
    """Returns what a scenario is called: one that ships by its name, a file by its own.

    Raises:
        InputError: if there is no such scenario, or its file cannot be called so.
    """
    return _path(scenario).stem


def load_scenario(scenario: str | Path) -> Scenario:
    """Loads a scenario by its name, or from a YAML file of one's own.

    A file names only what differs from the training world.

    Args:
        scenario: Name of a scenario that ships, or path of a file that ends in .yaml.

    Raises:
        InputError: if there is no such scenario, or its file breaks a rule; the message names the
            file, the key and the remedy.
    """
    # As Drake's hardware_sim loads one: a dataclass of defaults, and a file that overrides some.
    # `pydrake.common.yaml.yaml_load_typed` would serve, were it not that it sets the fields of a
    # frozen dataclass, and reads no `Annotated`, which hold the ranges, and no `Literal`.
    path = _path(scenario)
    loaded = _parse(read_yaml(path), path)
    shipped = _shipped(path.stem)
    if shipped and path.resolve() != shipped and loaded != load_scenario(path.stem):
        raise InputError(
            f"{path}: is called like the scenario {path.stem!r} that ships, and differs from it; "
            "give the file another name"
        )
    return loaded


def load_scenarios(scenarios: Sequence[str]) -> dict[str, Scenario]:
    """Loads scenarios by their names.

    Args:
        scenarios: Names or paths, as `load_scenario` takes them, or names of groups that ship:
            `all`, `grounds`, `harsh`.

    Raises:
        InputError: as `load_scenario` does, or if two that differ have one name, or one title.
    """
    found: dict[str, Scenario] = {}
    for one in scenarios:
        for each in scenario_names(one) if one in SCENARIO_GROUPS else (one,):
            name, scenario = scenario_name(each), load_scenario(each)
            if found.setdefault(name, scenario) != scenario:
                raise InputError(
                    f"{each}: is another scenario than the one before that is called {name!r}; "
                    "give the file another name"
                )
    titles = [scenario.title for scenario in found.values()]
    for name, scenario in found.items():
        if titles.count(scenario.title) > 1:
            raise InputError(
                f"scenario {shown(name)}: another one is called {shown(scenario.title)} as well, "
                "and tables could not distinguish them; give it another title"
            )
    return found


def _parse(values: Any, path: Path) -> Scenario:
    if not isinstance(values, dict):
        raise InputError(
            f"{path}: is not a mapping of settings; write what differs from the training scenario, "
            "such as station: {friction: 0.3}"
        )
    values = {"title": path.stem} | values
    if "command" not in values:
        return Scenario.from_plain(values, str(path))
    # Three kinds of settings stand under one key, and their own keys decide which.
    given = values.pop("command")
    command = _command_kind(given).from_plain(given, f"{path}: key 'command'")
    return replace(Scenario.from_plain(values, str(path)), command=command)


def _command_kind(values: Any) -> type[FixedCommand | DrawnCommands | SliderCommand]:
    for kind in (DrawnCommands, SliderCommand):
        if isinstance(values, dict) and any(own.name in values for own in fields(kind)):
            return kind
    return FixedCommand


def _path(scenario: str | Path) -> Path:
    path = Path(scenario)
    if path.suffix in (".yaml", ".yml"):
        if len(os.fsencode(path.stem)) > LONGEST_NAME or not path.stem.isprintable():
            raise InputError(
                f"scenario file {shown(str(path))}: the scenario takes its name from the file; "
                f"rename it to printable characters, {LONGEST_NAME} bytes at most"
            )
        return path
    shipped = _shipped(str(scenario))
    if not shipped:
        names = ", ".join(name for group in SCENARIO_GROUPS for name in scenario_names(group))
        raise InputError(
            f"unknown scenario {shown(str(scenario))}; the scenarios are {names}, or give the path "
            "of a scenario file ending in .yaml"
        )
    return shipped


def _shipped(name: str) -> Path | None:
    for group, folder in SCENARIO_GROUPS.items():
        if name in scenario_names(group):
            return folder / f"{name}.yaml"
    return None


def _check_title(title: str) -> None:
    if not title.isprintable() or not 0 < len(title.strip()) <= LONGEST_TITLE:
        raise InputError(
            f"scenario: title is {shown(title)}; write printable characters, {LONGEST_TITLE} at "
            "most"
        )

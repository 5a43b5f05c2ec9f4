"""Scenarios: the physics, commands and disturbances of an evaluation."""

import hashlib
import json
from collections.abc import Sequence
from dataclasses import asdict, field, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from annotated_types import MaxLen

from glassgait.diagrams.commands import CommandConfig, DrawnCommands, FixedCommand, SliderCommand
from glassgait.diagrams.station import StationConfig
from glassgait.models.errors import InputError, shown, unknown_name
from glassgait.models.files import read_yaml, resolve_paths
from glassgait.models.robots.library import load_robot
from glassgait.models.robots.robot import DEFAULT_LAW, JointLaw, Robot
from glassgait.models.settings import Count, checked
from glassgait.models.task.randomization import NOMINAL, Disturbances, Latency, Randomization
from glassgait.models.task.reward import RewardWeights
from glassgait.models.task.termination import TerminationLimits

if TYPE_CHECKING:
    from glassgait.models.policies.controller import Controller
    from glassgait.models.policies.policy import Policy

NOMINAL_SCENARIO = "nominal"  # the default

SCENARIO_DIRECTORY = Path(__file__).resolve().parent / "scenarios"

SCENARIO_GROUPS = {
    "all": SCENARIO_DIRECTORY,
    "grounds": SCENARIO_DIRECTORY / "ground",
    "harsh": SCENARIO_DIRECTORY / "harsh",
}
"""Folders of the shipped scenarios."""

LONGEST_TITLE = 80  # greatest length of a scenario's title


@checked
class Scenario(Disturbances):
    """Physics, commands and disturbances of an evaluation; by default the nominal ones."""

    title: str = "nominal (SAP 10 ms)"  # name in tables and errors
    station: StationConfig = field(default_factory=StationConfig)
    command: CommandConfig = field(default_factory=DrawnCommands)
    latency: Latency = 0.0  # from observation to joints (s), in whole steps of the plant
    limit_targets: bool | None = None  # limit to the joints' ranges; by default as in training
    true_body_state: bool = False  # replaces the estimates, also for the reward machine
    max_robots: Count | None = None  # greatest number of robots per seed, for slow physics
    weights: RewardWeights = field(default_factory=RewardWeights)
    limits: TerminationLimits = field(default_factory=TerminationLimits)
    # Name of a shipped robot, or path of a `robot.yaml`; by default the policy's robot.
    robot: Annotated[str, MaxLen(1000)] | None = None

    def __post_init__(self) -> None:
        # Without a robot here, the policy's robot is not known yet; check with the default robot.
        self.station.terrain.check(load_robot() if self.robot is None else load_robot(self.robot))
        if problem := self._problem():
            raise InputError(f"{self.error_name()}: {problem}")

    def error_name(self) -> str:
        """Returns the scenario's name in error messages."""
        return f"scenario {shown(self.title)}"

    def _problem(self) -> str | None:
        """Returns the first contradiction between settings, if there is one."""
        step, legs = self.station.time_step, {*self.stuck_open} & {*self.stuck_closed}
        if not (self.title.isprintable() and 0 < len(self.title.strip()) <= LONGEST_TITLE):
            return f"title must have 1 to {LONGEST_TITLE} printable characters"
        if legs:
            return f"stuck_open and stuck_closed both name {min(legs)}; remove it from one of them"
        # Other steps would let the plant and the controller drift apart.
        self.station.plant_steps()
        if abs(round(self.latency / step) * step - self.latency) > 1e-12:
            return f"latency is {self.latency:g}; give a multiple of station.time_step, {step:g}"
        return None

    def robot_of(self, policy: "Controller | Policy | None" = None) -> Robot:
        """Returns the robot that a policy moves, or raises an InputError if they do not fit."""
        if self.robot is None:
            return load_robot() if policy is None else policy.robot
        robot = load_robot(self.robot)
        if policy is not None and policy.robot is not robot:
            raise InputError(
                f"{self.error_name()}: robot is {robot.name!r}, and the policy was made for "
                f"{policy.robot.name!r}; use a policy of the {robot.name}, or remove robot"
            )
        return robot

    def joint_law(self, policy: "Controller | Policy | None") -> JointLaw:
        """Returns the policy's joint law, with gains and limits that the scenario sets."""
        law = DEFAULT_LAW if policy is None else policy.joint_law
        gains = self.station.gains(self.robot_of(policy), law)
        limited = law.limited if self.limit_targets is None else self.limit_targets
        return JointLaw(gains, limited, law.limits)

    def station_of(self, policy: "Controller | Policy | None") -> StationConfig:
        """Returns the station with a policy's gains."""
        return self.station.with_gains(self.robot_of(policy), self.joint_law(policy))

    def randomization(self) -> Randomization:
        """Returns the randomization of the robots of an evaluation."""
        shared = {key.name: getattr(self, key.name) for key in fields(Disturbances)}
        friction, latency = self.station.friction, self.latency
        return replace(NOMINAL, friction=(friction, friction), latency=(latency, latency), **shared)

    def digest(self) -> str:
        """Returns a digest of every setting."""
        return hashlib.sha256(json.dumps(asdict(self)).encode()).hexdigest()[:16]


def scenario_names(group: str = "all") -> tuple[str, ...]:
    """Lists the shipped scenarios of a group, the nominal scenario first."""
    names = (path.stem for path in SCENARIO_GROUPS[group].glob("*.yaml"))
    return tuple(sorted(names, key=lambda name: (name != NOMINAL_SCENARIO, name)))


def scenario_name(scenario: str | Path) -> str:
    """Returns the name of a scenario, given the name or a file."""
    return _path(scenario).stem


def load_scenario(scenario: str | Path) -> Scenario:
    """Loads a scenario by its name, or from a path that ends in .yaml.

    A file lists only differences from the nominal scenario.
    """
    # As in Drake's hardware_sim, a file overrides some defaults of a dataclass. Drake's
    # `yaml_load_typed` supports neither frozen dataclasses nor `Annotated` (ranges) and `Literal`.
    path = _path(scenario)
    loaded = _parse(read_yaml(path), path)
    shipped = _shipped(path.stem)
    if shipped and path.resolve() != shipped and loaded != load_scenario(path.stem):
        raise InputError(
            f"{path}: name {path.stem!r} is taken by a built-in scenario; rename the file"
        )
    return loaded


def load_scenarios(scenarios: Sequence[str]) -> dict[str, Scenario]:
    """Loads scenarios by name, by path, or by group: `all`, `grounds`, `harsh`."""
    loaded: dict[str, Scenario] = {}
    for argument in scenarios:
        members = scenario_names(argument) if argument in SCENARIO_GROUPS else (argument,)
        for member in members:
            name, scenario = scenario_name(member), load_scenario(member)
            if loaded.setdefault(name, scenario) != scenario:
                raise InputError(f"{member}: another scenario has the name {name!r}; rename one")

    # Tables identify scenarios by their titles.
    titles = [scenario.title for scenario in loaded.values()]
    for name, scenario in loaded.items():
        if titles.count(scenario.title) > 1:
            raise InputError(
                f"scenario {shown(name)}: another has the title {shown(scenario.title)}; change one"
            )
    return loaded


def _parse(values: Any, path: Path) -> Scenario:
    if not isinstance(values, dict):
        raise InputError(
            f"{path}: is not a mapping of settings; list differences from the nominal scenario, "
            "such as station: {friction: 0.3}"
        )
    values = {"title": path.stem} | resolve_paths(path, values)
    if "command" not in values:
        return Scenario.from_plain(values, str(path))
    # The keys of a command determine which of three types it has.
    settings = values.pop("command")
    command = _command_type(settings).from_plain(settings, f"{path}: key 'command'")
    return replace(Scenario.from_plain(values, str(path)), command=command)


def _command_type(values: Any) -> type[FixedCommand | DrawnCommands | SliderCommand]:
    for config in (DrawnCommands, SliderCommand):
        if isinstance(values, dict) and any(key.name in values for key in fields(config)):
            return config
    return FixedCommand


def _path(scenario: str | Path) -> Path:
    path = Path(scenario)
    if path.suffix in (".yaml", ".yml"):
        return path
    shipped = _shipped(str(scenario))
    if not shipped:
        names = (name for group in SCENARIO_GROUPS for name in scenario_names(group))
        remedy = ", or give the path of a scenario file ending in .yaml"
        raise unknown_name("scenario", scenario, names, remedy)
    return shipped


def _shipped(name: str) -> Path | None:
    for group, folder in SCENARIO_GROUPS.items():
        if name in scenario_names(group):
            return folder / f"{name}.yaml"
    return None

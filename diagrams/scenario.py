"""Scenarios: the world that a robot is in and how the loop around it is closed."""

import hashlib
import json
import os
from collections.abc import Sequence
from dataclasses import asdict, field, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from annotated_types import Ge, Le, MaxLen

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
"""Folders of the scenarios that ship."""

LONGEST_NAME = LONGEST_TITLE = 80
"""Greatest length of a scenario's name, which stands in names of files (bytes), and of a title."""


@checked
class Scenario(Disturbances):
    """Physics, commands and disturbances of an evaluation; by default the nominal ones."""

    title: str = "nominal (SAP 10 ms)"  # name in tables and errors
    station: StationConfig = field(default_factory=StationConfig)
    # Of the error-controlled contact integrator, for a continuous plant.
    accuracy: Annotated[float, Ge(1e-10), Le(1.0)] | None = None
    command: CommandConfig = field(default_factory=DrawnCommands)
    latency: Latency = 0.0  # from observation to joints (s), in whole steps of a discrete plant
    limit_targets: bool | None = None  # to the joints' ranges; by default as the policy learned
    true_body_state: bool = False  # observed instead of estimates, by the reward machine too
    max_robots: Count | None = None  # for a seed, where physics is slow
    weights: RewardWeights = field(default_factory=RewardWeights)
    limits: TerminationLimits = field(default_factory=TerminationLimits)
    # Name of one that ships, or path of a `robot.yaml`; by default that of the policy.
    robot: Annotated[str, MaxLen(1000)] | None = None

    def __post_init__(self) -> None:
        # A robot that is not named is of the policy; the shipped one stands for it here.
        self.station.terrain.check(load_robot() if self.robot is None else load_robot(self.robot))
        if problem := self._problem():
            raise InputError(f"{self.refused_as()}: {problem}")

    def refused_as(self) -> str:
        """Returns the name of the scenario in errors."""
        return f"scenario {shown(self.title)}"

    def _problem(self) -> str | None:
        """Returns the first contradiction between settings, if there is one."""
        step, both = self.station.time_step, {*self.stuck_open} & {*self.stuck_closed}
        if not (self.title.isprintable() and 0 < len(self.title.strip()) <= LONGEST_TITLE):
            return f"title is not of 1 to {LONGEST_TITLE} printable characters"
        if both:
            return f"stuck_open and stuck_closed both name {min(both)}; name a leg in one of them"
        if step > 0:
            # Otherwise the plant and the controller would drift apart.
            self.station.plant_steps()
            if abs(round(self.latency / step) * step - self.latency) > 1e-12:
                return (
                    f"latency is {self.latency:g}; give a multiple of station.time_step, {step:g}"
                )
            if self.accuracy is not None:
                return "accuracy is of continuous plants; give station.time_step 0, or leave it out"
            return None
        if self.accuracy is None:
            return "station.time_step is 0; give the accuracy of the integrator, or a time_step"
        if not self.station.terrain.is_plane:
            return f"station.terrain.kind is {self.station.terrain.kind!r}; give station.time_step"
        return (
            "push_speed needs a discrete plant; give station.time_step" if self.push_speed else None
        )

    def robot_of(self, policy: "Controller | Policy | None" = None) -> Robot:
        """Returns the robot that a policy moves here; refuses a policy of another robot."""
        if self.robot is None:
            return load_robot() if policy is None else policy.robot
        robot = load_robot(self.robot)
        if policy is not None and policy.robot is not robot:
            raise InputError(
                f"{self.refused_as()}: robot is {robot.name!r}, and the policy was made for "
                f"{policy.robot.name!r}; take a policy of the {robot.name}, or leave robot out"
            )
        return robot

    def joint_law(self, policy: "Controller | Policy | None") -> JointLaw:
        """Returns how joints follow a policy's targets: as the scenario says, or as it learned."""
        law = DEFAULT_LAW if policy is None else policy.joint_law
        gains = self.station.gains(self.robot_of(policy), law)
        limited = law.limited if self.limit_targets is None else self.limit_targets
        return JointLaw(gains, limited, law.limits)

    def station_of(self, policy: "Controller | Policy | None") -> StationConfig:
        """Returns the station, its joints with a policy's gains."""
        return self.station.with_gains(self.robot_of(policy), self.joint_law(policy))

    def randomization(self) -> Randomization:
        """Returns the differences between the robots of an evaluation."""
        shared = {key.name: getattr(self, key.name) for key in fields(Disturbances)}
        friction, latency = self.station.friction, self.latency
        return replace(NOMINAL, friction=(friction, friction), latency=(latency, latency), **shared)

    def digest(self) -> str:
        """Returns a digest of every setting."""
        return hashlib.sha256(json.dumps(asdict(self)).encode()).hexdigest()[:16]


def scenario_names(group: str = "all") -> tuple[str, ...]:
    """Lists the scenarios of a group that ship, the nominal scenario first."""
    names = (path.stem for path in SCENARIO_GROUPS[group].glob("*.yaml"))
    return tuple(sorted(names, key=lambda name: (name != NOMINAL_SCENARIO, name)))


def scenario_name(scenario: str | Path) -> str:
    """Returns the name of a scenario, or of the one in a file."""
    return _path(scenario).stem


def load_scenario(scenario: str | Path) -> Scenario:
    """Loads a scenario by its name, or from a path that ends in .yaml.

    A file names only what differs from the nominal scenario.

    Raises:
        InputError: if there is no such scenario, or its file breaks a rule.
    """
    # As Drake's hardware_sim loads one: a dataclass of defaults, and a file that overrides some.
    # `pydrake.common.yaml.yaml_load_typed` would serve, were it not that it sets the fields of a
    # frozen dataclass, and reads no `Annotated`, which hold the ranges, and no `Literal`.
    path = _path(scenario)
    loaded = _parse(read_yaml(path), path)
    shipped = _shipped(path.stem)
    if shipped and path.resolve() != shipped and loaded != load_scenario(path.stem):
        raise InputError(
            f"{path}: name {path.stem!r} is taken by a built-in scenario; rename the file"
        )
    return loaded


def load_scenarios(scenarios: Sequence[str]) -> dict[str, Scenario]:
    """Loads scenarios by their names or paths, or by names of groups: `all`, `grounds`, `harsh`.

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

    # Tables show titles.
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
            f"{path}: is not a mapping of settings; write what differs from the nominal scenario, "
            "such as station: {friction: 0.3}"
        )
    values = {"title": path.stem} | resolve_paths(path, values)
    if "command" not in values:
        return Scenario.from_plain(values, str(path))
    # Three kinds of settings stand under one key; their keys tell them apart.
    given = values.pop("command")
    command = _command_kind(given).from_plain(given, f"{path}: key 'command'")
    return replace(Scenario.from_plain(values, str(path)), command=command)


def _command_kind(values: Any) -> type[FixedCommand | DrawnCommands | SliderCommand]:
    for kind in (DrawnCommands, SliderCommand):
        if isinstance(values, dict) and any(key.name in values for key in fields(kind)):
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
        names = (name for group in SCENARIO_GROUPS for name in scenario_names(group))
        remedy = ", or give the path of a scenario file ending in .yaml"
        raise unknown_name("scenario", scenario, names, remedy)
    return shipped


def _shipped(name: str) -> Path | None:
    for group, folder in SCENARIO_GROUPS.items():
        if name in scenario_names(group):
            return folder / f"{name}.yaml"
    return None

"""Which robots are rolled out: those that go from each gait to each other, at every speed."""

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import permutations

from glassgait.diagrams.scenario import Scenario
from glassgait.models.policies.controller import AlternatingController
from glassgait.models.task.gait import Gait
from glassgait.studies.common.serialization import to_plain
from glassgait.studies.evaluation.transitions.config import TransitionConfig


@dataclass(frozen=True)
class TransitionJob:
    """Robots that go from one gait to another at one speed.

    Attributes:
        policy: What tables call who walks.
        scenario: Name of the world.
        path: The gaits, in the order in which they are requested; of one alone nothing changes.
        walkers: Who walks in each.
        world: The world.
        speed: Commanded speed (m/s).
        config: How many robots, and what eases the change.
    """

    policy: str
    scenario: str
    path: tuple[Gait, ...]
    walkers: tuple[AlternatingController, ...]
    world: Scenario
    speed: float
    config: TransitionConfig

    @property
    def labels(self) -> dict[str, str | float]:
        """Columns that tell the job's robots from the others'."""
        return {
            "policy": self.policy,
            "scenario": self.scenario,
            "from": self.path[0].name,
            "to": self.path[-1].name,
            "speed": self.speed,
        }

    @property
    def name(self) -> str:
        """What progress and files call it."""
        path = "-".join(gait.name for gait in self.path)
        return f"{self.policy}_{self.scenario}_{path}_{self.speed:g}"

    def digest(self) -> str:
        """Tells jobs apart whose robots would not walk alike."""
        walkers = [walker.policy.digest() for walker in self.walkers]
        experts = [walker.expert.digest() for walker in self.walkers]
        gaits = [gait.digest() for gait in self.path]
        # Each speed is rolled out by itself.
        config = to_plain(replace(self.config, speeds=(self.speed,)))
        whole = [walkers, experts, gaits, self.world.digest(), config]
        return hashlib.sha256(json.dumps(whole).encode()).hexdigest()[:16]


def jobs_of_pairs(
    gaits: Sequence[Gait],
    walkers: Mapping[str, Mapping[str, AlternatingController]],
    scenarios: Mapping[str, Scenario],
    config: TransitionConfig,
    via: Gait | None,
) -> list[TransitionJob]:
    """Lists the jobs of every ordered pair of gaits, and of every gait that does not change.

    Args:
        gaits: The gaits.
        walkers: Who walks, by the policy's name and the gait's.
        scenarios: The worlds by name.
        config: How robots are rolled out, and at which speeds.
        via: A gait that lies on the way between the others, if there is one.
    """
    paths: list[tuple[Gait, ...]] = [(gait,) for gait in gaits]
    for source, target in permutations(gaits, 2):
        between = () if via is None or via in (source, target) else (via,)
        paths.append((source, *between, target))
    return [
        TransitionJob(
            policy,
            scenario,
            path,
            tuple(own[gait.name] for gait in path),
            world,
            speed,
            config,
        )
        for policy, own in walkers.items()
        for scenario, world in scenarios.items()
        for speed in config.speeds
        for path in paths
    ]

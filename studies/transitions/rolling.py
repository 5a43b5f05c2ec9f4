"""Rolling robots out that change their gait while they walk."""

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from glassgait.diagrams.commands import FixedCommand
from glassgait.diagrams.engines import make_physics
from glassgait.diagrams.scenario import Scenario
from glassgait.diagrams.switching_batch import SwitchingSimulator
from glassgait.models.a1.robot import Array
from glassgait.models.policies.alternating import AlternatingPolicy
from glassgait.models.policies.switched import SwitchedPolicy
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.command import Command
from glassgait.models.task.gait import Gait
from glassgait.models.task.gait_switch import GaitSwitch
from glassgait.models.task.reward_machine import BoolArray, IntArray
from glassgait.models.task.termination import FAILURES
from glassgait.studies.records import to_plain
from glassgait.studies.transitions.config import TransitionConfig

FIRST_STEPS = 300
"""Control steps that a robot walks in its first gait before another is requested (6 s)."""

SPREAD_STEPS = 50
"""Requests come within so many control steps, each robot's at an instant of its own (1 s)."""

AFTER_STEPS = 500
"""Control steps from the request to the end (10 s)."""

BETWEEN_STEPS = 50
"""Control steps in a gait on the way before the next is requested, and of slow walking after a
change (1 s)."""

SCORED_STEPS = 300
"""Control steps at the end whose reward is compared (6 s)."""

KEPT = 0.8
"""Share of the commanded rhythm from which a cycle counts as kept."""


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
    walkers: tuple[AlternatingPolicy, ...]
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
        walkers = [(walker.acting_student or walker.expert).digest() for walker in self.walkers]
        experts = [walker.expert.digest() for walker in self.walkers]
        gaits = [gait.digest() for gait in self.path]
        # Each speed is rolled out by itself.
        config = to_plain(replace(self.config, speeds=(self.speed,)))
        whole = [walkers, experts, gaits, self.world.digest(), config]
        return hashlib.sha256(json.dumps(whole).encode()).hexdigest()[:16]


@dataclass(frozen=True)
class _Log:
    """What n robots did over T control steps.

    Attributes:
        running: Number of the gait that ran after each step (T, n).
        served: Control steps of rhythm that transitions served (T, n).
        reward: Reward (T, n); 0 after a failure.
        failures: Flags of the failures (T, n, 6).
    """

    running: IntArray
    served: Array
    reward: Array
    failures: BoolArray


def roll_transition(job: TransitionJob) -> pd.DataFrame:
    """Rolls a job's robots out, each with a dwell and an instant of the request of its own.

    Returns:
        A row a robot: the job's `labels`, `robot`, `dwell` (control steps); `fell`, whether it
        failed before the end, `failure`, by what, and `before`, whether that was before the
        request; `wait`, from the request of the last gait until it ran (s); `settling`, from then
        until its rhythm was kept (s), NaN where it never was; `reward`, the mean over the last
        seconds.
    """
    config, n = job.config, job.config.n_robots
    switch = GaitSwitch(job.path, config.patience)
    policy = SwitchedPolicy(switch, job.walkers, config.greatest_change)
    generator = np.random.default_rng(config.seed)
    low, high = switch.gait.dwell
    dwell = generator.integers(low, high + 1, n).astype(float)
    request = FIRST_STEPS + generator.integers(0, SPREAD_STEPS, n)
    simulator = SwitchingSimulator(
        switch,
        replace(job.world, command=FixedCommand(speed=job.speed, dwell=int(low))),
        make_physics(job.world.station),
        n_robots=n,
        generator=generator,
        estimator=policy.estimator,
    )
    log, asked = _advance(simulator, policy, job, dwell, request)
    rows = []
    n_states = job.path[-1].n_states - len(job.path[-1].faults)
    for i in range(n):
        alive = slice(0, request[i] + AFTER_STEPS)
        failed = log.failures[alive, i].any(axis=1)
        fell = bool(failed.any())
        end = int(np.argmax(failed)) if fell else len(failed)
        begun = np.flatnonzero(log.running[:end, i] == len(job.path) - 1)
        start = max(int(begun[0]), int(asked[i])) if len(begun) else None
        settled = None if start is None else _settled(log.served[:end, i], start, n_states)
        shown = log.failures[end, i] if fell else np.zeros(len(FAILURES), dtype=bool)
        rows.append(
            {
                **job.labels,
                "robot": i,
                "dwell": int(dwell[i]),
                "fell": fell,
                "before": fell and end < request[i],
                "failure": " ".join(np.array(FAILURES)[shown]),
                "wait": _seconds(start, int(asked[i])),
                "settling": _seconds(settled, start),
                "reward": float(log.reward[alive, i][-SCORED_STEPS:].mean()),
            }
        )
    return pd.DataFrame(rows)


def _advance(
    simulator: SwitchingSimulator,
    policy: SwitchedPolicy,
    job: TransitionJob,
    dwell: Array,
    request: IntArray,
) -> tuple[_Log, IntArray]:
    """Advances the robots to the end; returns when the last gait was requested of each, too."""
    n, last = simulator.n_robots, len(job.path) - 1
    failed = np.zeros(n, dtype=bool)
    # Control step at which the requested gait began, or will have been requested.
    since, asked = request.copy(), np.where(last > 0, -1, request)
    logged: list[tuple[IntArray, Array, Array, BoolArray]] = []
    for step in range(int(request.max()) + AFTER_STEPS):
        running = simulator.running
        arrived = running == simulator.requested
        # The first gait ran all the time before the request; others run a while on the way.
        rested = step - since >= np.where(simulator.requested == 0, 0, BETWEEN_STEPS)
        more = arrived & rested & (simulator.requested < last)
        simulator.requested = simulator.requested + more
        asked = np.where(more & (simulator.requested == last), step, asked)
        since = np.where(more, step, since)
        slow = (step >= request) & ((simulator.requested != running) | (running < last))
        slow |= (step >= request) & (last > 0) & (step - since < BETWEEN_STEPS)
        speed = job.speed * np.where(slow, job.config.slowdown, 1.0)
        simulator.set_command(Command(np.stack([speed, np.zeros(n)], axis=1), dwell))
        action = np.where(failed[:, None], 0.0, policy(simulator.observe()))
        outcome = simulator.step(action)
        failed |= outcome.failures.any(axis=1)
        begun = (simulator.running == simulator.requested) & (running != simulator.requested)
        since = np.where(begun, step + 1, since)
        reward = np.where(failed, 0.0, outcome.reward)
        logged.append((simulator.running, outcome.served_dwell, reward, outcome.failures))
    return _Log(*(np.array(values) for values in zip(*logged, strict=True))), asked


def _settled(served: Array, start: int, n_states: int) -> int | None:
    """Returns the step from which on a whole cycle of the gait kept `KEPT` of its rhythm.

    Args:
        served: Control steps of rhythm that transitions served (T,).
        start: Step at which the gait began.
        n_states: Transitions of a cycle.
    """
    changes = [start, *(start + 1 + np.flatnonzero(served[start + 1 :] > 0))]
    for first, last in zip(changes, changes[n_states:], strict=False):
        if served[first + 1 : last + 1].sum() >= KEPT * (last - first):
            return first
    return None


def _seconds(instant: int | None, since: int | None) -> float:
    if instant is None or since is None:
        return float("nan")
    return CONTROL_PERIOD * (instant - since)


def jobs_of_pairs(
    gaits: Sequence[Gait],
    walkers: dict[str, dict[str, AlternatingPolicy]],
    scenarios: dict[str, Scenario],
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
    for source in gaits:
        for target in gaits:
            if source != target:
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

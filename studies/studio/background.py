"""Work beside the live robot, in a process of its own: proofs and falls, as they are found."""

import multiprocessing
import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from itertools import product
from multiprocessing.connection import Connection
from typing import Any

from glassgait.diagrams.scenario import load_scenario
from glassgait.models.certificates.claims import claim_files, load_claims
from glassgait.models.certificates.prover import Outcome, Prover
from glassgait.models.policies.controller import AlternatingController
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.gait import Gait
from glassgait.studies.common.rollouts import SELECTION_SEEDS, RolloutConfig, roll_out

NICE = 10
"""By how much such work stands back behind the robot, which walks at real time."""

ROLLOUTS = RolloutConfig(n_steps=round(10.0 / CONTROL_PERIOD), seed=SELECTION_SEEDS[0], n_seeds=1)
"""How falls are counted: of the paper's 26 robots in 10 s, by a seed that no table reports."""


@dataclass(frozen=True)
class Decided:
    """What became of a claim.

    Attributes:
        number: How many claims were decided so far.
        total: How many there are.
        name: What it says.
        outcome: What became of it; None where it says nothing of such a policy.
        where: What comes closest to breaking it, in words.
    """

    number: int
    total: int
    name: str
    outcome: Outcome | None
    where: str


@dataclass(frozen=True)
class Counted:
    """Falls of one policy in a scenario.

    Attributes:
        number: How many counts are done.
        total: How many there are.
        title: The scenario's title.
        original: Whether they are the original policy's, not the edited one's.
        falls: Robots that fell.
        robots: How many robots there were.
    """

    number: int
    total: int
    title: str
    original: bool
    falls: int
    robots: int


def proved(policy: FormulaPolicy, gait: Gait) -> Iterator[Decided]:
    """Decides every claim that ships, about a policy.

    Raises:
        InputError: if there is no operating box of the gait.
    """
    prover = Prover(policy, gait)
    files = claim_files(imu=policy.layout.imu)
    claims = [own for path in files for own in load_claims(path, policy.robot, policy.joint_law)]
    for number, claim in enumerate(claims, start=1):
        verdict = prover.decide(claim)
        outcome, where = (verdict.outcome, verdict.where) if verdict else (None, "")
        yield Decided(number, len(claims), claim.name, outcome, where)


def counted(
    gait: Gait,
    controllers: tuple[AlternatingController, AlternatingController],
    scenarios: Sequence[str],
) -> Iterator[Counted]:
    """Counts falls of two controllers in scenarios, from the same states by the same commands.

    Args:
        gait: The gait.
        controllers: That of the edited policy, and the original's.
        scenarios: Names of scenarios.
    """
    total = len(scenarios) * len(controllers)
    for number, (name, (original, own)) in enumerate(
        product(scenarios, enumerate(controllers)), start=1
    ):
        scenario = load_scenario(name)
        falls = int(roll_out(gait, own, scenario, ROLLOUTS).failures.any(axis=(0, 2)).sum())
        robots = ROLLOUTS.robots_in(scenario)
        yield Counted(number, total, scenario.title, bool(original), falls, robots)


class Work:
    """A generator that runs in a process of its own, and what it has yielded so far.

    Attributes:
        found: What it yielded, as plain values.
        problem: Why it ended early, in a sentence; None where it did not.
    """

    def __init__(self, generator: Callable[..., Iterator[Any]], *arguments: Any) -> None:
        """
        Args:
            generator: A function of a module, which yields dataclasses.
            arguments: Its arguments, which are sent to the process.
        """
        self.found: list[dict[str, Any]] = []
        self.problem: str | None = None
        # Not a fork: this process has threads.
        context = multiprocessing.get_context("spawn")
        self._receiver, sender = context.Pipe(duplex=False)
        self._process = context.Process(
            target=_work, args=(sender, generator, arguments), daemon=True
        )
        self._process.start()
        sender.close()
        self._ended = False

    @property
    def runs(self) -> bool:
        """Whether more is to come, as far as `look` has seen."""
        return not self._ended

    def look(self) -> None:
        """Takes what has come, without waiting."""
        while not self._ended and self._receiver.poll():
            try:
                kind, value = self._receiver.recv()
            except EOFError:
                self.problem = "the process that worked on it ended; try again"
                self._end()
            else:
                if kind == "found":
                    self.found.append(value)
                else:
                    self.problem = value
                    self._end()

    def stop(self) -> None:
        """Ends it, if it runs."""
        if not self._ended:
            self._process.terminate()
            self._end()

    def _end(self) -> None:
        self._ended = True
        self._process.join()
        self._receiver.close()


def _work(sender: Connection, generator: Callable[..., Iterator[Any]], arguments: Any) -> None:
    os.nice(NICE)
    try:
        for value in generator(*arguments):
            sender.send(("found", asdict(value)))
    except Exception as error:
        sender.send(("ended", f"{type(error).__name__}: {error}"))
    else:
        sender.send(("ended", None))

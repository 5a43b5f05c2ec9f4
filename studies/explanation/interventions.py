"""`glassgait explain interventions`: tests whether robots move as terms of formulas predict.

The input of one term is raised by one standard deviation, and the same robots walk with and without
this change. A claim holds if the joint moves in the predicted direction by more than the half-width
of the 95 % interval.
"""

from dataclasses import replace
from pathlib import Path
from typing import Annotated, ClassVar

import numpy as np
import pandas as pd
from annotated_types import Ge
from numpy.typing import NDArray

from glassgait.diagrams.scenario import Scenario
from glassgait.models.arrays import Array
from glassgait.models.files import write_atomically
from glassgait.models.formulas.expression import canonical, plus
from glassgait.models.formulas.file import SUFFIX, FormulaFile, write_formulas
from glassgait.models.formulas.reader import read_formulas
from glassgait.models.policies.controller import alone
from glassgait.models.policies.policy import Policy
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.models.settings import Count, Seed, checked
from glassgait.models.task.gait import Gait
from glassgait.models.task.observation import indices_of, machine_state_entries
from glassgait.studies.common.console import console, say
from glassgait.studies.common.experiment import REPORTED_SEEDS
from glassgait.studies.common.observers import Observations
from glassgait.studies.common.rollouts import RolloutConfig, roll_out
from glassgait.studies.common.scores import interval
from glassgait.studies.common.tables import print_table, write_table
from glassgait.studies.distillation.students import OnePolicy
from glassgait.studies.explanation.claims import (
    Claim,
    Walk,
    derive_claims,
    readable_terms,
    refuse_too_few,
)


@checked
class ExplainInterventions(OnePolicy):
    """Raise the input of single terms of formulas, and measure whether joints move as predicted.

    Attributes:
        n_claims: Number of terms; those that move a target most are tested.
        n_robots: Number of robots in each walk.
        n_steps: Control steps of each walk.
        seed: Seed of starts, commands and noise, the same for every walk.
        output: Folder of the results; runs/explain/interventions/<gait>/<policy> by default.
    """

    title: ClassVar[str] = "explain interventions"

    n_claims: Count = 8
    n_robots: Annotated[Count, Ge(2)] = 26
    n_steps: Annotated[Count, Ge(2)] = 500
    seed: Seed = REPORTED_SEEDS[0]
    output: Path | None = None

    def run(self) -> None:
        """Derives claims, tests them, and writes the table and the edited formulas."""
        policies, name = self.find()
        policy, expert = policies.formulas(name), policies.expert_of(name)
        gait, file, stem = policies.gait, policy.to_file(), Path(name).stem
        folder = self.output or policies.output(self.title) / stem
        refuse_too_few(len(readable_terms(file)), self.n_claims)
        rollouts = RolloutConfig(
            n_robots=self.n_robots, n_steps=self.n_steps, seed=self.seed, n_seeds=1
        )

        # Every walk has the same starts, commands and noise.
        say("walking with the formulas as they are")
        plain = walk(gait, expert, policy, rollouts)
        rows = []
        for number, claim in enumerate(derive_claims(file, plain, self.n_claims), start=1):
            symbols, term = file.vocabulary.symbols, claim.term
            edit = f"{term.joint}: {term.text(symbols)} with {symbols[term.input]} + {claim.step:g}"
            say(f"walking with {edit}")
            text = f"# {edit}\n{write_formulas(with_input_raised(file, claim))}"
            write_atomically(folder / "edited" / f"{number}_{term.joint}{SUFFIX}", text)
            edited = FormulaPolicy.from_file(read_formulas(text), policy.robot)
            rows.append(result(claim, symbols, plain, walk(gait, expert, edited, rollouts)))

        table = pd.DataFrame(rows)
        write_table(table, folder / "interventions")
        print_table(f"{gait.name}: {stem}", table)
        n_holding = (table["holds"] == "yes").sum()
        console.print(f"{n_holding} of {len(table)} claims hold; written to {folder}")


def walk(gait: Gait, expert: Policy | None, policy: FormulaPolicy, rollouts: RolloutConfig) -> Walk:
    """Rolls out a policy without the expert, whose estimator it needs unless it has odometry."""
    observations = Observations()
    log = roll_out(gait, alone(policy, expert), Scenario(), rollouts, observers=[observations])
    fell = np.logical_or.accumulate(log.failures.any(axis=2), axis=0)
    return walk_of(policy, observations.array, ~fell[: len(observations.array)])


def walk_of(policy: FormulaPolicy, observed: Array, alive: NDArray[np.bool_]) -> Walk:
    """Returns the walk of robots from observations (T + 1, n, N) and a mask of those that are up
    (T + 1, n)."""
    names = policy.observation_names
    quantities = policy.quantities(observed)
    # The outcome of the last step was not observed.
    return Walk(
        quantities=quantities[:-1],
        state=np.argmax(quantities[:-1][..., machine_state_entries(names)], axis=-1),
        angle=quantities[1:][..., list(indices_of("joint position", names))],
        alive=alive[:-1],
    )


def with_input_raised(file: FormulaFile, claim: Claim) -> FormulaFile:
    """Returns a file in which the input of the claim's term is raised by the claim's step."""
    term, weight = claim.term, float(f"{claim.term.weight * claim.step:.4g}")
    edited = canonical(plus(file.formulas[term.place], term.with_gates(weight)))
    return replace(file, formulas={**file.formulas, term.place: edited})


def result(claim: Claim, symbols: tuple[str, ...], plain: Walk, edited: Walk) -> dict[str, object]:
    """Returns a row of the table, which compares the same robots with and without the change."""
    difference = pd.Series(mean_angle(claim, edited) - mean_angle(claim, plain)).dropna()
    measured = float(difference.mean()) if len(difference) else float("nan")
    margin = interval(difference)
    return {
        "joint": claim.term.joint,
        "state": "every" if claim.term.state is None else claim.term.state,
        "term": claim.term.text(symbols),
        "input raised by": claim.step,
        "predicted (rad)": claim.effect,
        "measured (rad)": measured,
        "± (rad)": margin,
        "holds": "yes" if np.sign(claim.effect) * measured > margin else "no",
        "falls": int((~edited.alive[-1]).sum()),
    }


def mean_angle(claim: Claim, walk: Walk) -> Array:
    """Returns each robot's mean joint angle at the claim's instants (n,; rad), or NaN."""
    mask = claim.instants(walk)
    counts = mask.sum(axis=0)
    total = np.where(mask, walk.angle[..., claim.term.place[-1]], 0.0).sum(axis=0)
    return np.where(counts > 0, total / np.maximum(counts, 1), np.nan)

"""Symbolic students: their settings, and the engines that search formulas, Operon and PySR."""

import subprocess
import sys
from collections.abc import Sequence
from dataclasses import replace
from itertools import product
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
from annotated_types import Ge, MinLen
from joblib import delayed

from glassgait.models.arrays import Array
from glassgait.models.errors import InputError, brief
from glassgait.models.formulas.evaluate import Tape
from glassgait.models.formulas.expression import Expression, scaled
from glassgait.models.formulas.grammar import parse_expression, variable_names
from glassgait.models.formulas.mirror import Place
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.models.robots import quadruped
from glassgait.models.settings import DISTINCT, FEW, IN_ORDER, Count, Natural, checked
from glassgait.studies.common.jobs import run_parallel
from glassgait.studies.distillation.dataset import TrainingSet
from glassgait.studies.distillation.formulas import (
    FormulaSamples,
    FormulaVariables,
    formula_policy,
    gates,
    readable,
    samples_by_state,
    settled,
    shared_gates,
)
from glassgait.studies.distillation.gated_sum import fit_gated_sums
from glassgait.studies.distillation.students import StudentSettings

Engine = Literal["operon", "pysr"]

Shape = Annotated[tuple[Count, Count], IN_ORDER]
"""Lengths of the sum that a formula starts from, and of the whole formula (nodes)."""


@checked
class SymbolicSettings(StudentSettings):
    """Settings of symbolic regression.

    Attributes:
        engine: `operon` works everywhere; `pysr` is the paper's and needs Julia.
        max_length: Greatest length of a formula in nodes, the paper's overall complexity (pysr). A
            weighted observation is one node to Operon and three to PySR.
        operator_complexity: Greatest length of the arguments of a function or a product, in nodes;
            sums are free (pysr).
        population: Formulas in a generation (operon).
        coefficient_iterations: Steps of least squares on a new formula's coefficients (operon).
        shapes: Lengths of the initial gated sum and of the whole formula. With equal lengths, the
            engine does not run (operon). Samples are collected with the first.
        start_weights: Weights of the samples of an episode's start. Samples are collected with the
            first; PySR uses only the first.
        max_samples: Greatest number of samples, evenly spaced, for the search (operon).
        alone_episodes: Episodes per round without the expert.
    """

    title: ClassVar[str] = "distillation: symbolic"

    engine: Engine = "operon"
    max_length: Annotated[Count, Ge(7)] = 90
    operator_complexity: Count = 4
    iterations: Count = 20
    generations: Count = 100
    population: Annotated[Count, Ge(2)] = 200
    coefficient_iterations: Natural = 3
    shapes: Annotated[tuple[Shape, ...], MinLen(1), FEW] = ((90, 90), (64, 64), (74, 90))
    start_weights: Annotated[tuple[Count, ...], MinLen(1), FEW, DISTINCT] = (1, 20)
    max_samples: Count = 3000
    alone_episodes: Count = 13  # type: ignore[assignment]

    def candidates(self) -> dict[str, tuple[Self, tuple[int, ...]]]:
        candidates: dict[str, tuple[Self, tuple[int, ...]]] = {}
        if self.engine == "pysr":
            return candidates
        for shape, weight in product(self.shapes, self.start_weights):
            title = f"sum of {shape[0]}, {shape[1]} in all"
            title += f", starts count {weight}" if weight > 1 else ""
            # At equal length, prefer the longer sum, since the engine's terms are hard to read.
            complexity = shape[1], -shape[0]
            settings = replace(self, shapes=(shape,), start_weights=(weight,))
            candidates[title] = settings, complexity
        return candidates


@checked
class SymbolicPerStateSettings(SymbolicSettings):
    """Settings of symbolic regression with one formula per joint and RM state.

    Attributes:
        mirrored: Whether formulas of one side are mirror images of the other's, if the gait's
            machine has a mirror image; each sample then counts twice.
    """

    title: ClassVar[str] = "distillation: symbolic_per_state"

    mirrored: bool = True
    # Samples are collected with the smallest, which strays furthest; they suit the larger too.
    shapes: Annotated[tuple[Shape, ...], MinLen(1), FEW] = tuple(
        (n, n) for n in (90, 150, 250, 400)
    )


OPERON_SCALING_NODES = 4  # nodes of the scale and offset that Operon adds to a formula

OPERON_SYMBOLS = "add,sub,mul,sin,tanh,square,constant,variable"

PYSR_FUNCTIONS = ("sin", "tanh", "square", "cube")


def fit_symbolic(samples: TrainingSet, settings: SymbolicSettings, *, seed: int) -> FormulaPolicy:
    """Fits one formula per joint."""
    variables = FormulaVariables(samples.robot, samples.observation_names)
    # Samples of an episode's start may count several times.
    weighted = samples.repeated(samples.starts, settings.start_weights[0])
    places = tuple((joint,) for joint in range(quadruped.N_JOINTS))
    targets = samples.robot.joint_targets(weighted.actions)
    group = FormulaSamples(places, weighted.observations, targets)
    formulas = fit_formulas(group, variables, shared_gates(variables.vocabulary), settings, seed)
    return formula_policy(samples, variables.vocabulary, dict(zip(places, formulas, strict=True)))


def fit_symbolic_per_state(
    samples: TrainingSet, settings: SymbolicPerStateSettings, *, seed: int
) -> FormulaPolicy:
    """Fits one formula per joint and RM state; with a mirror, only those of one side."""
    names, mirror = samples.observation_names, samples.mirror if settings.mirrored else None
    variables = FormulaVariables(samples.robot, names)
    state_gates = gates(variables.vocabulary)

    # Fit the states in sequence, and the joints of a state in parallel.
    formulas: dict[Place, Expression] = {}
    weighted = samples.repeated(samples.starts, settings.start_weights[0])
    for group in samples_by_state(weighted, variables.vocabulary, mirror):
        fitted = fit_formulas(group, variables, state_gates, settings, seed)
        for place, formula in zip(group.places, fitted, strict=True):
            formulas[place] = settled(formula, names, place[0])
    return formula_policy(samples, variables.vocabulary, formulas, mirror)


def fit_formulas(
    group: FormulaSamples,
    variables: FormulaVariables,
    gates: Sequence[Expression],
    settings: SymbolicSettings,
    seed: int,
) -> list[Expression]:
    """Fits a formula for each joint, or joint and RM state, with rounded coefficients."""
    values, targets = variables(group.observations), group.targets
    n_observed = group.observations.shape[1]
    seeds, observed = range(seed, seed + targets.shape[1]), values[:, :n_observed]
    if settings.engine == "pysr":
        searches = (
            delayed(_fit_pysr)(observed, target, each, settings)
            for target, each in zip(targets.T, seeds, strict=True)
        )
        return readable(list(run_parallel(searches)), values, targets)

    # Least squares finds sums much faster than evolution does. Therefore fit a sparse gated sum
    # first, and let the engine evolve a formula for its residuals.
    sum_length, length = settings.shapes[0]
    sums = fit_gated_sums(values, targets, gates, sum_length, n_observed)
    if sum_length == length:
        return readable(sums, values, targets)
    residuals = targets - Tape(sums, values.shape[1])(values)
    searches = (
        delayed(_evolve)(observed, residual, length - start.length - 1, each, settings)
        for start, residual, each in zip(sums, residuals.T, seeds, strict=True)
    )
    corrections = run_parallel(searches)
    formulas = [Expression("add", pair) for pair in zip(sums, corrections, strict=True)]
    return readable(formulas, values, targets)


def _evolve(
    observations: Array, target: Array, max_length: int, seed: int, settings: SymbolicSettings
) -> Expression:
    from pyoperon.sklearn import SymbolicRegressor

    # Use every n-th sample, and scale the variables to equal spread.
    stride = max(1, -(-len(target) // settings.max_samples))
    scale = np.std(observations, axis=0)
    scale[scale == 0] = 1.0
    engine = SymbolicRegressor(
        allowed_symbols=OPERON_SYMBOLS,
        max_length=max(3, max_length - OPERON_SCALING_NODES),
        population_size=settings.population,
        generations=settings.generations,
        # Only the generations end the search: a limit in seconds would not be reproducible.
        max_evaluations=10**9,
        optimizer_iterations=settings.coefficient_iterations,
        objectives=["r2"],
        model_selection_criterion="mean_squared_error",
        n_threads=1,
        random_state=seed,
    ).fit((observations / scale)[::stride], target[::stride])

    # Parse the formula, and undo the scaling.
    names = variable_names(observations.shape[1])
    text = engine.get_model_string(engine.model_, precision=12, names=list(names))
    return _rescaled(parse_expression(text, names), scale)


def _rescaled(expression: Expression, scale: Array) -> Expression:
    """Turns a formula of scaled variables into one of unscaled variables."""
    match expression:
        case Expression("variable", variable=index):
            return scaled(expression, 1.0 / scale[index])
        case Expression(
            "mul", (Expression("constant", value=factor), Expression("variable") as weighted)
        ):
            return scaled(weighted, factor / scale[weighted.variable])
        case _:
            operands = tuple(_rescaled(operand, scale) for operand in expression.operands)
            return Expression(expression.operator, operands, expression.value, expression.variable)


def pysr_arguments(seed: int, settings: SymbolicSettings) -> dict[str, Any]:
    """Returns the arguments of `PySRRegressor`: the paper's operators, limits and iterations."""
    # PySR's `constraints` limit the size of the arguments of functions and products. Sums have no
    # limit, since otherwise no formula could have the paper's 90 nodes.
    limit = settings.operator_complexity
    return {
        "unary_operators": list(PYSR_FUNCTIONS),
        "binary_operators": ["+", "-", "*"],
        "constraints": dict.fromkeys(PYSR_FUNCTIONS, limit) | {"*": (limit, limit)},
        "maxsize": settings.max_length,
        "niterations": settings.iterations,
        "random_state": seed,
        "deterministic": True,
        "parallelism": "serial",
        "progress": False,
        "verbosity": 0,
        "temp_equation_file": True,
    }


def pysr_starts() -> bool:
    """Returns whether PySR and Julia start; PySR first downloads Julia if it is missing."""
    # Start them in another process, since one with both PyTorch and Julia may crash.
    command = [sys.executable, "-c", "import pysr"]
    return subprocess.run(command, capture_output=True, check=False).returncode == 0


def _fit_pysr(
    observations: Array, target: Array, seed: int, settings: SymbolicSettings
) -> Expression:
    try:
        # Importing PySR starts Julia, and downloads it first if it is missing.
        from pysr import PySRRegressor
    except Exception as error:
        raise InputError(
            "the engine 'pysr' needs Julia, which could not be started here; install Julia, "
            "or use the engine 'operon'"
        ) from error
    names = variable_names(observations.shape[1])
    model: Any = PySRRegressor(**pysr_arguments(seed, settings))
    try:
        model.fit(observations, target, variable_names=list(names))
        text = str(model.get_best()["equation"])
    except Exception as error:
        # Julia's errors have no common class.
        problem = brief(str(error)) or type(error).__name__
        raise InputError(
            f"the engine 'pysr' failed ({problem}); change its settings, or use the engine 'operon'"
        ) from error
    return parse_expression(text, names)

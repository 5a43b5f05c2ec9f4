"""Formulas fitted to samples: sums with gates, Operon, and PySR."""

import ast
import importlib.util
import shutil
import sys
from itertools import product
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from sklearn.linear_model import LinearRegression

from glassgait.models.errors import InputError
from glassgait.models.formulas.expression import Expression, canonical
from glassgait.models.formulas.quantities import Vocabulary
from glassgait.models.formulas.tape import Tape
from glassgait.models.formulas.text import parse_formula, write_formula
from glassgait.models.robots.library import load_robot
from glassgait.models.task.observation import ObservationLayout
from glassgait.studies.distillation.students.formula_samples import FormulaSamples
from glassgait.studies.distillation.students.gated_sum import fit_gated_sums
from glassgait.studies.distillation.students.symbolic import FormulaFit, gates, rounded, settled
from glassgait.studies.distillation.students.symbolic_regression import (
    SymbolicSettings,
    fit_formulas,
    pysr_arguments,
)

A1 = load_robot()


GATES = (Expression("variable", variable=4), Expression("variable", variable=5))


def sample_of_a_gated_law(generator, count=3000):
    x = generator.normal(size=(count, 6))
    x[:, 4] = generator.random(count) < 0.5
    x[:, 5] = generator.random(count) < 0.3
    return x, 1.0 + 2.0 * x[:, 0] + x[:, 4] * (3.0 * x[:, 1] - 1.0) + x[:, 5] * x[:, 2]


def test_gated_sum_finds_a_gated_law(generator):
    x, y = sample_of_a_gated_law(generator)
    [formula] = fit_gated_sums(x, y[:, None], gates=GATES, max_length=60)
    assert formula.length <= 60
    error = Tape([formula], 6)(x)[:, 0] - y
    assert error.var() < 1e-4 * y.var()


def test_weights_of_what_moves_together_do_not_grow_against_one_another(generator):
    x = generator.normal(size=(500, 2))
    x[:, 1] = x[:, 0] + 1e-3 * x[:, 1]
    y = x[:, 0] + 0.1 * generator.normal(size=500)
    [formula] = fit_gated_sums(x, y[:, None], gates=(), max_length=10)
    slopes = [formula.derivative(variable).value for variable in (0, 1)]
    assert max(map(abs, slopes)) < 1.1


def test_a_gate_of_the_vocabulary_is_found(trot, generator):
    names = ObservationLayout(trot.n_states).names
    fit = FormulaFit(A1, names, gates)
    observations = generator.normal(size=(2000, len(names)))
    observations[:, names.index("RM Iters")] = generator.uniform(0.0, 1.0, size=2000)
    values = fit.values(observations)
    late = fit.vocabulary.variable("late")
    y = (1.0 + 2.0 * values[:, late.variable]) * values[:, 0]
    [formula] = fit_gated_sums(
        values, y[:, None], gates=(late,), max_length=20, weighted=len(names)
    )
    error = Tape([formula], values.shape[1])(values)[:, 0] - y
    assert error.var() < 1e-4 * y.var()
    assert max(formula.variables) == late.variable


def test_fitted_formulas_have_three_digits_and_no_bias(trot, generator):
    names = ObservationLayout(trot.n_states).names
    fit = FormulaFit(A1, names, gates)
    observations = generator.normal(size=(1000, len(names)))
    weights = generator.normal(size=(len(names), 12))
    actions = observations @ weights + 0.1 * generator.normal(size=(1000, 12))
    settings = SymbolicSettings(shapes=((40, 40),))
    targets = A1.joint_targets(actions)
    part = FormulaSamples(tuple((joint,) for joint in range(12)), observations, targets)
    formulas = fit(part, 0, settings)
    for formula in formulas:
        assert formula == canonical(formula) == rounded(formula)
    residual = targets - Tape(formulas, len(fit.vocabulary.symbols))(fit.values(observations))
    assert np.abs(residual.mean(axis=0)).max() < 5e-3


def test_the_state_that_a_formula_serves_is_put_in():
    names = ObservationLayout(2).names
    symbols = Vocabulary(names).symbols
    formula = parse_formula("0.5*s0 + t*(s1 - 3) - cmd.v", symbols)
    reported = [write_formula(settled(formula, names, state), symbols) for state in (0, 1)]
    assert reported == ["0.5 + t*(0 - 3) - cmd.v", "0 + t*(1 - 3) - cmd.v"]


def test_gated_sum_keeps_its_bound(generator):
    x, y = sample_of_a_gated_law(generator)
    sizes = [fit_gated_sums(x, y[:, None], GATES, bound)[0].length for bound in (1, 10, 20)]
    assert all(size <= bound for size, bound in zip(sizes, (1, 10, 20), strict=True))


def test_operon_finds_what_is_not_linear(generator):
    x = generator.normal(size=(1500, 5))
    x[:, 3] = 0.0
    y = 2.0 * x[:, 0] + np.tanh(3.0 * x[:, 1] * x[:, 2])
    settings = SymbolicSettings(population=100, generations=20, max_samples=500, shapes=((10, 60),))
    gate = Expression("variable", variable=3)
    [formula] = fit_formulas(x, y[:, None], 0, settings, gates=(gate,), n_observed=5)
    linear = LinearRegression().fit(x, y).score(x, y)
    error = Tape([formula], 5)(x)[:, 0] - y
    assert formula.length <= 60
    assert 1 - error.var() / y.var() > linear + 0.05


def reachable_sizes(arguments):
    """Lists the sizes that formulas can have, by what PySR documents of its limits.

    A constant, a variable and an operator count one each. A constraint bounds the size of each
    argument of an operator, and one of -1, the default, does not; `maxsize` bounds the whole.
    """
    limits = [(arguments["constraints"].get(name, -1),) for name in arguments["unary_operators"]]
    limits += [
        arguments["constraints"].get(name, (-1, -1)) for name in arguments["binary_operators"]
    ]
    sizes, before = {1}, set()
    while sizes != before:
        before = sizes
        for own in limits:
            fit = [[size for size in sizes if most == -1 or size <= most] for most in own]
            sizes = sizes | {1 + sum(operands) for operands in product(*fit)}
        sizes = {size for size in sizes if size <= arguments["maxsize"]}
    return sizes


def test_pysr_searches_formulas_of_the_papers_size():
    arguments = pysr_arguments(0, SymbolicSettings(engine="pysr"))
    assert reachable_sizes(arguments) == set(range(1, 91))
    # Where sums are bounded as products are, no formula has the paper's 90 nodes.
    everywhere = arguments["constraints"] | {"+": (4, 4), "-": (4, 4)}
    assert max(reachable_sizes(arguments | {"constraints": everywhere})) == 9


@pytest.fixture
def constructor():
    """The signature of PySR's regressor, by argument.

    Importing PySR would start Julia; its constructor is read from the installed text instead.
    """
    pysr = importlib.util.find_spec("pysr")
    if pysr is None or pysr.origin is None:
        pytest.skip("needs pysr (the dev extra)")
    source = (Path(pysr.origin).parent / "sr.py").read_text()
    regressor = next(
        node
        for node in ast.parse(source).body
        if isinstance(node, ast.ClassDef) and node.name == "PySRRegressor"
    )
    return next(
        node.args
        for node in regressor.body
        if isinstance(node, ast.FunctionDef) and node.name == "__init__"
    )


def test_pysr_is_asked_as_the_paper_did(constructor):
    arguments = pysr_arguments(0, SymbolicSettings(engine="pysr"))
    assert arguments["unary_operators"] == ["sin", "tanh", "square", "cube"]
    assert arguments["binary_operators"] == ["+", "-", "*"]
    assert arguments["maxsize"] == 90
    assert arguments["niterations"] == 20
    assert set(arguments) <= {own.arg for own in (*constructor.args, *constructor.kwonlyargs)}
    # Functions and products are bounded in PySR's terms, sums are free.
    assert arguments["constraints"] == dict.fromkeys(("sin", "tanh", "square", "cube"), 4) | {
        "*": (4, 4)
    }


def test_pysr_selects_by_its_own_default(constructor):
    assert "model_selection" not in pysr_arguments(0, SymbolicSettings(engine="pysr"))
    position = [own.arg for own in constructor.args].index("model_selection")
    default = constructor.defaults[position - len(constructor.args)]
    assert ast.literal_eval(default) == "best"


def use_pysr_that_finds(monkeypatch, found):
    """Puts a regressor in PySR's place that finds an equation, or raises what it is given."""

    class Regressor:
        def __init__(self, **arguments):
            assert set(arguments) == set(pysr_arguments(0, SymbolicSettings()))

        def fit(self, observations, target, variable_names):
            assert variable_names == ["x0", "x1", "x2"]
            if isinstance(found, Exception):
                raise found

        def get_best(self):
            return {"equation": found}

    monkeypatch.setitem(sys.modules, "pysr", SimpleNamespace(PySRRegressor=Regressor))


def fit_by_pysr(generator):
    observations = generator.normal(size=(10, 3))
    settings = SymbolicSettings(engine="pysr")
    return observations, fit_formulas(observations, np.zeros((10, 1)), 0, settings, (), 3)


def test_what_pysr_finds_is_read(monkeypatch, generator):
    use_pysr_that_finds(monkeypatch, "cube(x0) + (square(x1) - (sin(x2) * -0.25))")
    x, [formula] = fit_by_pysr(generator)
    expected = x[:, 0] ** 3 + x[:, 1] ** 2 + 0.25 * np.sin(x[:, 2])
    np.testing.assert_allclose(Tape([formula], 3)(x)[:, 0], expected, rtol=1e-12)


@pytest.mark.parametrize(
    ("error", "reported"),
    [
        (RuntimeError("Julia: MethodError\n  in loop"), r"\(Julia: MethodError in loop\)"),
        (MemoryError(), r"\(MemoryError\)"),
    ],
)
def test_an_error_of_pysrs_search_is_reported_in_one_sentence(
    error, reported, monkeypatch, generator
):
    use_pysr_that_finds(monkeypatch, error)
    with pytest.raises(InputError, match=f"engine 'pysr' ended with an error {reported}") as raised:
        fit_by_pysr(generator)
    assert "\n" not in str(raised.value)


def test_pysr_without_julia_is_refused_in_one_sentence(monkeypatch, generator):
    monkeypatch.setitem(sys.modules, "pysr", None)
    with pytest.raises(InputError, match="needs Julia") as raised:
        fit_by_pysr(generator)
    assert "\n" not in str(raised.value)


@pytest.mark.skipif(shutil.which("julia") is None, reason="Julia is not installed")
@pytest.mark.slow
def test_pysr_finds_a_law(generator):
    x = generator.normal(size=(200, 3))
    product = x[:, :1] * x[:, 1:2]
    [formula] = fit_formulas(x, product, 0, SymbolicSettings(engine="pysr"), (), 3)
    np.testing.assert_allclose(Tape([formula], 3)(x)[:, 0], product[:, 0], atol=1e-3)

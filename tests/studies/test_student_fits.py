"""Single fits of students, each to a law that it must find."""

import ast
import importlib.util
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from sklearn.linear_model import LinearRegression

from glassgait.models.errors import InputError
from glassgait.models.formulas.evaluate import Tape
from glassgait.models.formulas.expression import Expression, canonical
from glassgait.models.formulas.quantities import Vocabulary
from glassgait.models.robots import quadruped
from glassgait.models.robots.library import load_robot
from glassgait.models.task.observation import (
    REFLECT_JOINTS,
    ObservationLayout,
    machine_state_entries,
    reflect_observation,
)
from glassgait.studies.distillation.dataset import Dataset, TrainingSet, r2_scores
from glassgait.studies.distillation.formulas import (
    FormulaSamples,
    FormulaVariables,
    gates,
    rounded,
    samples_by_state,
    written_places,
)
from glassgait.studies.distillation.gated_sum import fit_gated_sums
from glassgait.studies.distillation.short_formulas import (
    FormulasSettings,
    allot,
    fit_short_formulas,
)
from glassgait.studies.distillation.symbolic import (
    SymbolicPerStateSettings,
    SymbolicSettings,
    fit_formulas,
    fit_symbolic_per_state,
    pysr_arguments,
)

A1 = load_robot()
NAMES = ObservationLayout(2).names
MIRRORS = {"trot": (1, 0), "bound": (0, 1)}


def samples_of(actions_at, generator, count=400, mirror=None, scale=1.0):
    """Samples of a law that maps observations (m, n) and states (m,) to actions (m, 12)."""
    observations = scale * generator.normal(size=(count, len(NAMES)))
    state = generator.integers(2, size=count)
    observations[:, machine_state_entries(NAMES)] = np.eye(2)[state]
    starts = np.zeros(count, dtype=bool)
    return TrainingSet("trot", NAMES, observations, actions_at(observations, state), starts, mirror)


def sparse_law(observations, state):
    """Three observations determine a joint, and a fourth moves another a little."""
    actions = np.zeros((len(observations), quadruped.N_JOINTS))
    actions[:, 2] = 2.0 * observations[:, 0] + observations[:, 3] - 0.5 * observations[:, 15]
    actions[:, 7] = 0.01 * observations[:, 33]
    return actions


GATES = (Expression("variable", variable=4), Expression("variable", variable=5))


def sample_of_a_gated_law(generator, count=3000):
    x = generator.normal(size=(count, 6))
    x[:, 4] = generator.random(count) < 0.5
    x[:, 5] = generator.random(count) < 0.3
    return x, 1.0 + 2.0 * x[:, 0] + x[:, 4] * (3.0 * x[:, 1] - 1.0) + x[:, 5] * x[:, 2]


def test_a_gated_sum_finds_a_gated_law_and_keeps_its_bound(generator):
    x, y = sample_of_a_gated_law(generator)
    [formula] = fit_gated_sums(x, y[:, None], gates=GATES, max_length=60)
    error = Tape([formula], 6)(x)[:, 0] - y
    assert error.var() < 1e-4 * y.var()
    for bound in (1, 10, 20, 60):
        assert fit_gated_sums(x, y[:, None], GATES, bound)[0].length <= bound


def test_weights_of_what_moves_together_do_not_grow_against_one_another(generator):
    x = generator.normal(size=(500, 2))
    x[:, 1] = x[:, 0] + 1e-3 * x[:, 1]
    y = x[:, 0] + 0.1 * generator.normal(size=500)
    [formula] = fit_gated_sums(x, y[:, None], gates=(), max_length=10)
    slopes = [formula.derivative(variable).value for variable in (0, 1)]
    assert max(map(abs, slopes)) < 1.1


def test_fitted_formulas_have_three_digits_and_no_bias(generator):
    weights = generator.normal(size=(len(NAMES), 12))
    samples = samples_of(
        lambda x, _: x @ weights + 0.1 * generator.normal(size=(len(x), 12)), generator, 1000
    )
    variables, settings = FormulaVariables(A1, NAMES), SymbolicSettings(shapes=((40, 40),))
    targets = A1.joint_targets(samples.actions)
    part = FormulaSamples(tuple((j,) for j in range(12)), samples.observations, targets)
    formulas = fit_formulas(part, variables, gates(variables.vocabulary), settings, 0)
    for formula in formulas:
        assert formula == canonical(formula) == rounded(formula)
    values = variables(samples.observations)
    residual = targets - Tape(formulas, values.shape[1])(values)
    assert np.abs(residual.mean(axis=0)).max() < 5e-3


def test_statewise_formulas_are_fitted_to_their_states(generator):
    def law(x, state):
        return np.where(state == 0, 1.0, -1.0)[:, None] * x[:, 2:14] + np.roll(x[:, 2:14], 1, 1)

    samples = samples_of(law, generator)
    settings = SymbolicPerStateSettings(population=20, generations=2, shapes=((10, 20),))
    policy = fit_symbolic_per_state(samples, settings, seed=0)
    data = Dataset(samples.observations, samples.actions, np.ones(400, dtype=np.int64))
    assert r2_scores(policy, data).min() > 0.99
    assert len(policy.to_file().written()) == 24


@pytest.mark.parametrize(("gait", "states"), [("trot", {0}), ("bound", {0, 1})])
def test_half_of_the_formulas_are_written_and_mirrored_samples_count_twice(gait, states, generator):
    vocabulary, samples = Vocabulary(NAMES), samples_of(sparse_law, generator)
    places = written_places(vocabulary, MIRRORS[gait])
    assert len(places) == 12
    assert {state for state, _ in places} == states
    parts = samples_by_state(samples, vocabulary, MIRRORS[gait])
    assert sum(len(part.targets) for part in parts) == 400 * len(states)
    reflect = reflect_observation(NAMES, MIRRORS[gait])
    whole = {row.tobytes() for row in samples.observations}
    whole |= {row.tobytes() for row in reflect(samples.observations)}
    assert {row.tobytes() for part in parts for row in part.observations} <= whole


def fit_short(samples):
    return fit_short_formulas(samples, FormulasSettings(terms=20), seed=0)


def fit_long(samples):
    return fit_symbolic_per_state(samples, SymbolicPerStateSettings(shapes=((20, 20),)), seed=0)


@pytest.mark.parametrize("gait", MIRRORS)
@pytest.mark.parametrize("fit", [fit_short, fit_long])
def test_mirrored_formulas_act_alike_on_both_sides(gait, fit, generator):
    samples = samples_of(sparse_law, generator, mirror=MIRRORS[gait], scale=0.3)
    policy, reflect = fit(samples), reflect_observation(NAMES, MIRRORS[gait])
    assert len(policy.to_file().written()) == 12
    mirrored = policy(reflect(samples.observations))
    np.testing.assert_allclose(mirrored, REFLECT_JOINTS(policy(samples.observations)), atol=1e-12)


def test_a_term_goes_where_it_helps_most():
    slow = np.array([1.0, 0.9, 0.8, 0.7])
    fast = np.array([5.0, 1.0, 0.9, 0.9])
    assert allot([slow, fast], 3) == [0, 1]
    assert allot([slow, fast], 4) == [1, 1]
    # Two terms may help together where the first alone does not.
    assert allot([slow, np.array([5.0, 5.0, 0.0])], 4) == [0, 2]
    # A term that does not help is not taken.
    assert allot([np.array([1.0, 1.0, 1.0])], 3) == [0]


@pytest.mark.parametrize("local", [True, False])
def test_a_sparse_law_is_found_in_few_terms(local, generator):
    # In few samples, products of the speed with a calf's last target look like the speed alone.
    samples = samples_of(sparse_law, generator, count=2000, scale=0.3)
    policy = fit_short_formulas(samples, FormulasSettings(terms=30, local=local), seed=0)
    assert policy.n_terms() == 30
    lengths = [[len(formula.terms()) for formula in own] for own in policy.formulas_by_state]
    assert [own[2] for own in lengths] == [4, 4]
    np.testing.assert_allclose(policy(samples.observations), samples.actions, atol=0.05)


def test_formulas_of_a_leg_use_no_other_leg(generator):
    # The other front leg decides a calf's target.
    samples = samples_of(lambda x, _: np.outer(x[:, 5], np.arange(12) == 2), generator, scale=0.3)
    policy = fit_short_formulas(samples, FormulasSettings(terms=100), seed=0)
    for joint, formula in enumerate(policy.formulas_by_state[0]):
        used = policy.vocabulary.expanded(formula).variables
        legs = {ObservationLayout(2).entries[index].leg for index in used}
        assert legs <= {None, quadruped.LEGS[joint // 3]}


def test_each_formula_can_have_a_term_for_robots_that_wait(generator):
    samples = samples_of(sparse_law, generator, scale=0.3)
    policy = fit_short_formulas(samples, FormulasSettings(terms=60, reflexes=True), seed=0)
    wait = policy.vocabulary.symbols.index("wait")
    for formulas in policy.formulas_by_state:
        assert all(wait in formula.variables for formula in formulas)
    assert policy.n_terms() <= 60


class PlainVariables:
    """Observations as the variables of formulas, as they are."""

    def __call__(self, observations):
        return observations


def search(x, y, settings, opened=()):
    """Searches the formula of one target (m,)."""
    [formula] = fit_formulas(
        FormulaSamples(((0,),), x, y[:, None]), PlainVariables(), opened, settings, 0
    )
    return formula, Tape([formula], x.shape[1])(x)[:, 0]


def test_operon_finds_what_is_not_linear(generator):
    x = generator.normal(size=(1500, 5))
    x[:, 3] = 0.0
    y = 2.0 * x[:, 0] + np.tanh(3.0 * x[:, 1] * x[:, 2])
    settings = SymbolicSettings(population=100, generations=20, max_samples=500, shapes=((10, 60),))
    formula, found = search(x, y, settings, (Expression("variable", variable=3),))
    assert formula.length <= 60
    linear = LinearRegression().fit(x, y).score(x, y)
    assert 1 - (found - y).var() / y.var() > linear + 0.05


def test_pysr_is_asked_as_the_paper_did():
    arguments = pysr_arguments(0, SymbolicSettings(engine="pysr"))
    functions = ["sin", "tanh", "square", "cube"]
    assert arguments["unary_operators"] == functions
    assert arguments["binary_operators"] == ["+", "-", "*"]
    assert (arguments["maxsize"], arguments["niterations"]) == (90, 20)
    # Functions and products are bounded in PySR's terms, sums are free.
    assert arguments["constraints"] == dict.fromkeys(functions, 4) | {"*": (4, 4)}
    pysr = importlib.util.find_spec("pysr")
    if pysr is None or pysr.origin is None:
        pytest.skip("needs pysr (the dev extra)")
    # Importing PySR would start Julia; its constructor is read from the installed text instead.
    tree = ast.parse((Path(pysr.origin).parent / "sr.py").read_text())
    (regressor,) = (own for own in tree.body if getattr(own, "name", "") == "PySRRegressor")
    (init,) = (own for own in regressor.body if getattr(own, "name", "") == "__init__")
    names = [own.arg for own in (*init.args.args, *init.args.kwonlyargs)]
    assert set(arguments) <= set(names)
    # It selects by its own default.
    assert "model_selection" not in arguments
    position = names.index("model_selection") - len(init.args.args)
    assert ast.literal_eval(init.args.defaults[position]) == "best"


@pytest.fixture
def use_pysr_that_finds(monkeypatch):
    """Puts a regressor in PySR's place that finds an equation, or raises an error."""

    def use(found):
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

    return use


PYSR = SymbolicSettings(engine="pysr")


def test_what_pysr_finds_is_read(use_pysr_that_finds, generator):
    use_pysr_that_finds("cube(x0) + (square(x1) - (sin(x2) * -0.25))")
    x = generator.normal(size=(10, 3))
    y = x[:, 0] ** 3 + x[:, 1] ** 2 + 0.25 * np.sin(x[:, 2])
    np.testing.assert_allclose(search(x, y, PYSR)[1], y, rtol=1e-12)


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (RuntimeError("Julia: MethodError\n  in loop"), r"\(Julia: MethodError in loop\)"),
        (MemoryError(), r"\(MemoryError\)"),
        (None, "needs Julia"),
    ],
)
def test_an_error_of_pysr_is_reported_in_one_sentence(
    error, said, use_pysr_that_finds, monkeypatch, generator
):
    use_pysr_that_finds(error)
    if error is None:
        monkeypatch.setitem(sys.modules, "pysr", None)
    with pytest.raises(InputError, match=said) as raised:
        search(generator.normal(size=(10, 3)), np.zeros(10), PYSR)
    assert "\n" not in str(raised.value)

"""Pages of formulas: who gets the terms, whose samples count, and the command."""

import numpy as np
import pytest

from glassgait.models.errors import InputError
from glassgait.models.formulas.mirror import FormulaMirror
from glassgait.models.formulas.quantities import Vocabulary
from glassgait.models.policies.library import load_expert, load_policy
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.models.robots import quadruped
from glassgait.models.task.observation import ObservationLayout, machine_state_entries
from glassgait.models.task.symmetry import REFLECT_JOINTS, reflect_observation
from glassgait.studies.cli import main
from glassgait.studies.distillation.students.formula_samples import samples_by_state, written_places
from glassgait.studies.distillation.students.sparse_formula import allot, condense
from glassgait.studies.distillation.students.student import TrainingSet
from glassgait.studies.distillation.students.symbolic import STATEWISE_SYMBOLIC
from glassgait.studies.distillation.students.symbolic_regression import StatewiseSymbolicSettings

NAMES = ObservationLayout(2).names
MIRRORS = {"trot": (1, 0), "bound": (0, 1)}


def samples_of_a_sparse_law(generator, mirror=None, count=400):
    """Actions that three observations determine, and a little of a fourth."""
    observations = 0.3 * generator.normal(size=(count, len(NAMES)))
    observations[:, machine_state_entries(NAMES)] = np.eye(2)[generator.integers(2, size=count)]
    actions = np.zeros((count, quadruped.N_JOINTS))
    actions[:, 2] = 2.0 * observations[:, 0] + observations[:, 5] - 0.5 * observations[:, 20]
    actions[:, 7] = 0.01 * observations[:, 30]
    starts = np.zeros(count, dtype=bool)
    return TrainingSet("trot", NAMES, observations, actions, starts, mirror)


@pytest.mark.parametrize(("gait", "states"), [("trot", {0}), ("bound", {0, 1})])
def test_half_of_the_formulas_are_written(gait, states):
    places = written_places(Vocabulary(NAMES), MIRRORS[gait])
    assert len(places) == 12
    assert {state for state, _ in places} == states
    image = FormulaMirror.of(Vocabulary(NAMES), MIRRORS[gait])
    assert not {image.place(place) for place in places} & {*places}
    assert len(written_places(Vocabulary(NAMES), None)) == 24


@pytest.mark.parametrize("gait", MIRRORS)
def test_mirrored_samples_count_twice(gait, generator):
    data = samples_of_a_sparse_law(generator)
    parts = samples_by_state(data, Vocabulary(NAMES), MIRRORS[gait])
    assert sum(len(part.targets) for part in parts) == {"trot": 400, "bound": 800}[gait]
    reflect = reflect_observation(NAMES, MIRRORS[gait])
    whole = {row.tobytes() for row in data.observations}
    whole |= {row.tobytes() for row in reflect(data.observations)}
    assert {row.tobytes() for part in parts for row in part.observations} <= whole


def test_a_term_goes_where_it_helps_most():
    slow = np.array([1.0, 0.9, 0.8, 0.7])
    fast = np.array([5.0, 1.0, 0.9, 0.9])
    assert allot([slow, fast], 3) == [0, 1]
    assert allot([slow, fast], 4) == [1, 1]
    # Two terms may help together where the first alone does not.
    assert allot([slow, np.array([5.0, 5.0, 0.0])], 4) == [0, 2]
    # What does not help is not taken.
    assert allot([np.array([1.0, 1.0, 1.0])], 3) == [0]


def test_a_sparse_law_is_found_in_few_terms(generator):
    # Of few samples, what a calf's last target times the speed does looks like the speed alone.
    data = samples_of_a_sparse_law(generator, count=2000)
    page = condense(data, [24 + 6], mirrored=True)[24 + 6]
    assert page.n_terms() == 30
    lengths = [[len(formula.terms()) for formula in own] for own in page.formulas_by_state]
    assert [own[2] for own in lengths] == [4, 4]
    np.testing.assert_allclose(page(data.observations), data.actions, atol=0.05)


def page_of_formulas(samples):
    return condense(samples, [20], mirrored=True)[20]


def longer_formulas(samples):
    settings = StatewiseSymbolicSettings(shapes=((20, 20),))
    policy = STATEWISE_SYMBOLIC.fit(samples, settings, seed=0, n_jobs=1)
    assert isinstance(policy, FormulaPolicy)
    return policy


@pytest.mark.parametrize("gait", MIRRORS)
@pytest.mark.parametrize("fit", [page_of_formulas, longer_formulas])
def test_mirrored_formulas_act_alike_on_both_sides(gait, fit, generator):
    data = samples_of_a_sparse_law(generator, MIRRORS[gait])
    policy = fit(data)
    assert len(policy.to_file().written()) == 12
    reflect = reflect_observation(NAMES, MIRRORS[gait])
    mirrored = policy(reflect(data.observations))
    np.testing.assert_allclose(mirrored, REFLECT_JOINTS(policy(data.observations)), atol=1e-12)


def test_all_formulas_are_written_where_a_side_is_favoured(generator):
    assert len(longer_formulas(samples_of_a_sparse_law(generator)).to_file().written()) == 24


def test_a_page_is_distilled_like_any_student(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    small = ["--episodes", "5", "--alone-rounds", "1", "--alone-steps", "20"]
    small += ["--episode-steps", "20", "--sparse-formula.alone-episodes", "2"]
    small += ["--sparse-formula.terms", "60"]
    main(["distill", "--students", "sparse_formula", "--n-workers", "1", *small])
    path = tmp_path / "runs" / "distill" / "trot" / "sparse_formula.formulas"
    page = load_policy(path)
    assert isinstance(page, FormulaPolicy)
    page.check(gait="trot", observation_names=load_expert("trot").observation_names)
    assert page.n_terms() <= 60
    capsys.readouterr()
    main(["explain", "formulas", "--gait", "trot", "--policy", "sparse_formula"])
    message = capsys.readouterr().out
    assert "format: 2\ngait: trot\nstates: 2\nsenses: imu\nmirror: [1, 0]    # " in message


def test_numbers_of_terms_that_no_page_has_are_refused(generator):
    samples = samples_of_a_sparse_law(generator, MIRRORS["trot"])
    for n_terms, mirrored in ((23, False), (11, True), (493, True)):
        with pytest.raises(InputError, match=f"terms is {n_terms};"):
            condense(samples, [n_terms], mirrored=mirrored)


@pytest.mark.parametrize(("gait", "n_terms"), [("trot", 493), ("walk", 23)])
def test_they_are_refused_before_samples_are_collected(gait, n_terms, tmp_path, refused):
    asked = [
        "--gait",
        gait,
        "--sparse-formula.terms",
        str(n_terms),
        "--output",
        str(tmp_path / "a"),
    ]
    message = refused(["distill", "--students", "sparse_formula", *asked])
    assert f"terms is {n_terms};" in message and gait in message
    assert not (tmp_path / "a").exists()


def test_every_size_is_a_stage_of_one_growth(generator):
    samples = samples_of_a_sparse_law(generator, MIRRORS["trot"])
    pages = condense(samples, [12, 20, 40], mirrored=True)
    assert {size: page.n_terms() for size, page in pages.items()} == {12: 12, 20: 20, 40: 40}
    alone = condense(samples, [20], mirrored=True)[20]
    assert alone.to_text() == pages[20].to_text()

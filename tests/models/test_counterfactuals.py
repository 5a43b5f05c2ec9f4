"""Counterfactuals: known answers, answers that the policy confirms, and none that is nearer."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from glassgait.models.counterfactuals import smooth
from glassgait.models.counterfactuals.question import TOLERANCE, Question, Room, answer, search_of
from glassgait.models.counterfactuals.smooth import FormulaTarget, SmoothSearch, shortest_steps
from glassgait.models.counterfactuals.trees import Forest
from glassgait.models.errors import InputError
from glassgait.models.formulas.interval import Interval, bounds_of
from glassgait.models.formulas.reader import read_formulas
from glassgait.models.formulas.tape import Tape
from glassgait.models.formulas.text import parse_expression, variable_names
from glassgait.models.policies.boosting import BoostedTreesPolicy
from glassgait.models.policies.library import load_expert, load_student
from glassgait.models.policies.linear import LinearPolicy
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.models.robots import quadruped
from glassgait.models.robots.library import load_robot
from glassgait.models.task.gait import load_gait
from glassgait.models.task.observation import entries_of, indices_of, machine_state_entries

A1 = load_robot()


NAMES = load_expert("trot").observation_names
PAGES = ("formulas", "statewise formulas")
KINDS = (*PAGES, "statewise_linear", "ebm", "gbm")
SHIPPED_PAGES = (
    "sparse_formula",
    pytest.param("statewise_symbolic", marks=pytest.mark.slow),
)
"""Pages that ship are so long that no answer is proved to be the nearest."""
CALF = quadruped.joint_index("FR_calf")

CALF_FORMULAS = (
    "-2.11 + 0.683*a.FL_hip + 1.02*a.FR_hip + 0.131*v.x - 0.557*v.z + 0.205*w.y"
    " + late*(-0.0105*dq.FL_calf - 0.335*v.y + 0.509*v.z - 2.64*h.RR) - 0.413*lifted.FL*x.FR"
    " + lifted.FR*(-0.0097*dq.FR_calf - 0.00775*dq.RR_thigh) - 1.96*lifted.RR*h.RL",
    "-1.62 + 0.014*dq.FR_thigh + 0.333*a.RR_thigh + 0.273*v.y - 0.512*v.z + 0.141*g.x"
    " + lifted.FR*(0.0478*cmd.yaw - 0.117*a.FR_thigh) - 0.413*lifted.FL*x.FR",
)
"""The front right calf's in either state, small enough for searches to end."""

DEFINED = """late = tanh(0.5*t - 2)
lifted.FL = tanh(100*h.FL - 2)
lifted.FR = tanh(100*h.FR - 2)
lifted.RR = tanh(100*h.RR - 2)
x.FR = -0.2*sin(q.FR_thigh) - 0.2*sin(q.FR_thigh + q.FR_calf)
"""


@pytest.fixture(scope="module")
def observations():
    """Observations of a make-believe trot: noise around the stance, feet up by turns."""
    generator = np.random.default_rng(17)
    drawn = 0.3 * generator.normal(size=(200, len(NAMES)))
    drawn[:, machine_state_entries(NAMES)] = np.eye(2)[np.arange(200) // 8 % 2]
    for group, values in (
        ("iterations", 0.1 * (np.arange(200) % 8)),
        ("commanded iterations", np.full(200, 0.8)),
    ):
        drawn[:, indices_of(group, NAMES)] = values[:, None]
    drawn[:, indices_of("commanded velocity", NAMES)] = [0.5, 0.0]
    feet = list(indices_of("foot height", NAMES))
    drawn[:, feet] = 0.04 * generator.random(size=(200, 4))
    return drawn


def ask(policy, observations, by=0.1, joint=CALF, step=60):
    return Question(policy, joint, observations[step], by, Room.of(NAMES, observations))


@cache
def policy_of(kind):
    """A student that ships, or a page of the formulas above."""
    if kind not in PAGES:
        return load_student("trot", kind)
    others = "".join(f"{joint} = 0\n" for joint in quadruped.JOINTS if joint != "FR_calf")
    parts = [f"FR_calf = {formula}\n{others}" for formula in CALF_FORMULAS]
    whole = (
        f"every state\n{parts[0]}"
        if kind == "formulas"
        else f"state 0\n{parts[0]}\nstate 1\n{parts[1]}"
    )
    text = f"format: 1\ngait: trot\nstates: 2\nsenses: imu\n\ndefinitions\n{DEFINED}\n{whole}"
    return FormulaPolicy.from_file(read_formulas(text))


def linear(weights):
    own = np.zeros((12, len(NAMES)))
    for name, weight in weights.items():
        own[CALF, NAMES.index(name)] = weight
    return LinearPolicy("trot", NAMES, own, np.zeros(12))


def test_a_linear_answer_is_the_projection(observations):
    weights = {"Prev Action FL Hip": 0.8, "Base Lin Vel Z": -0.6, "DoF Vel RR Calf": 0.1}
    question = ask(linear(weights), observations, by=0.02)
    found = answer(question).nearest
    slopes = np.zeros(len(NAMES))
    for name, weight in weights.items():
        index = NAMES.index(name)
        slopes[index] = 0.25 * weight * question.room.spread[index]
    expected = 0.02 * slopes / (slopes @ slopes) * question.room.spread
    change = found.observation - question.observation
    np.testing.assert_allclose(change, expected, atol=1e-6)
    assert found.distance == pytest.approx(0.02 / np.linalg.norm(slopes), rel=1e-6)
    assert found.proved and found.gap < 1e-6


def test_limits_cut_a_projection():
    steps, bound = shortest_steps(
        np.array([[3.0, 4.0]]), np.array([4.0]), np.zeros((1, 2)), np.array([[2.0, 0.5]])
    )
    # What the second may not do is left to the first: 3 · 2/3 + 4 · 1/2 = 4.
    np.testing.assert_allclose(steps, [[2 / 3, 0.5]], rtol=1e-9)
    assert bound[0] == pytest.approx(4 / 9 + 1 / 4)
    _, bound = shortest_steps(
        np.array([[3.0, 4.0]]), np.array([9.0]), np.zeros((1, 2)), np.array([[2.0, 0.5]])
    )
    assert bound[0] == np.inf


def test_the_fewest_changes_are_one_where_one_is_enough(observations):
    weights = {"Prev Action FL Hip": 0.8, "Base Lin Vel Z": -0.6}
    question = ask(linear(weights), observations, by=0.01)
    answers = answer(question)
    assert len(answers.nearest.changed) == 2
    assert answers.fewest is not None
    (index,) = answers.fewest.changed
    assert NAMES[index] == "Prev Action FL Hip"
    assert answers.fewest.distance > answers.nearest.distance


@pytest.mark.parametrize("by", [0.1, -0.1])
@pytest.mark.parametrize("kind", KINDS)
def test_the_policy_confirms_and_nothing_held_moves(kind, by, observations):
    policy = policy_of(kind)
    question = ask(policy, observations, by)
    answers = answer(question)
    for found in filter(None, (answers.nearest, answers.fewest)):
        target = A1.joint_targets(policy(found.observation))[CALF]
        before = A1.joint_targets(policy(question.observation))[CALF]
        assert np.sign(by) * (target - before) >= abs(by) - 1e-12
        assert target - before == pytest.approx(found.change_of_target)
        room = question.room
        assert (found.observation >= room.lower - 1e-12).all()
        assert (found.observation <= room.upper + 1e-12).all()
        held = [i for i, entry in enumerate(entries_of(NAMES)) if room.spread[i] == 0]
        assert set(held) >= {*indices_of("iterations", NAMES), *indices_of("machine state", NAMES)}
        assert not set(held) & set(found.changed)
    assert answers.nearest.proved
    assert 0 <= answers.nearest.gap <= TOLERANCE
    if answers.fewest is not None:
        assert len(answers.fewest.changed) <= 2
        assert answers.fewest.distance >= answers.nearest.bound


@pytest.fixture
def hasty(monkeypatch):
    """Lets searches give up early."""
    monkeypatch.setattr(smooth, "_MOST_BATCHES", 20)


@pytest.mark.parametrize("kind", SHIPPED_PAGES)
def test_a_search_that_gives_up_says_so(kind, observations, hasty):
    question = ask(policy_of(kind), observations)
    answers = answer(question)
    for found in filter(None, (answers.nearest, answers.fewest)):
        assert question.change_of_target(found.observation) >= question.by
        assert 0.0 < found.bound <= found.distance * (1 + 1e-9)
    assert answers.nearest.gap > TOLERANCE
    assert not answers.nearest.proved


def assert_no_random_observation_is_nearer(kind, observations):
    """Returns the distance of the answer, and of the random observations that are one as well."""
    question = ask(policy_of(kind), observations)
    found = answer(question).nearest
    room, generator = question.room, np.random.default_rng(23)
    free = room.free
    # Half go anywhere, half go the way of the answer, as far or less.
    moves = generator.normal(size=(10_000, len(free)))
    way = (found.observation - question.observation)[free] / room.spread[free]
    moves[5_000:] = way * (1.0 + 0.3 * moves[5_000:])
    lengths = found.distance * generator.random(10_000) ** 0.1
    moves *= (lengths / np.linalg.norm(moves, axis=1))[:, None]
    tried = np.tile(question.observation, (10_000, 1))
    tried[:, free] = np.clip(
        tried[:, free] + moves * room.spread[free], room.lower[free], room.upper[free]
    )
    # The trees of one joint alone are faster than those of all twelve.
    trees = isinstance(question.policy, BoostedTreesPolicy)
    change = Forest(question).rise if trees else question.change_of_target
    enough = change(tried) >= question.by
    distances = np.linalg.norm((tried - question.observation)[:, free] / room.spread[free], axis=1)
    assert (distances[enough] >= found.bound - 1e-9).all()
    return found.distance, distances[enough]


@pytest.mark.parametrize("kind", KINDS)
def test_no_random_observation_is_nearer(kind, observations):
    distance, others = assert_no_random_observation_is_nearer(kind, observations)
    assert (others * (1 + TOLERANCE) >= distance - 1e-9).all()


@pytest.mark.parametrize("kind", SHIPPED_PAGES)
def test_none_is_nearer_than_the_bound_of_a_search_that_gives_up(kind, observations, hasty):
    assert_no_random_observation_is_nearer(kind, observations)


@pytest.mark.parametrize("kind", ["formulas", "ebm", "gbm"])
def test_the_same_question_has_the_same_answer(kind, observations):
    question = ask(policy_of(kind), observations)
    first, second = (answer(question).nearest for _ in range(2))
    np.testing.assert_array_equal(first.observation, second.observation)
    assert first.bound == second.bound


@pytest.mark.parametrize("kind", KINDS)
def test_what_cannot_be_reached_is_reported_with_the_most(kind, observations):
    question = ask(policy_of(kind), observations, by=30.0)
    with pytest.raises(InputError, match="most") as refusal:
        answer(question)
    most = float(str(refusal.value).split("found is ")[1].split(" rad")[0])
    assert most == pytest.approx(search_of(question).reach(), abs=6e-4)
    assert 0.05 < most < 30.0
    within = replace(question, by=0.5 * most)
    assert answer(within).nearest.change_of_target >= within.by


def test_commands_vary_when_they_are_let(observations):
    policy = linear({"Command X": 1.0})
    with pytest.raises(InputError, match=r"0\.000 rad"):
        answer(ask(policy, observations))
    room = Room.of(NAMES, observations, load_gait("trot"))
    found = answer(Question(policy, CALF, observations[60], 0.1, room)).nearest
    assert [NAMES[index] for index in found.changed] == ["Command X"]
    assert found.observation[0] == pytest.approx(0.9)


def test_networks_are_refused(observations):
    with pytest.raises(InputError, match="neural"):
        answer(ask(load_expert("trot"), observations))


@pytest.mark.parametrize("kind", [*PAGES, *SHIPPED_PAGES])
def test_slopes_of_formulas_are_bounded(kind, observations, generator):
    # Searches stay within the ranges of readings; beyond them nothing moves a target.
    question = ask(policy_of(kind).with_readings(None), observations)
    target = FormulaTarget(question)
    count = len(target.curved)
    low = -generator.random((1, count))
    high = generator.random((1, count))
    least, greatest = target.slopes(low, high)
    inside = low + (high - low) * generator.random((50, count))
    slopes = target.gradient(inside)
    for ends in ((least, greatest), target.slopes(inside, inside)):
        assert (slopes >= ends[0]).all() and (slopes <= ends[1]).all()
    # Where the curved ones have moved, the others are affine: a slope times a move is the change.
    for place in np.setdiff1d(np.arange(target.size), target.curved)[:12]:
        moved = question.observation.copy()
        moved[question.room.free[target.curved]] += (
            inside[0] * question.room.spread[question.room.free[target.curved]]
        )
        before = question.change_of_target(moved)
        assert before == pytest.approx(target.rise(inside[:1])[0], abs=1e-9)
        index = question.room.free[place]
        moved[index] += 0.7 * question.room.spread[index]
        change = question.change_of_target(moved) - before
        assert change == pytest.approx(0.7 * slopes[0, place], abs=1e-9)


@pytest.mark.parametrize(
    "text",
    [
        "sin(x0) + cos(x1 * 3)",
        "x0 * x1 - x0 / (2 + x1 * x1)",
        "tanh(x0) * exp(x1)",
        "x0^2 - x1^3",
        "abs(x0) - sqrt(x1 + 3)",
        "log(x1 + 3) * x0 - x0 * x0",
    ],
)
def test_bounds_of_formulas_hold(text, generator):
    formula = parse_expression(text, variable_names(2))
    for _ in range(20):
        low = generator.uniform(-2, 2, size=2)
        high = np.minimum(low + 3 * generator.random(2), 2.0)
        inside = generator.uniform(low, high, size=(500, 2))
        values = Tape([formula], 2)(inside)[:, 0]
        whole = bounds_of(formula, {i: Interval(low[[i]], high[[i]]) for i in range(2)})
        assert (values >= whole.lower).all() and (values <= whole.upper).all()
        points = bounds_of(formula, {i: Interval(inside[:, i], inside[:, i]) for i in range(2)})
        assert (points.lower <= values).all() and (values <= points.upper).all()
        np.testing.assert_allclose(points.lower, values, rtol=1e-9, atol=1e-9)


def test_sets_of_observations_are_searched_together(observations):
    question = ask(policy_of("formulas"), observations)
    target = FormulaTarget(question)
    search = SmoothSearch(question, target)
    singles = [search.nearest(np.eye(target.size, dtype=bool)[[k]]) for k in range(target.size)]
    distances = [own.distance for own in singles if own is not None]
    fewest = search.fewest()
    if distances:
        assert fewest is not None and len(fewest.changed) == 1
        assert fewest.distance <= min(distances) * (1 + TOLERANCE)
    else:
        assert fewest is None or len(fewest.changed) == 2

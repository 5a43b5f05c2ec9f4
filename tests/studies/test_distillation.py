"""Distillation: Algorithm 1, its splits, its students, and what goes wrong."""

import ast
import importlib.util
import shutil
import sys
from copy import copy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from sklearn.linear_model import LinearRegression
from sklearn.metrics import r2_score

from glassgait.diagrams.scenario import Scenario
from glassgait.models.errors import InputError
from glassgait.models.policies.expression import Expression
from glassgait.models.policies.expression_text import parse_expression, variable_names
from glassgait.models.policies.gates import named_gates
from glassgait.models.policies.library import load_expert, load_policy
from glassgait.models.policies.neural import NeuralPolicy
from glassgait.models.policies.tape import Tape
from glassgait.models.task.gait import load_gait
from glassgait.models.task.observation import ObservationLayout
from glassgait.studies.distillation.collection import collect
from glassgait.studies.distillation.config import DistillationConfig
from glassgait.studies.distillation.rounds import Round, rounds
from glassgait.studies.distillation.selection import simplest_of_the_best
from glassgait.studies.distillation.study import distill
from glassgait.studies.distillation.tables import write_r2_table
from glassgait.studies.students.additive import EbmSettings
from glassgait.studies.students.boosting import GbmSettings, HistogramGbmSettings
from glassgait.studies.students.dataset import Dataset, load_rounds, r2_scores
from glassgait.studies.students.formula_pages import latex_formula, readable_formula
from glassgait.studies.students.gated_sum import fit_gated_sums
from glassgait.studies.students.library import load_students
from glassgait.studies.students.linear import untrained_student
from glassgait.studies.students.registry import STUDENTS
from glassgait.studies.students.settings import StudentsSettings
from glassgait.studies.students.student import TrainingSet
from glassgait.studies.students.symbolic_regression import fit_formulas, pysr_arguments
from glassgait.studies.students.symbolic_settings import StatewiseSymbolicSettings, SymbolicSettings

GAIT = load_gait("trot")

SMALL_FORMULAS = {
    "population": 20,
    "generations": 2,
    "max_samples": 100,
    "start_weights": (1, 3),
    "alone_episodes": 4,
}

TINY = DistillationConfig(
    episodes=5,
    alone_rounds=1,
    episode_steps=60,
    alone_episodes=4,
    alone_steps=60,
    settings=StudentsSettings(
        gbm=GbmSettings(n_trees=5),
        histogram_gbm=HistogramGbmSettings(n_trees=5),
        ebm=EbmSettings(outer_bags=2, interactions=2, round_interactions=1, max_rounds=10),
        symbolic=SymbolicSettings(shapes=((30, 30), (30, 60)), **SMALL_FORMULAS),
        statewise_symbolic=StatewiseSymbolicSettings(shapes=((30, 30),), **SMALL_FORMULAS),
    ),
    n_jobs=1,
)


def fit(kind, names, data, settings=None):
    """Fits a student of the trot, in this process."""
    samples = TrainingSet("trot", names, data.observations, data.actions, data.starts)
    student = STUDENTS[kind]
    return student.fit(samples, settings or student.settings, seed=0, n_jobs=1)


@pytest.fixture(scope="module")
def expert():
    return load_expert("trot")


@pytest.fixture(scope="module")
def finished(expert, tmp_path_factory):
    folder = tmp_path_factory.mktemp("distillation")
    r2 = distill(TINY, GAIT, expert, folder, lambda line: None)
    write_r2_table(r2, "trot", folder)
    return folder, r2


def test_every_student_is_made_scored_and_saved(finished, expert):
    folder, r2 = finished
    students = load_students(folder, expert)
    assert list(students) == list(TINY.students) == r2["student"].tolist()
    for name in ("metrics.json", "r2.csv", "r2.md", "config.yaml"):
        assert (folder / name).exists()


def test_the_same_seed_gives_the_same_metrics(finished, expert, tmp_path):
    folder, _ = finished
    write_r2_table(distill(TINY, GAIT, expert, tmp_path, lambda line: None), "trot", tmp_path)
    assert (tmp_path / "metrics.json").read_text() == (folder / "metrics.json").read_text()


def test_a_run_cut_short_and_resumed_ends_the_same(finished, expert, tmp_path):
    folder, _ = finished
    shutil.copytree(folder, tmp_path, dirs_exist_ok=True)
    (tmp_path / "metrics.json").unlink()
    for path in ("gbm/record.json", "gbm.safetensors", "histogram_gbm/round_02.safetensors"):
        (tmp_path / path).unlink()
    shutil.rmtree(tmp_path / "symbolic")
    write_r2_table(
        distill(TINY, GAIT, expert, tmp_path, lambda line: None, resume=True), "trot", tmp_path
    )
    assert (tmp_path / "metrics.json").read_text() == (folder / "metrics.json").read_text()


def test_a_damaged_student_beside_a_good_record_is_told(finished, expert, tmp_path):
    folder, _ = finished
    shutil.copytree(folder, tmp_path, dirs_exist_ok=True)
    path = tmp_path / "linear.safetensors"
    path.write_bytes(path.read_bytes()[:-9] + b"nonsense!")
    with pytest.raises(InputError, match=r"linear\.safetensors: is not what the run wrote; delete"):
        distill(TINY, GAIT, expert, tmp_path, lambda line: None, resume=True)
    (tmp_path / "linear" / "record.json").unlink()
    distill(TINY, GAIT, expert, tmp_path, lambda line: None, resume=True)
    assert path.read_bytes() == (folder / "linear.safetensors").read_bytes()


def test_another_expert_is_not_mixed_in(finished, expert):
    folder, _ = finished
    actor = replace(expert.actor, biases=(*expert.actor.biases[:-1], np.ones(12)))
    other = NeuralPolicy("trot", expert.observation_names, actor, expert.estimator)
    with pytest.raises(InputError, match="was made with another expert"):
        distill(TINY, GAIT, other, folder, lambda line: None, resume=True)


def test_files_of_another_run_or_round_are_not_mixed_in(finished, expert, tmp_path):
    folder, _ = finished
    config = replace(TINY, students=("linear",))
    other = tmp_path / "other"
    distill(replace(config, seed=1), GAIT, expert, other, lambda line: None)

    def resumed(source, target):
        run = tmp_path / f"{source.parent.parent.name}_{target}".replace("/", "_")
        shutil.copytree(folder, run)
        (run / "linear" / "record.json").unlink()
        shutil.copy(source, run / target)
        distill(config, GAIT, expert, run, lambda line: None, resume=True)

    for source, target in (
        (other / "linear" / "record.json", "linear/record.json"),
        (folder / "ebm" / "record.json", "linear/record.json"),
        (other / "linear" / "round_01.safetensors", "linear/round_01.safetensors"),
        (folder / "linear" / "round_01.safetensors", "linear/round_02.safetensors"),
    ):
        with pytest.raises(InputError, match="is of another run, or of another part"):
            resumed(source, target)


@pytest.mark.parametrize("name", ["linear/record.json", "linear/round_01.safetensors"])
def test_damaged_work_is_told(name, finished, expert, tmp_path):
    folder, _ = finished
    shutil.copytree(folder, tmp_path, dirs_exist_ok=True)
    if "round" in name:
        (tmp_path / "linear" / "record.json").unlink()
    data = bytearray((tmp_path / name).read_bytes())
    data[len(data) // 2] ^= 1
    (tmp_path / name).write_bytes(data)
    with pytest.raises(InputError, match="is damaged"):
        distill(TINY, GAIT, expert, tmp_path, lambda line: None, resume=True)


def test_formulas_are_written_for_people(finished):
    folder, _ = finished
    page = (folder / "statewise_symbolic_formulas.md").read_text()
    assert page.count("\nFL_hip = ") == 2
    assert max(len(line) for line in page.split("## Observations")[0].splitlines()) < 150
    assert "| DoF Vel FL Hip | $\\dot q_{\\mathrm{FL Hip}}$ | 0.05 · rad/s |" in page
    latex = (folder / "symbolic_formulas.tex").read_text()
    assert latex.count(r"\begin{align*}") == latex.count(r"\end{align*}") == 12
    assert r"a_{\mathrm{RR\,calf}} ={}&" in latex


def test_latex_takes_the_papers_symbols():
    names = load_expert("trot").observation_names
    index = {name: f"x{i}" for i, name in enumerate(names)}
    text = f"2.5 * {index['DoF Pos FL Hip']} - {index['RM Iters']} * {index['Command X']}"
    formula = parse_expression(text, variable_names(len(names)))
    expected = r"2.5 \cdot q_{\mathrm{FL Hip}} - v_x^{*} \cdot n"
    assert latex_formula(formula, names) == expected


def test_a_finished_folder_is_not_overwritten(finished, expert):
    folder, _ = finished
    with pytest.raises(InputError, match="continue it with --resume"):
        distill(TINY, GAIT, expert, folder, lambda line: None)
    with pytest.raises(InputError, match="made with seed = 0, not 1"):
        distill(replace(TINY, seed=1), GAIT, expert, folder, lambda line: None, resume=True)


def test_rounds_follow_the_paper(finished):
    folder, _ = finished
    first, second = (Dataset.load(folder / "linear" / f"round_{n:02d}.safetensors") for n in (1, 2))
    assert sorted(set(first.episodes)) == [1, 2, 3, 4]
    assert set(second.episodes) == {5}
    speeds = [first.observations[first.episodes == episode, 0] for episode in (1, 2, 3, 4)]
    for speed, values in zip((0.0, 0.25, 0.5, 0.75), speeds, strict=True):
        assert set(values) == {speed}


def test_whole_episodes_are_held_out():
    episodes = np.repeat(np.arange(1, 31), 3)
    dataset = Dataset(np.zeros((90, 2)), np.zeros((90, 12)), episodes)
    held_out = set(episodes[dataset.held_out])
    assert len(held_out) == 6
    assert not held_out & set(episodes[~dataset.held_out])
    assert {(episode - 1) % 4 for episode in held_out} == {0, 1, 2, 3}


@pytest.mark.parametrize(
    ("curriculum", "periods"),
    [
        ("alternation", [1, 2, 3, 4]),
        ("student_only", [1, 0, 0, 0]),
        ("expert_only", [1, 1, 1, 1]),
        ("half", [1, 2, 2, 2]),
    ],
)
def test_curricula_say_how_often_the_expert_acts(curriculum, periods):
    config = DistillationConfig(curriculum=curriculum)
    planned = rounds(config.for_gait(GAIT), "linear")
    assert [own.period for own in planned[:4]] == periods
    assert len(planned) == 16
    assert [own.period for own in planned[8:]] == [0] * 8


def test_rounds_hold_every_episode_once():
    config = DistillationConfig(
        episodes=10, episodes_per_round=4, alone_rounds=2, alone_episodes=4, alone_steps=90
    )
    planned = rounds(config, "linear")
    assert [own.number for own in planned] == [1, 2, 3, 4, 5]
    assert [own.steps for own in planned] == [1000, 1000, 1000, 90, 90]
    assert {own.steps for own in rounds(config, "symbolic")} == {1000}
    assert [list(own.episodes) for own in planned] == [
        [1, 2, 3, 4],
        [5, 6, 7, 8],
        [9, 10],
        [11, 12, 13, 14],
        [15, 16, 17, 18],
    ]
    settings = StudentsSettings(symbolic=SymbolicSettings(alone_episodes=6))
    planned = rounds(replace(config, settings=settings), "symbolic")
    alone = [list(own.episodes) for own in planned[2:]]
    assert alone == [[9, 10], [11, 12, 13, 14, 15, 16], [17, 18, 19, 20, 21, 22]]


def test_machines_of_more_states_ask_for_more_episodes_alone():
    def alone(gait, config):
        machine = load_gait(gait)
        return len(rounds(config.for_gait(machine), "ebm")[-1].episodes)

    sizes = {gait: alone(gait, DistillationConfig()) for gait in ("trot", "walk", "half_bound")}
    assert sizes == {"trot": 16, "walk": 48, "half_bound": 48}
    assert alone("walk", DistillationConfig(alone_episodes=5)) == 5


def test_starts_are_the_first_steps_of_every_episode():
    episodes = np.repeat([3, 4, 6], [7, 3, 9])
    starts = Dataset(np.zeros((19, 2)), np.zeros((19, 12)), episodes).starts
    assert np.flatnonzero(starts).tolist() == [0, 1, 2, 3, 4, 7, 8, 9, 10, 11, 12, 13, 14]


def test_starts_that_count_more_are_imitated_better(expert, tmp_path):
    scores = []
    for weight in (1, 50):
        symbolic = SymbolicSettings(
            **SMALL_FORMULAS | {"shapes": ((30, 30),), "start_weights": (weight,)}
        )
        config = replace(
            TINY,
            students=("symbolic",),
            # The expert acts alone, so that the samples are the same.
            curriculum="expert_only",
            alone_rounds=0,
            settings=StudentsSettings(symbolic=symbolic),
        )
        folder = tmp_path / str(weight)
        distill(config, GAIT, expert, folder, lambda line: None)
        data = load_rounds(folder / "symbolic")
        starts = data.subset(data.starts & ~data.held_out)
        scores.append(r2_scores(load_policy(folder / "symbolic.safetensors"), starts).mean())
    assert scores[1] > scores[0]


def test_bands_come_with_the_last_fit_alone(finished):
    folder, _ = finished
    policy = load_policy(folder / "ebm.safetensors")
    assert policy.deviations.max() > 0
    assert len(policy.pairs) == 2 * 12
    ebm = TINY.settings.of("ebm")
    assert ebm.for_rounds().outer_bags == ebm.for_shuffled_split().outer_bags == 1
    assert ebm.for_rounds().interactions == 1
    for config in (TINY, DistillationConfig()):
        trees = config.settings.of("histogram_gbm")
        assert trees.for_rounds().n_trees == min(trees.n_trees, 150)


def test_the_simplest_good_one_is_taken_and_the_others_are_told(finished):
    folder, _ = finished
    ranked = pd.read_csv(folder / "symbolic_candidates.csv")
    shapes = ["sum of 30, 30 in all", "sum of 30, 60 in all"]
    complexity = {title: shape for shape in shapes for title in (shape, f"{shape}, starts count 3")}
    assert set(ranked["candidate"]) == set(complexity)
    assert ranked["reward"].is_monotonic_decreasing
    policy = load_policy(folder / "symbolic.safetensors")
    longest = max(formula.length for formula in policy.expressions)
    chosen = simplest_of_the_best(ranked, complexity)
    assert (longest <= 30) == (complexity[chosen] == shapes[0])


@pytest.mark.parametrize(
    ("small", "large", "chosen"),
    [
        ((995.0, 0), (1000.0, 0), "small"),
        ((985.0, 0), (1000.0, 0), "large"),
        ((999.0, 1), (1000.0, 0), "large"),
        ((1001.0, 0), (1000.0, 0), "small"),
        # Falls count before reward, unless a student falls less because it hardly walks.
        ((1000.0, 2), (975.0, 0), "large"),
        ((1000.0, 2), (100.0, 0), "small"),
        ((-1000.0, 2), (-1001.0, 3), "small"),
    ],
)
def test_falls_count_before_simplicity_and_reward(small, large, chosen):
    rows = [("small", *small), ("large", *large)]
    ranked = pd.DataFrame(rows, columns=["candidate", "reward", "falls"])
    ranked = ranked.sort_values("reward", ascending=False)
    assert simplest_of_the_best(ranked, {"small": 1, "large": 2}) == chosen


def test_of_equally_simple_students_the_one_that_earns_most_is_taken():
    rows = [("first", 1000.0, 0), ("second", 999.0, 0)]
    ranked = pd.DataFrame(rows, columns=["candidate", "reward", "falls"])
    assert simplest_of_the_best(ranked, {"first": 1, "second": 1}) == "first"


def test_formulas_read_as_people_write_them():
    names = load_expert("trot").observation_names
    at = {name: f"x{i}" for i, name in enumerate(names)}
    x, q, state = at["Command X"], at["DoF Pos FL Hip"], at["RM State 0"]
    text = f"0.5 - 2.0 * {x} + 1.5 * {q} + {state} * (0.25 * {x} - 3.0 * square({q}))"
    formula = parse_expression(text, variable_names(len(names)))
    assert readable_formula(formula, names) == (
        "−2.0 · Command X + 1.5 · DoF Pos FL Hip + RM State 0 · "
        "(−3.0 · (DoF Pos FL Hip)^2 + 0.25 · Command X) + 0.5"
    )
    assert latex_formula(formula, names) == (
        r"-2.0 \cdot v_x^{*} + 1.5 \cdot q_{\mathrm{FL Hip}} "
        r"+ s_{0} \cdot \bigl(-3.0 \cdot q_{\mathrm{FL Hip}}^{2} + 0.25 \cdot v_x^{*}\bigr) \\"
        "\n  &+ 0.5"
    )


def test_formulas_name_their_gates_and_put_in_the_state_they_serve():
    names = load_expert("trot").observation_names
    at = {name: f"x{i}" for i, name in enumerate(names)}
    text = (
        f"(tanh((5.0 * {at['RM Iters']} + -2.0)) * (0.5 * {at['RM State 1']} + 2.0 * "
        f"{at['Command X']})) + (tanh((100.0 * {at['Foot Height RL']} + -2.0)) * "
        f"(3.0 * {at['RM State 0']}))"
    )
    formula = parse_expression(text, variable_names(len(names)))
    assert readable_formula(formula, names) == (
        "3.0 · Lifted RL · RM State 0 + Late · (2.0 · Command X + 0.5 · RM State 1)"
    )
    assert readable_formula(formula, names, state=0) == "3.0 · Lifted RL + 2.0 · Command X · Late"
    assert readable_formula(formula, names, state=1) == "Late · (2.0 · Command X + 0.5)"
    assert latex_formula(formula, names, state=0) == (
        r"3.0 \cdot u_{\mathrm{RL}} + 2.0 \cdot v_x^{*} \cdot \ell"
    )


def test_open_loop_is_the_mean_of_each_moment(generator):
    names = load_expert("trot").observation_names
    observations = np.zeros((300, len(names)))
    state, iteration = generator.integers(2, size=300), generator.integers(4, size=300)
    observations[np.arange(300), names.index("RM State 0") + state] = 1.0
    observations[:, names.index("RM Iters")] = 0.1 * iteration
    actions = generator.normal(size=(300, 12))
    dataset = Dataset(observations, actions, np.ones(300, dtype=np.int64))
    policy = fit("open_loop", names, dataset)
    expected = actions[(state == 1) & (iteration == 2)].mean(axis=0)
    np.testing.assert_allclose(policy.table[1, 2], expected)
    np.testing.assert_array_equal(policy.table[1, 3], policy.table[1, 15])


def test_statewise_formulas_are_fitted_to_their_states(generator):
    names = load_expert("trot").observation_names
    observations = generator.normal(size=(400, len(names)))
    state = generator.integers(2, size=400)
    observations[:, names.index("RM State 0") : names.index("RM State 0") + 2] = np.eye(2)[state]
    sign = np.where(state == 0, 1.0, -1.0)[:, None]
    actions = sign * observations[:, 2:14] + np.roll(observations[:, 2:14], 1, axis=1)
    dataset = Dataset(observations, actions, np.ones(400, dtype=np.int64))
    settings = SymbolicSettings(population=20, generations=2, shapes=((10, 20),))
    policy = fit("statewise_symbolic", names, dataset, settings)
    assert r2_scores(policy, dataset).min() > 0.99


def test_labels_are_the_experts_whoever_acts(expert):
    gait = load_gait("trot")
    student = untrained_student("trot", expert.observation_names)
    samples = collect(
        gait,
        expert,
        student,
        plan=Round(number=2, period=3, episodes=range(1, 3), steps=20),
        speeds=np.array([0.0, 0.5]),
        scenario=Scenario(),
        generator=np.random.default_rng(0),
    )
    np.testing.assert_allclose(samples.actions, expert(samples.observations), atol=1e-12)
    previous = samples.observations[1:20, 26:38]
    acted = samples.actions[:19]
    by_expert = np.all(np.isclose(previous, acted), axis=1)
    assert by_expert.tolist() == [step % 3 == 0 for step in range(19)]


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize(
    ("network", "told"),
    [
        ("actor", "the action of FL_calf is not finite"),
        ("estimator", "Base Lin Vel Z is not finite"),
    ],
)
def test_samples_that_are_not_finite_are_refused(expert, network, told):
    last = getattr(expert, network).biases[-1].copy()
    last[2] = np.nan
    own = getattr(expert, network)
    broken = copy(expert)
    setattr(broken, network, replace(own, biases=(*own.biases[:-1], last)))
    with pytest.raises(InputError, match=f"{told} at control step 0 of its episode"):
        collect(
            load_gait("trot"),
            broken,
            untrained_student("trot", expert.observation_names),
            plan=Round(number=1, period=1, episodes=range(1, 3), steps=3),
            speeds=np.array([0.0, 0.5]),
            scenario=Scenario(),
            generator=np.random.default_rng(0),
        )


def test_r2_is_scikit_learns(generator):
    observations = generator.normal(size=(200, 49))
    actions = observations[:, :12] + 0.3 * generator.normal(size=(200, 12))
    dataset = Dataset(observations, actions, np.ones(200, dtype=np.int64))
    policy = fit("linear", load_expert("trot").observation_names, dataset)
    expected = r2_score(actions, policy(observations), multioutput="raw_values")
    np.testing.assert_allclose(r2_scores(policy, dataset), expected)


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


def test_lateness_is_bounded_and_tells_early_from_late(trot, generator):
    names = ObservationLayout(trot.n_states).names
    gate = named_gates(names)["Late"]
    iterations = np.zeros((4, len(names)))
    iterations[:, names.index("RM Iters")] = (0.0, 0.4, 0.8, 50.0)
    value = Tape([gate], len(names))(iterations)[:, 0]
    assert value == pytest.approx([-0.964, 0.0, 0.964, 1.0], abs=1e-3)

    x = generator.normal(size=(2000, len(names)))
    x[:, names.index("RM Iters")] = generator.uniform(0.0, 1.0, size=2000)
    y = (1.0 + 2.0 * Tape([gate], len(names))(x)[:, 0]) * x[:, 0]
    [formula] = fit_gated_sums(x, y[:, None], gates=(gate,), max_length=20)
    error = Tape([formula], len(names))(x)[:, 0] - y
    assert error.var() < 1e-4 * y.var()


def test_feet_are_on_the_ground_or_in_the_air(trot):
    names = ObservationLayout(trot.n_states).names
    heights = np.zeros((3, len(names)))
    heights[:, names.index("Foot Height RL")] = (0.0, 0.02, 0.08)
    _, *feet = named_gates(names).values()
    gates = Tape(feet, len(names))(heights)
    assert gates.shape == (3, 4)
    assert gates[:, 2] == pytest.approx([-0.964, 0.0, 1.0], abs=1e-3)
    assert gates[:, 0] == pytest.approx([-0.964] * 3, abs=1e-3)


def test_gated_sum_keeps_its_bound(generator):
    x, y = sample_of_a_gated_law(generator)
    sizes = [fit_gated_sums(x, y[:, None], GATES, bound)[0].length for bound in (1, 10, 20)]
    assert all(size <= bound for size, bound in zip(sizes, (1, 10, 20), strict=True))


def test_operon_finds_what_is_not_linear(generator):
    x = generator.normal(size=(1500, 5))
    x[:, 3] = 0.0
    y = 2.0 * x[:, 0] + np.tanh(3.0 * x[:, 1] * x[:, 2])
    settings = SymbolicSettings(
        population=200, generations=40, max_samples=1500, shapes=((10, 60),)
    )
    [formula] = fit_formulas(
        x, y[:, None], 0, settings, gates=(Expression("variable", variable=3),)
    )
    linear = LinearRegression().fit(x, y).score(x, y)
    error = Tape([formula], 5)(x)[:, 0] - y
    assert formula.length <= 60
    assert 1 - error.var() / y.var() > linear + 0.05


def test_pysr_is_asked_as_the_paper_did():
    pysr = importlib.util.find_spec("pysr")
    assert pysr is not None, "the test extra installs pysr"
    source = (Path(pysr.origin).parent / "sr.py").read_text()
    # Importing PySR would start Julia; its constructor is read from the installed text instead.
    regressor = next(
        node
        for node in ast.parse(source).body
        if isinstance(node, ast.ClassDef) and node.name == "PySRRegressor"
    )
    constructor = next(
        node
        for node in regressor.body
        if isinstance(node, ast.FunctionDef) and node.name == "__init__"
    )
    accepted = {argument.arg for argument in (*constructor.args.args, *constructor.args.kwonlyargs)}
    arguments = pysr_arguments(0, SymbolicSettings(engine="pysr"))
    assert set(arguments) <= accepted
    assert arguments["unary_operators"] == ["sin", "tanh", "square", "cube"]
    assert arguments["binary_operators"] == ["+", "-", "*"]
    assert arguments["maxsize"] == 90
    assert arguments["niterations"] == 20
    assert arguments["constraints"]["*"] == (4, 4)


def test_pysr_without_julia_is_refused_in_one_sentence(monkeypatch, generator):
    monkeypatch.setitem(sys.modules, "pysr", None)
    with pytest.raises(InputError, match="needs Julia") as raised:
        fit_formulas(
            generator.normal(size=(10, 3)),
            np.zeros((10, 1)),
            0,
            SymbolicSettings(engine="pysr"),
            (),
        )
    assert "\n" not in str(raised.value)


@pytest.mark.skipif(shutil.which("julia") is None, reason="Julia is not installed")
@pytest.mark.slow
def test_pysr_finds_a_law(generator):
    x = generator.normal(size=(200, 3))
    product = x[:, :1] * x[:, 1:2]
    [formula] = fit_formulas(x, product, 0, SymbolicSettings(engine="pysr"), ())
    np.testing.assert_allclose(Tape([formula], 3)(x)[:, 0], product[:, 0], atol=1e-3)


def test_formulas_are_readable(finished):
    folder, _ = finished
    policy = load_policy(folder / "symbolic.safetensors")
    text = readable_formula(policy.expressions[0], policy.observation_names)
    assert any(name in text for name in policy.observation_names)
    assert "x1" not in text


def test_folders_without_students_are_refused(expert, tmp_path):
    with pytest.raises(InputError, match="holds no students"):
        load_students(tmp_path, expert)


def test_compact_students_are_what_is_scored_and_saved(finished, expert, tmp_path):
    folder, whole = finished
    config = replace(TINY, students=("gbm", "ebm"), compact=True)
    r2 = distill(config, GAIT, expert, tmp_path, lambda line: None)
    expected = whole.set_index("student").loc[["gbm", "ebm"], "r2"]
    np.testing.assert_allclose(r2["r2"], expected, atol=1e-3)
    for kind in config.students:
        policy = load_policy(tmp_path / f"{kind}.safetensors")
        assert policy.digest() == policy.compact().digest()
        sizes = [(place / f"{kind}.safetensors").stat().st_size for place in (tmp_path, folder)]
        assert sizes[0] < sizes[1]

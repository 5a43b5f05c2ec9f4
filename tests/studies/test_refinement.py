"""Refinement: formulas as a network, its candidates, and the command."""

import re
from functools import cache, reduce
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import torch

from glassgait.diagrams.domain_randomization import DomainRandomization
from glassgait.diagrams.scenario import Scenario
from glassgait.models.formulas.expression import (
    ZERO,
    Expression,
    constant,
    plus,
    variable,
    without_zeros,
)
from glassgait.models.formulas.mirror import FormulaMirror
from glassgait.models.formulas.reader import read_formulas
from glassgait.models.policies.controller import alone
from glassgait.models.policies.library import load_expert, load_policy, load_student
from glassgait.models.policies.symbolic import FormulaPolicy, SymbolicPolicy
from glassgait.models.robots.library import load_robot
from glassgait.models.task.gait import load_gait
from glassgait.models.task.observation import REFLECT_JOINTS, reflect_observation
from glassgait.studies.cli import main
from glassgait.studies.common.policies import find_policies
from glassgait.studies.distillation import refinement as refinement_module
from glassgait.studies.distillation.collection import collect
from glassgait.studies.distillation.config import RefinementConfig
from glassgait.studies.distillation.formula_network import UNIT_EFFECT, FormulaNetwork
from glassgait.studies.distillation.formulas import short_numbers
from glassgait.studies.distillation.refinement import RefinementRun
from glassgait.studies.training.config import PpoConfig

A1 = load_robot()


PPO = PpoConfig(
    steps_per_update=8, critic_updates=2, critic_layers=(16,), epochs=2, initial_std=0.1
)
TINY = RefinementConfig(
    updates=4,
    candidate_updates=2,
    candidate_steps=10,
    n_robots=4,
    worlds=DomainRandomization(n_groups=2, fine_steps=()),
    ppo=PPO,
)
SMALL = ["--settings", str(Path(__file__).parent / "settings" / "refine.yaml")]
SMALL += ["--candidate-steps", "10", "--updates", "2"]
PAGE = load_student("trot", "formulas")


@cache
def seen(gait, policy):
    data = collect(
        load_gait(gait),
        alone(policy, load_expert(gait)),
        episodes=range(1, 7),
        n_steps=30,
        worlds=Scenario(),
        generator=np.random.default_rng(3),
    )
    return data.observations, torch.from_numpy(data.observations).float()


@pytest.fixture(scope="session")
def shorten():
    """Keeps the first five terms of each formula: as many kinds of terms, not hundreds."""

    def run(policy):
        file = policy.to_file()
        formulas = {
            place: reduce(plus, formula.terms()[:5]) for place, formula in file.written().items()
        }
        if file.mirror is not None:
            formulas = FormulaMirror.of(file.vocabulary, file.mirror).complete(formulas)
        return FormulaPolicy.from_file(file.with_formulas(formulas))

    return run


@pytest.fixture(scope="session")
def short_page(shorten):
    """The trot's page of formulas, shortened."""
    return shorten(load_student("trot", "formulas"))


@pytest.fixture
def refinement(short_page):
    def begin(folder, **resume):
        trot, expert = load_gait("trot"), load_expert("trot")
        return RefinementRun(TINY, trot, expert, short_page, folder, name="short", **resume)

    return begin


@pytest.fixture(autouse=True)
def seen_for_a_moment(monkeypatch):
    """Lets robots walk for few steps before a run, to see what each number does."""
    monkeypatch.setattr(refinement_module, "BALANCE_STEPS", 20)


@pytest.mark.parametrize(
    ("gait", "kind"),
    [
        ("trot", "formulas"),
        ("trot", "symbolic"),
        pytest.param("walk", "symbolic_per_state", marks=pytest.mark.slow),
    ],
)
def test_the_network_acts_as_the_formulas(gait, kind, shorten):
    policy = load_student(gait, kind)
    if kind == "symbolic_per_state":
        policy = shorten(policy)
    observations, tensor = seen(gait, policy)
    network = FormulaNetwork(policy)
    with torch.no_grad():
        np.testing.assert_allclose(network(tensor), policy(observations), atol=1e-4)
    assert short_numbers(network.to_policy()).to_text() == policy.to_text()


def test_mirror_images_stay_so_while_numbers_change():
    observations, tensor = seen("trot", PAGE)
    network = FormulaNetwork(PAGE)
    with torch.no_grad():
        network.changes += 0.01 * torch.randn(
            PAGE.n_terms(), generator=torch.Generator().manual_seed(1)
        )
    policy = network.to_policy()
    assert policy.digest() != PAGE.digest()
    reflect = reflect_observation(policy.observation_names, PAGE.mirror)
    image = REFLECT_JOINTS(policy(reflect(observations)))
    np.testing.assert_allclose(image, policy(observations), atol=1e-12)
    with torch.no_grad():
        np.testing.assert_allclose(network(tensor), policy(observations), atol=1e-4)


def test_a_step_of_any_direction_does_as_much():
    _, tensor = seen("trot", PAGE)
    network = FormulaNetwork(PAGE)
    network.balance(tensor)
    directions = torch.nn.functional.normalize(
        torch.randn((20, PAGE.n_terms()), generator=torch.Generator().manual_seed(2)), dim=1
    )
    effects = []
    with torch.no_grad():
        before = network(tensor)
        for direction in directions:
            network.changes.copy_(1e-2 * direction)
            moved = A1.action_scale * (network(tensor) - before)
            effects.append(100.0 * float(moved.square().sum(dim=1).mean().sqrt()))
    # In the units of the file they would differ by hundreds.
    assert max(effects) < 1.5 * min(effects)
    assert np.mean(effects) == pytest.approx(UNIT_EFFECT, rel=0.2)


def test_formulas_stay_those_of_their_robot():
    names, go2 = PAGE.observation_names, load_robot("go2")
    policy = SymbolicPolicy("trot", names, [[constant(0.1234)] * 12], robot=go2)
    assert short_numbers(FormulaNetwork(policy).to_policy()).robot is go2
    assert FormulaPolicy.from_file(read_formulas(policy.to_text())).robot is go2


def test_what_is_multiplied_by_zero_is_left_out():
    x, half = variable(0), constant(0.5)
    nothing = Expression("mul", (ZERO, x))
    something = Expression("mul", (half, x))
    cases = {
        ("add", nothing, something): something,
        ("add", something, nothing): something,
        ("sub", something, nothing): something,
        ("sub", nothing, something): Expression("neg", (something,)),
        ("mul", x, Expression("add", (nothing, nothing))): ZERO,
        ("div", nothing, x): ZERO,
    }
    for (operator, *operands), expected in cases.items():
        assert without_zeros(Expression(operator, tuple(operands))) == expected
    assert without_zeros(Expression("neg", (nothing,))) == ZERO
    assert without_zeros(Expression("tanh", (something,))) == Expression("tanh", (something,))


def test_the_critic_learns_first(refinement, tmp_path):
    run = refinement(tmp_path)
    start = run.policy().to_text()
    run.update()
    run.update()
    assert run.policy().to_text() == start
    run.update()
    assert run.policy().to_text() != start


def test_the_best_of_the_candidates_is_the_result(refinement, tmp_path, monkeypatch):
    asked = {}

    def rank(candidates, *_):
        asked.update(candidates)
        rewards = [3.0 if label == "update 2" else 1.0 for label in candidates]
        table = pd.DataFrame({"candidate": list(candidates), "return": rewards, "falls": 0})
        return table.sort_values("return", ascending=False, ignore_index=True)

    monkeypatch.setattr(refinement_module, "rank_candidates", rank)
    run = refinement(tmp_path)
    texts = {}
    while run.n_updates < run.config.updates:
        run.update()
        texts[run.n_updates] = run.policy().to_text()
    run.save()
    assert list(asked) == ["update 2", "update 4", "as they were"]
    assert texts[2] != texts[4]
    assert (tmp_path / "short.formulas").read_text() == texts[2]
    chosen = pd.read_csv(tmp_path / "candidates.csv").query("chosen")
    assert list(chosen["candidate"]) == ["update 2"]


def test_a_run_that_is_continued_ends_with_the_same_text(refinement, tmp_path):
    whole = refinement(tmp_path / "whole")
    whole.run()
    halted = refinement(tmp_path / "halted")
    for _ in range(3):
        halted.update()
    halted.save()
    again = refinement(tmp_path / "halted", resume=True)
    again.run()
    assert again.policy().to_text() == whole.policy().to_text()
    for made in ("short.formulas", "candidates.csv"):
        halted_bytes = (tmp_path / "halted" / made).read_bytes()
        assert halted_bytes == (tmp_path / "whole" / made).read_bytes()


def test_the_command_writes_the_formulas_and_their_record(short_page, tmp_path):
    short_page.save(tmp_path / "short.formulas")
    folder = tmp_path / "refined"
    arguments = ["refine", *SMALL, "--policy", str(tmp_path / "short.formulas")]
    arguments += ["--output", str(folder)]
    main(arguments)
    policy = load_policy(folder / "short.formulas")
    assert isinstance(policy, FormulaPolicy)
    assert {path.suffix for path in folder.glob("short.*")} == {".formulas", ".yaml", ".csv"}
    assert list(pd.read_csv(folder / "candidates.csv")["candidate"].sort_values()) == [
        "as they were",
        "update 2",
    ]
    main([*arguments, "--updates", "3", "--resume"])
    assert len((folder / "short.csv").read_text().splitlines()) == 1 + 3
    # The checkpoint beside it is no student.
    assert list(find_policies(load_gait("trot"), folder).students) == ["short"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--policy", "gbm"], "not made of formulas"),
        (["--n-robots", "4"], "fewer than n_groups"),
        (["--gait", "walk", "--policy", str(__file__)], "ending in .safetensors"),
    ],
)
def test_what_cannot_be_refined_is_refused(arguments, message, refused, tmp_path):
    folder = tmp_path / "refined"
    assert message in refused(["refine", *arguments, "--output", str(folder)])
    assert not folder.exists()


@pytest.mark.parametrize(
    ("formula", "message"),
    [
        ("0.3/(v.x - v.x)", "FL_hip in state 0 is not finite"),
        ("1e30", "1e+30"),
        ("0.1 + 0.2*tanh(2*e.v)", "not weights of terms"),
    ],
)
def test_formulas_that_cannot_learn_are_refused(formula, message, refused, tmp_path):
    path, folder = tmp_path / "own.formulas", tmp_path / "run"
    text, changed = re.subn(r"(?m)^FL_hip = .*$", f"FL_hip = {formula}", PAGE.to_text(), count=1)
    assert changed == 1
    path.write_text(text)
    said = refused(["refine", *SMALL, "--policy", str(path), "--output", str(folder)])
    assert "own.formulas: " in said and message in said
    assert not folder.exists()

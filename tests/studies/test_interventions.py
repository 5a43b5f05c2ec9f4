"""Interventions: terms that can be read, their claims, edits, and effects by robot."""

import numpy as np
import pandas as pd
import pytest

from glassgait.models.formulas.file import write_formulas
from glassgait.models.formulas.reader import read_formulas
from glassgait.models.policies.library import load_policy
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.models.robots import quadruped
from glassgait.models.robots.library import load_robot
from glassgait.models.task.observation import ObservationLayout, machine_state_entries
from glassgait.studies.cli import main
from glassgait.studies.explanation.claims import claim_of, derive_claims, readable_terms
from glassgait.studies.explanation.interventions import (
    mean_angle,
    result,
    walk_of,
    with_input_raised,
)

A1 = load_robot()
LAYOUT = ObservationLayout(2, imu=True)
NAMES = LAYOUT.names
SYMBOLS = [entry.symbol for entry in LAYOUT.entries]

HEADER = """\
format: 2
gait: trot
states: 2
senses: imu
mirror: [1, 0]

definitions
late = tanh(0.5*t - 2)
e.v = cmd.v - v.x
phase = t/cmd.t
lifted.FL = tanh(100*h.FL - 2)
sent.RL_calf = tanh(5*a.RL_calf + 7.5)

state 0
"""

FORMULAS = {
    "FL_hip": "0.1 + 0.4*q.FL_hip + 0.5*v.z + lifted.FL*(0.2 + 0.3*v.y)",
    "FL_thigh": "0.8 - 2*e.v + 0.1*late*late*v.x + 0.3*phase + tanh(cmd.v) + cmd.v*v.x",
    "RL_thigh": "0.9 + 0.2*g.x - 0.1*sent.RL_calf",
    "RL_calf": "-1.5 - late*(0.7*cmd.yaw - 0.1*cmd.yaw) + h.RL*0.5",
}


@pytest.fixture(scope="module")
def policy():
    lines = [f"{joint} = {FORMULAS.get(joint, '0.5')}" for joint in quadruped.JOINTS]
    return FormulaPolicy.from_file(read_formulas(HEADER + "\n".join(lines) + "\n"))


@pytest.fixture
def plain(policy, generator):
    """A walk of five robots whose front feet are often in the air."""
    drawn = generator.normal(size=(41, 5, len(NAMES)))
    one_hot = machine_state_entries(NAMES)
    drawn[..., one_hot] = np.eye(2)[generator.integers(2, size=(41, 5))]
    drawn[..., SYMBOLS.index("h.FL")] = generator.choice([0.0, 0.2, 0.2], size=(41, 5))
    return walk_of(policy, drawn, np.ones((41, 5), dtype=bool))


def term_of(policy, joint, text):
    symbols = policy.vocabulary.symbols
    found = readable_terms(policy.to_file())
    return next(term for term in found if (term.joint, term.text(symbols)) == (joint, text))


def test_terms_are_a_weight_times_one_input_and_gates(policy):
    symbols = policy.vocabulary.symbols
    found = [(term.joint, term.text(symbols)) for term in readable_terms(policy.to_file())]
    assert found == [
        ("FL_hip", "0.5*v.z"),
        ("FL_hip", "0.3*lifted.FL*v.y"),
        ("FL_thigh", "-2*e.v"),
        ("RL_thigh", "0.2*g.x"),
        ("RL_thigh", "-0.1*sent.RL_calf"),
        ("RL_calf", "-0.6*late*cmd.yaw"),
        ("RL_calf", "0.5*h.RL"),
    ]
    assert {term.state for term in readable_terms(policy.to_file())} == {0}


def test_a_claim_is_as_large_as_its_term_where_robots_go(policy, plain):
    claim = claim_of(term_of(policy, "FL_hip", "0.3*lifted.FL*v.y"), plain)
    gate, speed = (policy.vocabulary.symbols.index(name) for name in ("lifted.FL", "v.y"))
    mask = (plain.state == 0) & (plain.quantities[..., gate] > 0.0)
    assert claim.sides == (1,)
    assert claim.step == float(f"{plain.quantities[..., speed][mask].std():.2g}")
    mean = plain.quantities[..., gate][mask].mean()
    assert claim.effect == pytest.approx(0.3 * claim.step * mean)
    np.testing.assert_array_equal(claim.instants(plain), mask)


def test_claims_are_the_largest_of_different_inputs_and_joints(policy, plain):
    symbols = policy.vocabulary.symbols
    taken = derive_claims(policy.to_file(), plain, 4)
    assert {claim.term.joint for claim in taken} == set(FORMULAS)
    assert len({symbols[claim.term.input] for claim in taken}) == 4
    every = derive_claims(policy.to_file(), plain, 7)
    effects = [abs(claim.effect) for claim in every]
    assert effects == sorted(effects, reverse=True)


def test_an_edit_changes_only_its_term(policy, plain, generator):
    claim = claim_of(term_of(policy, "RL_calf", "-0.6*late*cmd.yaw"), plain)
    text = write_formulas(with_input_raised(policy.to_file(), claim))
    edited = FormulaPolicy.from_file(read_formulas(text))
    observed = generator.normal(size=(50, len(NAMES)))
    observed[:, machine_state_entries(NAMES)] = np.eye(2)[np.arange(50) % 2]
    late = policy.quantities(observed)[:, policy.vocabulary.symbols.index("late")]
    expected = np.zeros((50, 12))
    calf = quadruped.joint_index("RL_calf")
    expected[::2, calf] = -0.6 * claim.step * late[::2] / A1.action_scale
    moved = edited(observed) - policy(observed)
    np.testing.assert_allclose(moved, expected, atol=1e-3 * np.abs(expected).max())


def test_effects_are_measured_at_the_claims_instants_and_paired_by_robot(policy, plain):
    claim = claim_of(term_of(policy, "FL_hip", "0.5*v.z"), plain)
    moved = plain.angle.copy()
    robots = np.array([0.1, 0.11, 0.09, 0.1, 0.12])
    hip = quadruped.joint_index("FL_hip")
    moved[..., hip] += np.where(claim.instants(plain), robots, -5.0)
    edited = type(plain)(plain.quantities, plain.state, moved, plain.alive)
    row = result(claim, policy.vocabulary.symbols, plain, edited)
    assert row["measured (rad)"] == pytest.approx(robots.mean())
    assert row["± (rad)"] == pytest.approx(2.776 * robots.std(ddof=1) / np.sqrt(5), rel=1e-3)
    assert (row["holds"], row["falls"]) == ("yes", 0)
    assert result(claim, policy.vocabulary.symbols, edited, plain)["holds"] == "no"


def test_robots_that_fell_or_were_never_there_say_nothing(policy, plain):
    claim = claim_of(term_of(policy, "FL_hip", "0.5*v.z"), plain)
    alive = plain.alive.copy()
    alive[:, 0] = False
    fallen = type(plain)(plain.quantities, plain.state, plain.angle, alive)
    assert np.isnan(mean_angle(claim, fallen)).tolist() == [True, *[False] * 4]
    nobody = type(plain)(plain.quantities, plain.state, plain.angle, np.zeros_like(alive))
    assert claim_of(claim.term, nobody) is None


def test_the_command_writes_a_table_and_the_edited_files(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    small = ["--n-claims", "2", "--n-robots", "2", "--n-steps", "40"]
    main(["explain", "interventions", "--gait", "trot", "--policy", "formulas", *small])
    folder = tmp_path / "runs" / "explain" / "interventions" / "trot" / "formulas"
    table = pd.read_csv(folder / "interventions.csv")
    assert len(table) == 2
    assert set(table["holds"]) <= {"yes", "no"}
    edited = sorted((folder / "edited").iterdir())
    assert len(edited) == 2
    for path in edited:
        assert path.read_text().startswith("# ")
        assert load_policy(path).gait == "trot"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--n-claims", "5000"], "--n-claims: 5000 claims are asked for"),
        (["--policy", "gbm"], "gbm"),
        (["--n-robots", "1"], "n_robots"),
    ],
)
def test_bad_input_is_refused_before_anything_is_written(
    arguments, message, tmp_path, monkeypatch, refused
):
    monkeypatch.chdir(tmp_path)
    assert message in refused(["explain", "interventions", "--gait", "trot", *arguments])
    assert not list(tmp_path.iterdir())

"""The claims of a page: their derivation, their interventions, their statistics, their words."""

import json

import numpy as np
import pandas as pd
import pytest

from glassgait.models.formulas.reader import read_formulas
from glassgait.models.policies.library import STUDENT_DIRECTORY, load_policy, load_student
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.models.robots import quadruped
from glassgait.models.robots.library import load_robot
from glassgait.models.task.observation import ObservationLayout, machine_state_entries
from glassgait.studies.cli import main
from glassgait.studies.explanation.interventions.claims import (
    claim_of,
    derive_claims,
    following_words,
    joint_words,
    spoken_of,
)
from glassgait.studies.explanation.interventions.command import claims_figure
from glassgait.studies.explanation.interventions.study import (
    FOLDER,
    Examiner,
    angle_effect,
    paired_effect,
    read_back,
    with_input_raised,
    without_input,
    written,
)
from glassgait.studies.explanation.interventions.terms import readable_terms
from glassgait.studies.explanation.interventions.walks import seen_by

A1 = load_robot()


LAYOUT = ObservationLayout(2, imu=True)
NAMES = LAYOUT.names
SYMBOLS = [entry.symbol for entry in LAYOUT.entries]
COMMAND = ["explain", "interventions"]
SMALL = ["--n-claims", "2", "--n-robots", "2", "--n-steps", "110"]

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
lifted.FR = tanh(100*h.FR - 2)
sent.RL_calf = tanh(5*a.RL_calf + 7.5)
sent.RR_calf = tanh(5*a.RR_calf + 7.5)

state 0
"""

FORMULAS = {
    "FL_hip": "0.1 + 0.4*q.FL_hip + 0.5*v.z + lifted.FL*(0.2 + 0.3*v.y)",
    "FL_thigh": "0.8 - 2*e.v + 0.1*late*late*v.x + 0.3*phase + tanh(cmd.v) + cmd.v*v.x",
    "RL_thigh": "0.9 + 0.2*g.x - 0.1*sent.RL_calf",
    "RL_calf": "-1.5 - late*(0.7*cmd.yaw - 0.1*cmd.yaw) + h.RL*0.5",
}


def policy_of(formulas=FORMULAS, header=HEADER) -> FormulaPolicy:
    """A policy of a few formulas; joints that are left out stand still."""
    lines = [f"{joint} = {formulas.get(joint, '0.5')}" for joint in quadruped.JOINTS]
    return FormulaPolicy.from_file(read_formulas(header + "\n".join(lines) + "\n"))


def term_of(policy, joint, text):
    symbols = policy.vocabulary.symbols
    found = readable_terms(policy.to_file())
    return next(term for term in found if (term.joint_name, term.text(symbols)) == (joint, text))


def observations(generator, steps=40, robots=5):
    """Draws observations (steps, robots, N) whose front feet are high above or on the ground."""
    drawn = generator.normal(size=(steps, robots, len(NAMES)))
    one_hot = machine_state_entries(NAMES)
    drawn[..., one_hot] = np.eye(2)[generator.integers(2, size=(steps, robots))]
    for foot in ("h.FL", "h.FR"):
        drawn[..., SYMBOLS.index(foot)] = generator.choice([0.0, 0.2, 0.2], size=(steps, robots))
    return drawn


def walk_of(policy, observed, alive=None):
    alive = np.ones(observed.shape[:2], dtype=bool) if alive is None else alive
    scores = pd.DataFrame(
        {"fell": ~alive.all(axis=0), "going_speed_error": 0.1, "yaw_rate_error": 0.1}
    )
    return seen_by(policy, observed, alive, scores)


def test_terms_are_a_weight_times_one_input_alone_or_in_gates():
    policy = policy_of()
    symbols = policy.vocabulary.symbols
    found = [(term.joint_name, term.text(symbols)) for term in readable_terms(policy.to_file())]
    assert found == [
        ("FL_hip", "0.5*v.z"),
        ("FL_hip", "0.3*lifted.FL*v.y"),
        ("FL_thigh", "-2*e.v"),
        ("RL_thigh", "0.2*g.x"),
        ("RL_thigh", "-0.1*sent.RL_calf"),
        ("RL_calf", "-0.6*late*cmd.yaw"),
        ("RL_calf", "0.5*h.RL"),
    ]
    assert all(term.mirrored and term.state == 0 for term in readable_terms(policy.to_file()))


def test_a_formula_of_all_states_has_no_state_but_those_in_its_terms(generator):
    header = HEADER.replace("state 0", "every state").replace("mirror: [1, 0]\n", "")
    policy = policy_of({"FL_hip": "0.2*s1*v.y"}, header)
    (term,) = readable_terms(policy.to_file())
    assert (term.state, term.mirrored) == (None, False)
    walk = walk_of(policy, observations(generator))
    claim = claim_of(term, policy.to_file(), walk)
    assert claim is not None
    np.testing.assert_array_equal(spoken_of(claim, walk), walk.state == 1)
    assert joint_words(claim, policy.vocabulary).endswith("hip outward, in state 1")


def test_a_claim_has_the_size_that_its_term_has_where_robots_go(generator):
    policy, observed = policy_of(), observations(generator)
    walk = walk_of(policy, observed)
    term = term_of(policy, "FL_hip", "0.3*lifted.FL*v.y")
    claim = claim_of(term, policy.to_file(), walk)
    assert claim is not None
    assert claim.sides == (1,)
    mask = spoken_of(claim, walk)
    symbols = policy.vocabulary.symbols
    gate = walk.quantities[..., symbols.index("lifted.FL")]
    assert np.all(gate[mask] > 0.9)
    assert np.all(walk.state[mask] == 0)
    spread = np.std(walk.quantities[..., symbols.index("v.y")][mask])
    assert claim.step == pytest.approx(spread, rel=0.05)
    assert claim.effect == pytest.approx(0.3 * claim.step * gate[mask].mean())


def test_a_mirror_image_is_seen_as_the_formula_that_is_written(generator):
    policy, observed = policy_of(), observations(generator)
    walk = walk_of(policy, observed)
    steps = len(observed) - 1
    assert walk.image.tolist() == [False] * steps + [True] * steps
    assert np.all(walk.state[steps:] == 1 - walk.state[:steps])
    own, image = walk.angle[:steps], walk.angle[steps:]
    hips = [quadruped.JOINTS.index(joint) for joint in ("FL_hip", "FR_hip")]
    np.testing.assert_allclose(image[..., hips[0]], -own[..., hips[1]], atol=1e-12)
    yaw = walk.quantities[..., SYMBOLS.index("cmd.yaw")]
    np.testing.assert_allclose(yaw[steps:], -yaw[:steps])


def test_claims_are_the_largest_of_different_inputs_and_joints(generator):
    policy = policy_of(
        {
            "FL_hip": "0.9*v.y + 0.8*v.z + 0.01*cmd.yaw",
            "FR_hip": "0.7*v.y",
            "RL_hip": "0.1*v.z",
            "RR_hip": "0.05*cmd.yaw",
        }
    )
    walk = walk_of(policy, observations(generator))

    def chosen(count):
        claims = derive_claims(policy.to_file(), walk, count)
        assert claims == sorted(claims, key=lambda claim: -abs(claim.effect))
        return [claim.term.text(policy.vocabulary.symbols) for claim in claims]

    assert chosen(1) == ["0.9*v.y"]
    assert set(chosen(3)) == {"0.9*v.y", "0.1*v.z", "0.05*cmd.yaw"}
    assert set(chosen(4)) == {*chosen(3), "0.8*v.z"}
    assert chosen(4) == chosen(4)


@pytest.mark.parametrize(
    ("joint", "text"),
    [
        ("FL_hip", "0.5*v.z"),
        ("FL_hip", "0.3*lifted.FL*v.y"),
        ("FL_thigh", "-2*e.v"),
        ("RL_calf", "-0.6*late*cmd.yaw"),
    ],
)
def test_an_edit_changes_its_term_and_the_image_alone(joint, text, generator):
    policy = policy_of()
    term = term_of(policy, joint, text)
    observed = observations(generator)
    quantities = policy.quantities(observed)
    gates = np.prod(quantities[..., list(term.gates)], axis=-1)
    raised = read_back(written(with_input_raised(policy.to_file(), term, 0.25), "raised"))
    without = read_back(written(without_input(policy.to_file(), term, 0.125), "without"))
    value = term.weight * gates * quantities[..., term.input]
    first = quantities[..., SYMBOLS.index("s0")] == 1.0
    for edited, change in ((raised, 0.25 * term.weight * gates), (without, 0.125 - value)):
        targets = A1.action_scale * (edited(observed) - policy(observed))
        np.testing.assert_allclose(targets[first][:, term.joint], change[first], atol=1e-12)
        others = [index for index in range(quadruped.N_JOINTS) if index != term.joint]
        np.testing.assert_allclose(targets[first][:, others], 0.0, atol=1e-12)
        changed = np.abs(targets[~first]).max(axis=0) > 1e-9
        image = {"FL": "FR", "RL": "RR"}[joint[:2]] + joint[2:]
        assert [quadruped.JOINTS[index] for index in np.flatnonzero(changed)] == [image]
        assert len(edited.to_file().written()) == len(policy.to_file().written())


def test_an_edited_file_says_on_top_what_was_done_and_ends_its_formula_in_it():
    policy = policy_of()
    term = term_of(policy, "FL_hip", "0.5*v.z")
    text = written(with_input_raised(policy.to_file(), term, 0.2), "v.z greater")
    assert text.startswith("# v.z greater\nformat: 2\n")
    assert "0.3*v.y) + 0.1\n" in text


def test_a_formula_without_an_image_is_edited_and_seen_alone(generator):
    lines = "\nstate 1\nFR_hip = 0.3*v.z\n"
    text = policy_of().to_text() + lines
    policy = FormulaPolicy.from_file(read_formulas(text))
    term = term_of(policy, "FL_hip", "0.5*v.z")
    assert not term.mirrored
    walk = walk_of(policy, observations(generator))
    claim = claim_of(term, policy.to_file(), walk)
    assert claim is not None
    assert not spoken_of(claim, walk)[walk.image].any()
    edited = with_input_raised(policy.to_file(), term, 0.2)
    image = (1, quadruped.JOINTS.index("FR_hip"))
    assert edited.formulas[image] == policy.to_file().formulas[image]


def test_effects_are_paired_by_robot(generator):
    own = generator.normal(scale=5.0, size=50)
    effect = paired_effect(own + 0.3 + 0.1 * generator.normal(size=50), own)
    assert effect.robots == 50
    assert effect.measured == pytest.approx(0.3, abs=0.05)
    assert effect.margin == pytest.approx(0.1 * 2.01 / np.sqrt(50), rel=0.3)
    assert (effect.holds(1.0), effect.holds(-1.0)) == (True, False)


def test_of_no_effect_95_of_100_intervals_hold_0(generator):
    nothing = np.zeros(8)
    effects = [paired_effect(generator.normal(size=8), nothing) for _ in range(2000)]
    share = np.mean([abs(effect.measured) > effect.margin for effect in effects])
    assert share == pytest.approx(0.05, abs=0.02)


def test_too_few_robots_show_nothing():
    assert not paired_effect(np.array([1.0]), np.array([0.0])).holds(1.0)
    nothing = paired_effect(np.array([np.nan, np.nan]), np.zeros(2))
    assert (nothing.robots, nothing.holds(1.0)) == (0, False)
    assert paired_effect(np.array([1.0, 2.0, np.nan]), np.zeros(3)).robots == 2


def test_the_angle_is_measured_when_the_claim_speaks_and_after_the_step(generator):
    policy, observed = policy_of(), observations(generator)
    alive = np.ones(observed.shape[:2], dtype=bool)
    alive[20:, 3] = False
    claim = claim_of(
        term_of(policy, "RL_calf", "0.5*h.RL"), policy.to_file(), walk_of(policy, observed)
    )
    assert claim is not None
    moved = observed.copy()
    calves = {leg: SYMBOLS.index(f"q.{leg}_calf") for leg in ("RL", "RR")}
    state = np.argmax(observed[..., machine_state_entries(NAMES)], axis=-1)[:-1]
    # State 0 moves the left calf at the step after, and its mirror image the right one.
    moved[1:, :, calves["RL"]] += 0.2 * (state == 0)
    moved[1:, :, calves["RR"]] += 0.2 * (state == 1)
    moved[21:, 3] += 100.0
    effect = angle_effect(claim, *(walk_of(policy, one, alive) for one in (observed, moved)))
    assert effect.measured == pytest.approx(0.2)
    assert effect.margin == pytest.approx(0.0, abs=1e-9)


WORDS = [
    ("FL_hip", "0.3*lifted.FL*v.y", "speed to the left turns the front left hip outward, while "
     "the front left foot is in the air, in state 0"),
    ("FL_thigh", "-2*e.v", "swings the front left thigh forward, in state 0"),
    ("RL_thigh", "0.2*g.x", "as with a lower nose, swings the rear left thigh back, in state 0"),
    ("RL_thigh", "-0.1*sent.RL_calf", "of the gate of the rear left knee's last target swings"),
    ("RL_calf", "0.5*h.RL", "height of the rear left foot stretches the rear left knee, in"),
]  # fmt: skip


@pytest.mark.parametrize(("joint", "text", "words"), WORDS)
def test_claims_are_written_in_words(joint, text, words, generator):
    policy = policy_of()
    walk = walk_of(policy, observations(generator))
    claim = claim_of(term_of(policy, joint, text), policy.to_file(), walk)
    assert claim is not None
    described = joint_words(claim, policy.vocabulary)
    assert words in described
    assert f"{claim.step:g}" in described
    assert "by more" in following_words(claim, "going_speed_error")


def test_claims_that_fail_stay_in_the_table(tmp_path, generator):
    policy, observed = policy_of(), observations(generator)
    plain = walk_of(policy, observed)
    claims = derive_claims(policy.to_file(), plain, 3)
    # Robots that do not mind what their formulas say.
    examiner = Examiner(policy, plain, lambda edited: walk_of(edited, observed), tmp_path)
    table = examiner.examine(claims)
    followed = [claim for claim in claims if claim.term.joint_name in ("FL_thigh", "RL_calf")]
    assert len(table) == 3 + len(followed)
    assert not table["holds"].any()
    assert table["predicted"].isna().sum() == len(followed)
    assert (table["measured"] == 0.0).all()
    for path in table["file"]:
        assert (tmp_path / path).read_text().startswith("# The term ")
        assert load_policy(tmp_path / path).gait == "trot"
    assert len(claims_figure(table, "none holds").axes) == 2


def test_the_page_that_ships_speaks_of_many_inputs():
    policy = load_student("trot", "sparse_formula")
    assert isinstance(policy, FormulaPolicy)
    found = readable_terms(policy.to_file())
    assert len({term.input for term in found}) >= 8
    assert len({term.joint for term in found}) == quadruped.N_JOINTS


def test_command_writes_tables_figure_and_edited_files(tmp_path, refused):
    output = tmp_path / "claims"
    command = [*COMMAND, "--policy", "sparse_formula", *SMALL, "--output", str(output)]
    main(command)
    assert {path.name for path in output.iterdir() if path.name[0] != "."} == {
        "config.yaml", "metrics.json", "claims.csv", "claims.md", "claims.png", "claims.pdf", FOLDER
    }  # fmt: skip
    metrics = json.loads((output / "metrics.json").read_text(), parse_constant=pytest.fail)
    table = pd.read_csv(output / "claims.csv")
    assert metrics["tested"] == len(table) == len(metrics["claims"])
    assert metrics["held"] == (table["holds"] == "yes").sum()
    assert {claim["file"] for claim in metrics["claims"]} == {
        f"{FOLDER}/{path.name}" for path in (output / FOLDER).iterdir()
    }
    assert "continue it with --resume" in refused(command)


def test_bad_input_is_refused_before_anything_is_written(tmp_path, monkeypatch, refused):
    monkeypatch.chdir(tmp_path)
    assert "not made of formulas" in refused([*COMMAND, "--policy", "gbm"])
    assert "--policy" in refused([*COMMAND, "--policy", "pages"])
    refusal = refused([*COMMAND, "--policy", "sparse_formula", "--n-claims", "1000"])
    assert "1000 claims are asked for" in refusal
    readings = tmp_path / "readings.formulas"
    readings.write_text(policy_of({"FL_hip": "0.5*q.FL_hip + cmd.v*v.x"}).to_text())
    refusal = refused([*COMMAND, "--policy", str(readings), "--n-claims", "1"])
    assert "0 terms can be read" in refusal
    assert [path.name for path in tmp_path.iterdir()] == ["readings.formulas"]


def test_a_term_that_never_counts_is_refused_and_leaves_no_folder(tmp_path, refused):
    path, output = tmp_path / "still.formulas", tmp_path / "runs"
    path.write_text(policy_of({"FL_hip": "0*v.z"}).to_text())
    refusal = refused(
        [*COMMAND, "--policy", str(path), *SMALL[2:], "--n-claims", "1", "--output", str(output)]
    )
    assert "0 terms can be read" in refusal
    assert not output.exists()


@pytest.mark.slow
@pytest.mark.parametrize(("gait", "kind"), [("trot", "symbolic"), ("walk", "statewise_symbolic")])
def test_formulas_of_every_shape_are_tested(gait, kind, tmp_path):
    output = tmp_path / "claims"
    main([*COMMAND, "--gait", gait, "--policy", kind, *SMALL, "--output", str(output)])
    assert len(pd.read_csv(output / "claims.csv")) >= 2


@pytest.mark.slow
def test_equal_seeds_give_equal_tables(tmp_path):
    page = str(STUDENT_DIRECTORY / "trot" / "sparse_formula.formulas")
    tables = []
    for name in ("a", "b"):
        main([*COMMAND, "--policy", page, *SMALL, "--output", str(tmp_path / name)])
        tables.append((tmp_path / name / "claims.csv").read_text())
    assert tables[0] == tables[1]

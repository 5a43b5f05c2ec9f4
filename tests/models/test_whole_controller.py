"""Formula files that hold a whole controller: contacts, the gait's machine, images left out."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from glassgait.diagrams.locomotion import MakeLocomotion
from glassgait.diagrams.scenario import Scenario
from glassgait.diagrams.task_config import TaskConfig
from glassgait.models.certificates.checker import RefusedError
from glassgait.models.certificates.checker.text import FormulaText
from glassgait.models.errors import InputError
from glassgait.models.export.c_source import write_controller
from glassgait.models.formulas.mirror import completed, without_images
from glassgait.models.formulas.quantities import known_definitions
from glassgait.models.formulas.reader import read_formulas
from glassgait.models.policies.controller import alone
from glassgait.models.policies.library import (
    STUDENT_DIRECTORY,
    find_gait,
    load_expert,
    load_policy,
    load_student,
)
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.models.robots import quadruped
from glassgait.models.robots.library import load_robot
from glassgait.models.task import gait as gaits
from glassgait.models.task.gait import gait_lines, gait_names, load_gait, parse_gait
from glassgait.models.task.observation import ObservationLayout
from glassgait.models.task.symmetry import REFLECT_JOINTS, reflect_observation

A1, TROT = load_robot(), load_gait("trot")
PAGE = load_student("trot", "sparse_formula")
TEXT = PAGE.to_text()
EDITED = TEXT.replace("clearance: 0.03", "clearance: 0.05")


def policy_of(text: str) -> FormulaPolicy:
    return FormulaPolicy.from_file(read_formulas(text))


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        # Of the others a text is long to read.
        pytest.param(name, path.stem, marks=() if "sparse" in path.stem else pytest.mark.slow)
        for name in gait_names()
        for path in sorted((STUDENT_DIRECTORY / name).glob(f"*{FormulaPolicy.suffix}"))
    ],
)
def test_formulas_that_ship_hold_their_gait(name, kind):
    policy = load_student(name, kind)
    assert policy.machine == load_gait(name)
    path = STUDENT_DIRECTORY / name / f"{kind}{policy.suffix}"
    assert path.read_text() == policy.to_text()
    assert policy_of(policy.to_text()).digest() == policy.digest()


letters = st.characters(
    codec="utf-8", categories=["L", "N", "P", "S"], include_characters=" ", exclude_characters="#"
)
names = st.text(letters, max_size=20)


@given(name=st.sampled_from(gait_names()), said=names, states=st.lists(names, min_size=10))
def test_a_gait_is_read_as_it_was_written(name, said, states):
    gait = load_gait(name)
    own = dict(
        zip(gait.states, (f"{i}{text}".strip() for i, text in enumerate(states)), strict=False)
    )
    edges = (
        replace(edge, source=own[edge.source], target=own[edge.target]) for edge in gait.transitions
    )
    other = replace(
        gait,
        description=" ".join(said.split()) or "None.",
        states=tuple(own.values()),
        initial=own[gait.initial],
        faults=tuple(own[state] for state in gait.faults),
        transitions=tuple(edges),
    )
    text = "\n".join(gait_lines(other))
    assert text.isascii()
    # In a formula file, # begins a comment.
    bare = "\n".join(line.partition("#")[0] for line in text.split("\n"))
    assert parse_gait(text, name=name) == parse_gait(bare, name=name) == other


def test_small_numbers_of_a_gait_are_read_as_numbers():
    small = replace(TROT, clearance=1e-5, max_yaw_rate=2.5e-7)
    assert parse_gait("\n".join(gait_lines(small)), name="trot") == small


YAML = (
    ("states: [q0, q1]", "states:\n- q0\n- q1"),
    ("states: [q0, q1]", "states: [q0, q1\n]"),
    ("states: [q0, q1]", "states: [q0,\n\n     # c\n  q1]"),
    ("states: [q0, q1]", 'states: [q0,\n  "q\n\n  1"]'),
    ("initial: q0", "initial: q0\n? faults\n: [q1]"),
    ("initial: q0", "initial: q0\nfaults: []"),
    ("description: Diagonal pairs of feet take turns.", "description: 2026-01-01"),
    (
        "description: Diagonal pairs of feet take turns.",
        "description: >-\n  Some\n\n  machine\n  limits",
    ),
    ("q1", "2026-01-01"),
    ("q1", "<<"),
    ("q1", "yes"),
    ("clearance: 0.03", "clearance: 0.03\nclearance: 0.04"),
    ("clearance: 0.03", "clearance: 0.03\n? [a, b]\n: c"),
    ("clearance: 0.03", "clearance: 0.03\nfaults: " + "[" * 3000 + "]" * 3000),
    ("clearance: 0.03", "clearance: 0.03\n...\nfoo"),
    ("dwell: [6, 11]", "dwell: &a [6, 11]"),
    ("dwell: [6, 11]", "dwell: [6, 0xb]"),
    ("when: FL &", "when: " + "(" * 60 + "FL" + ")" * 60 + " &"),
    ("when: FL & RR", "when: ~ ~ FL & RR"),
)


@pytest.mark.parametrize(("old", "new"), YAML, ids=range(len(YAML)))
def test_a_machine_is_read_alike_by_three(old, new, tmp_path):
    """By robots, by commands that take the file for a gait, and by the checker, or by none."""
    start, end = TEXT.index("\nmachine\n"), TEXT.index("\nreadings\n")
    text = TEXT[:start] + TEXT[start:end].replace(old, new) + TEXT[end:]
    assert text != TEXT
    path = tmp_path / "mine.formulas"
    path.write_text(text)
    try:
        machine = read_formulas(text).machine
    except InputError:
        with pytest.raises(InputError):
            find_gait(path)
        with pytest.raises(RefusedError):
            FormulaText.read(text)
        return
    assert machine is not None
    assert find_gait(path) == machine
    theirs = FormulaText.read(text).machine
    assert theirs is not None
    assert (theirs.states, theirs.said["initial"]) == ([*machine.states], machine.initial)
    assert theirs.said.get("faults", []) == [*machine.faults]
    for edge, other in zip(machine.transitions, theirs.said["transitions"], strict=True):
        assert (edge.source, edge.target) == (other["from"], other["to"])


def test_a_gait_is_another_where_it_acts_otherwise():
    assert TROT.first_difference(replace(TROT, description="Another.", name="other")) is None
    assert TROT.first_difference(replace(TROT, dwell=(6, 12))) == "dwell"
    spaced = parse_gait("\n".join(gait_lines(TROT)).replace("FL & RR &", "RR & FL &"), name="trot")
    assert spaced != TROT
    assert TROT.first_difference(spaced) is None
    other = parse_gait("\n".join(gait_lines(TROT)).replace("& ~RL", ""), name="trot")
    assert TROT.first_difference(other) == "transitions"


def test_a_policy_acts_in_its_own_machine_alone(tmp_path):
    edited = policy_of(EDITED)
    assert edited.digest() != PAGE.digest()
    (path := tmp_path / "mine.formulas").write_text(EDITED)
    machine = find_gait(path)
    assert (machine.name, machine.clearance) == ("trot", 0.05)
    both = alone(edited, load_expert("trot"))
    for gait, policy in ((TROT, edited), (machine, PAGE)):
        controller = alone(policy, load_expert("trot"))
        for build in (
            lambda gait=gait, policy=policy: MakeLocomotion(gait, policy=policy),
            lambda gait=gait, own=controller: TaskConfig.of_scenario(gait, Scenario(), own),
            lambda gait=gait, own=controller: write_controller(
                gait, own, name="mine", policy_name="mine", version="0"
            ),
        ):
            with pytest.raises(InputError, match="differs in 'clearance'"):
                build()
    assert (
        "CLEARANCE 0.05"
        in write_controller(machine, both, name="mine", policy_name="mine", version="0").source
    )
    assert TaskConfig.of_scenario(machine, Scenario(), both).gait.clearance == 0.05


def test_a_policy_takes_no_machine_of_another_gait():
    with pytest.raises(InputError, match="made for gait 'trot'"):
        PAGE.with_machine(load_gait("pace"))
    free = policy_of(TEXT[: TEXT.index("\nmachine\n")] + TEXT[TEXT.index("\nreadings\n") :])
    assert free.machine is None
    assert free.with_machine(TROT).digest() == PAGE.digest()


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("clearance: 0.03", "clearance: 0", "line 57, column 1: machine: clearance"),
        (
            "clearance: 0.03",
            "clearance: [",
            "line 59, column 1: machine: is not valid YAML (line 5",
        ),
        ("states: [q0, q1]", "states: [q0]", "line 58, column 1: machine: states"),
        ("from: q0, to: q1", "from: q0, to: q0", "machine: state 'q1' cannot be reached"),
        ("from: q1", "from: q2", "line 62, column 1: machine: transitions[1]"),
        ("initial: q0\n", "", "machine: lacks the key 'initial'"),
        ("states: 2\n", "states: 3\n", "mirror: must name"),
        ("mirror: 1 0", "mirror: 0 1", "line 5, column 1: mirror: is 0 1, and by the machine"),
        ("& ~RL}", "}", "line 5, column 1: mirror: is 1 0, and the machine of this trot favours"),
        ("states: 2\n", "robot:\nstates: 2\n", "line 3, column 1: robot: must name a robot, such"),
        ("\nreadings\n", "\nmachine\n\nreadings\n", "'machine' stands too late, or twice"),
        ("\nlimits\n", "\nmachine\n", "'machine' stands too late, or twice"),
        (
            "stuck = unchanged == 50",
            "stuck = unchanged == 51",
            "column 22: contacts is one",
        ),
        ("low = expected < 0.0075\n", "", "contacts is one program; write 'low ="),
    ],
)
def test_sections_that_are_wrong_are_refused_by_both_readers(old, new, said):
    assert old in TEXT
    with pytest.raises(InputError) as refused:
        read_formulas(TEXT.replace(old, new, 1))
    assert said in str(refused.value)
    with pytest.raises(RefusedError):
        FormulaText.read(TEXT.replace(old, new, 1))


def test_a_wrong_mirror_is_refused_where_a_file_without_a_machine_meets_its_gait():
    said = "mirror: is 0 1, .* write 'mirror: 1 0'"
    bare = replace(PAGE.to_file(), machine=None)
    policy = FormulaPolicy.from_file(replace(bare, mirror=(0, 1)))
    with pytest.raises(InputError, match=f"^{said}"):
        policy.check(gait=TROT, observation_names=policy.observation_names)
    # Without the images that are left out, the file itself is none.
    text = FormulaPolicy.from_file(bare).to_text().replace("mirror: 1 0", "mirror: 0 1")
    with pytest.raises(InputError, match=f"^line 5, column 1: {said}"):
        read_formulas(text)


def test_a_formula_file_without_its_gait_names_none(tmp_path):
    path = tmp_path / "mine.formulas"
    start, end = TEXT.index("\nmachine\n"), TEXT.index("\nreadings\n")
    path.write_text(TEXT[:start] + TEXT[end:])
    with pytest.raises(InputError, match="has no section 'machine'"):
        find_gait(path)
    for name in ("../up", "", ".hidden", "config"):
        path.write_text(TEXT.replace("gait: trot", f"gait: {name}"))
        with pytest.raises(InputError, match=r"header"):
            find_gait(path)


def test_definitions_of_right_legs_are_images_of_those_of_left_ones():
    names = ObservationLayout(2, imu=True).names
    every = known_definitions(A1, names)
    kept = without_images(names, (1, 0), every)
    assert [own.symbol for own in kept if ".FR" in own.symbol or ".RR" in own.symbol] == []
    assert completed(names, (1, 0), kept) == every
    # One that is no image stays, and so do all others then.
    odd = tuple(replace(own, note="odd") if own.symbol == "x.RR" else own for own in every)
    assert without_images(names, (1, 0), odd) == odd
    assert "x.FR =" not in TEXT
    assert "x.FR" in PAGE.vocabulary.symbols


def test_what_is_defined_for_one_side_alone_stands_in_the_mirror_in_full():
    """A definition whose image is another one: images of formulas with it are written without."""
    line = next(own for own in TEXT.split("\n") if own.startswith("lifted.FL ="))
    other = line.replace("lifted.FL = tanh(100*h.FL", "lifted.FR = tanh(90*h.FR")
    policy = policy_of(TEXT.replace(line, f"{line}\n{other}"))
    assert policy_of(policy.to_text()).digest() == policy.digest()
    seen = np.random.default_rng(0).normal(size=(50, len(PAGE.observation_names)))
    reflect = reflect_observation(PAGE.observation_names, (1, 0))
    images = REFLECT_JOINTS(policy(reflect(seen)))
    np.testing.assert_allclose(policy(seen), images, atol=1e-12)
    assert np.abs(policy(seen) - PAGE(seen)).max() > 1e-5
    theirs = FormulaText.read(policy.to_text())
    assert {*theirs.targets} == {(s, j) for s in range(2) for j in quadruped.JOINTS}


@pytest.mark.parametrize("section", ["contacts", "odometry"])
def test_contacts_and_odometry_go_together(section):
    start = TEXT.index(f"\n{section}\n")
    end = TEXT.index("\n\n", start + 1)
    with pytest.raises(InputError, match="go together"):
        read_formulas(TEXT[:start] + TEXT[end:])
    with pytest.raises(RefusedError):
        FormulaText.read(TEXT[:start] + TEXT[end:])


@pytest.mark.parametrize("kind", ["linear", "expert"])
def test_what_holds_no_machine_acts_in_the_one_that_ships(kind, make_policy):
    policy = load_expert("trot") if kind == "expert" else make_policy(TROT)
    policy.refuse_other_machine(TROT)
    policy.refuse_other_machine(replace(TROT, description="The same."))
    with pytest.raises(InputError, match="differs in 'dwell'"):
        policy.refuse_other_machine(replace(TROT, dwell=(6, 12)))


@pytest.mark.parametrize(
    ("old", "new"), [("\nlimits\n", "\nlimits \n\n"), ("stuck =", "sunk ="), ("\n", "\r\n")]
)
def test_a_gait_is_taken_from_whole_files_alone(old, new, tmp_path):
    path = tmp_path / "mine.formulas"
    path.write_text(TEXT.replace(old, new), newline="")
    try:
        own = load_policy(path).machine
    except InputError:
        with pytest.raises(InputError, match=r"mine.formulas"):
            find_gait(path)
    else:
        assert find_gait(path) == own


def test_a_checker_reads_the_machine_that_a_policy_holds():
    machine = FormulaText.read(EDITED).machine
    assert machine is not None
    assert machine.said["clearance"] == 0.05
    assert machine.mirrors([1, 0])
    assert np.allclose(machine.said["dwell"], TROT.dwell)


def test_the_gait_of_a_formula_file_is_of_its_robot():
    page = STUDENT_DIRECTORY / "go2" / "trot" / "sparse_formula.formulas"
    for robot in (None, "go2"):
        assert find_gait(page, robot).name == "trot"
    with pytest.raises(InputError, match="is of robot 'go2'"):
        find_gait(page, "a1")


def test_the_machine_of_a_gait_that_ships_is_read_once(monkeypatch):
    policy = load_expert("trot")
    policy.refuse_other_machine(TROT)
    monkeypatch.setattr(gaits, "read_text", lambda *_: pytest.fail("a file was read"))
    policy.refuse_other_machine(TROT)
    with pytest.raises(InputError, match="differs in 'dwell'"):
        policy.refuse_other_machine(replace(TROT, dwell=(6, 12)))

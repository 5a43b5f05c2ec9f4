"""Formula files: text defines the same policy, and invalid text is refused."""

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from glassgait.models.errors import InputError
from glassgait.models.estimation.odometry import Odometry
from glassgait.models.formulas.expression import canonical
from glassgait.models.formulas.file import SUFFIX
from glassgait.models.formulas.mirror import FormulaMirror
from glassgait.models.formulas.quantities import Definition, Vocabulary, known_definitions
from glassgait.models.formulas.reader import read_formulas
from glassgait.models.policies.controller import Controller, alone
from glassgait.models.policies.library import (
    STUDENT_DIRECTORY,
    find_gait,
    load_expert,
    load_policy,
    load_student,
)
from glassgait.models.policies.symbolic import FormulaPolicy, SymbolicPerStatePolicy, SymbolicPolicy
from glassgait.models.robots import quadruped
from glassgait.models.robots.library import load_robot
from glassgait.models.robots.robot import JointLaw, TargetLimits
from glassgait.models.task.gait import load_gait
from glassgait.models.task.observation import ObservationLayout

A1, TROT = load_robot(), load_gait("trot")
NAMES = ObservationLayout(2).names
KNOWN = known_definitions(A1, NAMES)
PLACE = re.compile(r"line (\d+), column (\d+): .")
HEAD = "format: 2\ngait: trot\nstates: 2\n"
PAGE = load_student("trot", "formulas")
TEXT = PAGE.to_text()
EDITED = TEXT.replace("clearance: 0.03", "clearance: 0.05")


def shared(**formulas):
    """Writes formulas for every state; joints that are not named have a constant target."""
    return "".join(f"{joint} = {formulas.get(joint, '0.1')}\n" for joint in quadruped.JOINTS)


EVERY = f"every state\n{shared()}"


def policy_of(text):
    return FormulaPolicy.from_file(read_formulas(text))


def without_machine(text):
    return re.sub("machine:\n(  .*\n)*", "", text)


@st.composite
def policies(draw, random_formulas):
    mirror = draw(st.sampled_from([None, (1, 0), (0, 1)]))
    notes = st.text(st.characters(codec="ascii", categories=["L", "N", "P", "S"]), max_size=9)
    odd = Definition("odd.d", canonical(draw(random_formulas(len(NAMES), 4))), draw(notes))
    # The odd definition has no mirror image.
    choices = [(), KNOWN, KNOWN[:2] if mirror else (*KNOWN[:2], odd)]
    vocabulary = Vocabulary(NAMES, draw(st.sampled_from(choices)))
    kind = draw(st.sampled_from([SymbolicPolicy, SymbolicPerStatePolicy]))
    some = st.lists(random_formulas(len(vocabulary.symbols), 5), min_size=1, max_size=4)
    pool = [canonical(formula) for formula in draw(some)]
    generator = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    shape = (12,) if kind is SymbolicPolicy else (2, 12)
    formulas = {place: pool[generator.integers(len(pool))] for place in np.ndindex(*shape)}
    if mirror is not None:
        image = FormulaMirror.of(vocabulary, mirror)
        for place in list(formulas):
            if generator.random() < 0.8:
                formulas[image.place(place)] = image.formula(formulas[place], place[-1])
    rows = list(formulas.values())
    rows = [rows[start : start + 12] for start in range(0, len(rows), 12)]
    return kind("trot", NAMES, rows, definitions=vocabulary.definitions, mirror=mirror)


@given(st.data())
def test_policies_come_back_from_their_text(random_formulas, samples, data):
    policy, observation = data.draw(policies(random_formulas)), samples(20)[0]
    text = policy.to_text()
    again = policy_of(text)
    assert again.to_text() == text
    assert type(again) is type(policy)
    assert (again.formulas_by_state, again.mirror) == (policy.formulas_by_state, policy.mirror)
    assert (again.vocabulary, again.digest()) == (policy.vocabulary, policy.digest())
    with np.errstate(over="ignore"):
        np.testing.assert_array_equal(again(observation), policy(observation))


@pytest.mark.parametrize(
    "path",
    [
        # The other files take long to read.
        pytest.param(path, marks=() if path.stem == "formulas" else pytest.mark.slow)
        for path in sorted(STUDENT_DIRECTORY.rglob(f"*{SUFFIX}"))
    ],
    ids=lambda path: f"{path.parent.name}-{path.stem}",
)
def test_shipped_files_are_written_as_they_stand_and_hold_their_gait(path):
    policy = load_policy(path)
    assert path.read_text() == policy.to_text()
    assert policy.machine == load_gait(policy.gait)


@pytest.mark.parametrize("gait", ["my own trot", "trot: fast", "trot #2", "Größe", "on", "1.5"])
def test_the_name_of_any_gait_comes_back(symbolic, gait):
    policy = SymbolicPolicy(gait, NAMES, symbolic.formulas_by_state)
    assert policy_of(policy.to_text()).gait == gait


@pytest.mark.parametrize(
    ("said", "law"),
    [
        ("limited: true", JointLaw(limited=True)),
        ("gains: [40, 1.5]", JointLaw((40.0, 1.5))),
        (f"gains: [{[20.0, 20.0, 40.0] * 4}, 1]", JointLaw(((20.0, 20.0, 40.0) * 4, 1.0))),
        ("limits: {stiffness: 1e2}", JointLaw(limits=TargetLimits(100.0))),
        ("limits: {stiffness: 90, margin: 1.0e-05, lean: 9}", None),
    ],
)
def test_a_header_says_how_joints_follow(symbolic, said, law):
    text = symbolic.to_text().replace("states: 2\n", f"states: 2\n{said.replace('1e2', '100')}\n")
    policy = policy_of(text)
    assert policy.joint_law == (law or JointLaw(limits=TargetLimits(90.0, margin=1e-5, lean=9.0)))
    assert policy_of(policy.to_text()).digest() == policy.digest() != symbolic.digest()
    assert policy.formulas_by_state == symbolic.formulas_by_state


def test_the_gain_of_odometry_can_be_edited(tmp_path):
    path = tmp_path / "mine.formulas"
    path.write_text(TEXT.replace("gain: 0.15", "gain: 0.4"))
    edited = load_policy(path)
    assert edited.estimator == Odometry(gain=0.4)
    assert edited.digest() != PAGE.digest()
    # If only the student acts, it uses its odometry; alternation would need two estimators.
    expert = load_expert("trot")
    assert alone(edited, expert).estimator == Odometry(gain=0.4)
    with pytest.raises(InputError, match="has odometry, which is not"):
        Controller(expert, edited, period=4)


def test_definitions_keep_their_notes_and_formulas_may_go_over_lines():
    text = (
        f"# what this is\n\n{HEAD}\n\ndefinitions  # these\nlate = tanh(0.5*t\n\n"
        "  # in between\n    - 2)   # -1 early, # 1 late\nfast = cmd.v\n\nevery state\n"
        + shared(FL_hip="0.1 # here\n    + late*cmd.yaw\n# there\n  - fast # and here")
    )
    policy = policy_of(text)
    late, fast = policy.vocabulary.definitions
    assert (late.symbol, late.note, fast.note) == ("late", "-1 early, # 1 late", "")
    written = policy.to_text()
    assert "\nlate = tanh(0.5*t - 2)    # -1 early, # 1 late\nfast = cmd.v\n" in written
    assert "\nFL_hip = 0.1 + late*cmd.yaw - fast\n" in written


def test_a_policy_acts_only_in_its_own_machine(tmp_path):
    edited = policy_of(EDITED)
    assert edited.digest() != PAGE.digest()
    (path := tmp_path / "mine.formulas").write_text(EDITED)
    machine = find_gait(path)
    assert (machine.name, machine.clearance) == ("trot", 0.05)
    edited.refuse_other_machine(machine)
    for gait, policy in ((TROT, edited), (machine, PAGE)):
        with pytest.raises(InputError, match="differs in 'clearance'"):
            policy.refuse_other_machine(gait)


def test_a_policy_takes_no_machine_of_another_gait():
    with pytest.raises(InputError, match="made for gait 'trot'"):
        PAGE.with_machine(load_gait("pace"))
    free = policy_of(without_machine(TEXT))
    assert free.machine is None
    assert free.with_machine(TROT).digest() == PAGE.digest()


def test_a_formula_file_without_a_machine_names_no_gait(tmp_path):
    path = tmp_path / "mine.formulas"
    path.write_text(without_machine(TEXT))
    with pytest.raises(InputError, match="has no key 'machine'"):
        find_gait(path)
    for name in ("../up", '""', ".hidden", "config"):
        path.write_text(TEXT.replace("gait: trot", f"gait: {name}"))
        with pytest.raises(InputError, match=r"(name|gait) is"):
            find_gait(path)


def test_the_gait_of_a_formula_file_is_of_its_robot():
    path = STUDENT_DIRECTORY / "go2" / "trot" / "formulas.formulas"
    assert find_gait(path, "go2") == find_gait(path) == TROT
    with pytest.raises(InputError, match="is of robot 'go2'"):
        find_gait(path, "a1")


def test_a_wrong_mirror_is_refused_where_a_file_without_a_machine_meets_its_gait():
    bare = replace(PAGE.to_file(), machine=None)
    policy = FormulaPolicy.from_file(replace(bare, mirror=(0, 1)))
    with pytest.raises(InputError, match=r"^mirror: .* write 'mirror: \[1, 0\]'"):
        policy.check(gait=TROT, observation_names=policy.observation_names)
    # The images that the file leaves out would then replace other formulas.
    text = without_machine(TEXT).replace("mirror: [1, 0]", "mirror: [0, 1]")
    with pytest.raises(InputError, match=r"^line 5, .* write 'mirror: \[1, 0\]'"):
        read_formulas(text)


HEADERS = [
    ("format: 2", "format: 1", 1, "begins with 'format: 2'"),
    ("gait: trot\n", "", 1, "lacks the key 'gait'"),
    ("gait: trot", "gait: trot\ngait: trot", 3, "'gait' is given twice"),
    ("states: 2", "states: two", 3, "states is 'two'"),
    ("states: 2", "states: 2\nrobot: ''", 4, "robot is ''"),
    ("senses: imu", "senses: sonar", 4, "senses is 'sonar'"),
    ("senses: imu\n", "", None, "add 'senses: imu'"),
    ("senses: imu", "senses: imu\nlimited: 1", 5, "limited is 1"),
    *(
        (r"[1, 0]", said, 5, "mirror")
        for said in ("1 0", "[0, 1]", "[0]", "[1, 1]", "[0, 2]", "[1.5, 0]")
    ),
    *(
        ("[40, 1]", said, 6, "gains")
        for said in ("40 1", "[40]", "[0, 1]", "[.nan, 1]", "[40, 101]")
    ),
    ("lean: 60", "lean: 91", 7, "limits.lean is 91"),
    ("stiffness: 40, ", "", 7, "lacks the key 'limits.stiffness'"),
    ("gain: 0.15", "gain: 2", 8, "odometry.gain is 2"),
    ("clearance: 0.03", "clearance: 0", 17, "clearance is 0"),
    ("clearance: 0.03", "clearance: [", None, "is not valid YAML"),
    ("dwell: [6", "dwell: &a [6", 16, "anchors"),
    ("states: [q0, q1]", "states: [q0]", 20, "names unknown state 'q1'"),
    ("from: q0, to: q1", "from: q0, to: q0", None, "machine: state 'q1' cannot be reached"),
    ("  initial: q0\n", "", 9, "machine: lacks the key 'initial'"),
    ("states: 2", "states: 3", None, "mirror"),
    ("& ~RL}", "}", 5, "favours a side"),
    ("[-0.43, 0.81]", "[0.81, -0.43]", 28, "q.hip is read from 0.81"),
    ("q.hip:", "q.knee:", 28, "unknown sensed quantity 'q.knee'"),
    ("cmd.yaw: [-1, 1]", "cmd.yaw: [-1, 2]", 27, "in a mirror from -2 to 1"),
]


@pytest.mark.parametrize(("old", "new", "line", "said"), HEADERS)
def test_a_wrong_header_is_refused(old, new, line, said):
    assert old in TEXT
    text = TEXT.replace(old, new, 1)
    with pytest.raises(InputError, match=PLACE) as refused:
        read_formulas(text)
    assert said in str(refused.value)
    assert line is None or str(refused.value).startswith(f"line {line}, ")


ONE_EACH = f"state 0\n{shared()}state 1\n{shared()}"


@pytest.mark.parametrize(
    ("text", "line", "said"),
    [
        ("", 1, "begins with 'format: 2'"),
        (HEAD, 4, "without a formula of FL_hip"),
        (f"{HEAD}{EVERY}gait: pace\n", 17, "no line of a formula file"),
        (f"{HEAD}{EVERY}definitions\n", 17, "before all formulas"),
        (f"{HEAD}{EVERY}state 0\n", 17, "not both"),
        (f"{HEAD}{EVERY}FL_hip = 0.2\n", 17, "FL_hip has a formula above"),
        (f"{HEAD}{EVERY}FL_foot = 0.2\n", 17, "'FL_foot' is no joint; the joints are FL_hip"),
        (f"{HEAD}{ONE_EACH}state 2\n", 30, "there are states 0 to 1"),
        (f"{HEAD}{ONE_EACH}state 0\n", 30, "'state 0' occurs twice"),
        (f"{HEAD}state 0\n{shared()}", 16, "without a formula of FL_hip in state 1"),
        (f"{HEAD}{EVERY.replace('RL_calf', '#')}", 16, "without a formula of RL_calf"),
        (f"{HEAD}{EVERY}state 0  # so\n    FL_hip = t\n", 18, "only one line"),
        (f"{HEAD}definitions\nt = 2\n{EVERY}", 5, "'t' cannot be defined"),
        (f"{HEAD}definitions\na = t\na = t\n{EVERY}", 6, "'a' cannot be defined"),
        (f"{HEAD}definitions\nlate = t\nb = late\n{EVERY}", 6, "unknown name 'late'"),
        (f"{HEAD}every state\n{shared(RL_hip='0.1  + foo')}", 11, "unknown name 'foo'"),
    ],
)
def test_what_is_no_formula_file_is_refused_with_its_line(text, line, said):
    with pytest.raises(InputError, match=PLACE) as refused:
        read_formulas(text)
    assert str(refused.value).startswith(f"line {line}, ")
    assert said in str(refused.value)

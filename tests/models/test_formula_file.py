"""Formula files: text that is the policy, and the refusal of a text that is none."""

import re
import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from glassgait.models.certificates.checker import RefusedError
from glassgait.models.certificates.checker.text import FormulaText
from glassgait.models.errors import InputError
from glassgait.models.formulas.expression import canonical
from glassgait.models.formulas.file import SUFFIX
from glassgait.models.formulas.mirror import FormulaMirror
from glassgait.models.formulas.quantities import Definition, Vocabulary, known_definitions
from glassgait.models.formulas.reader import MAX_DEFINITIONS, read_formulas
from glassgait.models.formulas.text import write_formula
from glassgait.models.policies.library import load_policy
from glassgait.models.policies.symbolic import (
    FormulaPolicy,
    StatewiseSymbolicPolicy,
    SymbolicPolicy,
)
from glassgait.models.robots import quadruped
from glassgait.models.robots.joint_law import JointLaw
from glassgait.models.robots.library import load_robot
from glassgait.models.task.observation import ObservationLayout
from glassgait.models.task.symmetry import REFLECT_JOINTS, reflect_observation

A1 = load_robot()


NAMES = ObservationLayout(2).names
KNOWN = known_definitions(A1, NAMES)
PLACE = re.compile(r"line (\d+), column (\d+): .")
HEAD = "format: 1\ngait: trot\nstates: 2\n"


def shared(**formulas):
    """Writes formulas that serve every state, 0.1 for joints that none is given of."""
    return "".join(f"{joint} = {formulas.get(joint, '0.1')}\n" for joint in quadruped.JOINTS)


def policy_of(text):
    return FormulaPolicy.from_file(read_formulas(text))


def refusal(text):
    with pytest.raises(InputError, match=PLACE) as refused:
        read_formulas(text)
    return str(refused.value)


@st.composite
def policies(draw, random_formulas):
    mirror = draw(st.sampled_from([None, (1, 0), (0, 1)]))
    notes = st.text(st.characters(codec="ascii", categories=["L", "N", "P", "S"]), max_size=9)
    own = Definition("own.d", canonical(draw(random_formulas(len(NAMES), 4))), draw(notes))
    definitions = draw(st.sampled_from([(), KNOWN, (*KNOWN[:2], own)]))
    # Own definitions have no mirror image.
    definitions = KNOWN[:2] if mirror and own in definitions else definitions
    vocabulary = Vocabulary(NAMES, definitions)
    kind = draw(st.sampled_from([SymbolicPolicy, StatewiseSymbolicPolicy]))
    shape = (12,) if kind is SymbolicPolicy else (2, 12)
    some = st.lists(random_formulas(len(vocabulary.symbols), 5), min_size=1, max_size=4)
    pool = [canonical(formula) for formula in draw(some)]
    generator = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    formulas = {place: pool[generator.integers(len(pool))] for place in np.ndindex(*shape)}
    if mirror is not None:
        image = FormulaMirror.of(vocabulary, mirror)
        for place in list(formulas):
            if generator.random() < 0.8:
                formulas[image.place(place)] = image.formula(formulas[place], place[-1])
    rows = list(formulas.values())
    if kind is StatewiseSymbolicPolicy:
        rows = [rows[:12], rows[12:]]
    return kind("trot", NAMES, rows, definitions=definitions, mirror=mirror)


def assert_comes_back(policy, observation):
    text = policy.to_text()
    again = policy_of(text)
    assert again.to_text() == text
    assert type(again) is type(policy)
    assert (again.expressions, again.mirror) == (policy.expressions, policy.mirror)
    assert again.vocabulary == policy.vocabulary
    assert again.digest() == policy.digest()
    with np.errstate(over="ignore"):
        np.testing.assert_array_equal(again(observation), policy(observation))


@given(st.data())
def test_policies_come_back_from_their_text(random_formulas, samples, data):
    assert_comes_back(data.draw(policies(random_formulas)), samples(20)[0])


@pytest.mark.parametrize("gait", ["my own trot", "trot: fast"])
def test_the_name_of_any_gait_comes_back(symbolic, gait):
    policy = SymbolicPolicy(gait, NAMES, symbolic.expressions)
    assert policy_of(policy.to_text()).gait == gait


def test_a_name_that_files_cannot_hold_is_refused(symbolic):
    for gait in ("trot #2", "Größe"):
        with pytest.raises(InputError, match=f"'{gait}' cannot stand in a formula file"):
            SymbolicPolicy(gait, NAMES, symbolic.expressions).to_text()


def test_a_mirror_that_is_none_is_refused(symbolic):
    for mirror in ((0,), (0, 2), (1, 1), (0, 1, 2)):
        with pytest.raises(InputError, match="image"):
            SymbolicPolicy("trot", NAMES, symbolic.expressions, mirror=mirror)


def test_a_file_says_whether_targets_are_limited(symbolic):
    free = policy_of(symbolic.to_text())
    limited = policy_of(symbolic.to_text().replace("states: 2\n", "states: 2\ntargets: limited\n"))
    assert (free.joint_law.limited, limited.joint_law.limited) == (False, True)
    assert "targets: limited\n" in limited.to_text()
    assert policy_of(limited.to_text()).joint_law.limited
    # What the formulas ask for is the same; what the robot does is not.
    assert limited.expressions == free.expressions
    assert limited.digest() != free.digest() == symbolic.digest()


def test_a_file_says_with_which_gains_joints_follow(symbolic):
    said = "states: 2\ntargets: limited\ngains: 40 1.5\n"
    firm = policy_of(symbolic.to_text().replace("states: 2\n", said))
    assert firm.joint_law == JointLaw((40.0, 1.5), limited=True)
    assert "gains: 40 1.5    # N m/rad and N m s/rad; torque" in firm.to_text()
    assert policy_of(firm.to_text()).digest() == firm.digest() != symbolic.digest()
    assert FormulaText.read(firm.to_text()).stiffness == 40.0
    assert FormulaText.read(symbolic.to_text()).stiffness is None


@pytest.mark.parametrize(
    "gains",
    [
        *("", "40", "40 1 2", "0 1", "-1 1", "nan 1", "1e4 1", "forty 1", "40 101", "40 -1"),
        # Python alone would read the first three.
        *("4_0 1", "+40 1", "40 -0", "1.2.3 1", "4_0 40 1"),
    ],
)
def test_gains_that_are_none_are_refused(gains):
    text = f"{HEAD}gains: {gains}\n{EVERY}"
    assert refusal(text).startswith("line 4, column 1: gains: must be a stiffness")
    with pytest.raises(RefusedError):
        FormulaText.read(text)


def test_a_number_keeps_all_its_digits():
    numbers = (np.random.default_rng(0).normal(size=12) * 10.0 ** np.arange(-6, 6)).tolist()
    formulas = {joint: f"{numbers[j]!r} - t" for j, joint in enumerate(quadruped.JOINTS)}
    policy = policy_of(f"{HEAD}every state\n{shared(**formulas)}")
    assert [formula.operands[0].value for formula in policy.expressions] == numbers
    assert policy_of(policy.to_text()).expressions == policy.expressions


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


def mirrored_text(mirror):
    """Writes random formulas of 12 of the 24 places, from which the others follow."""
    generator = np.random.default_rng(5)
    symbols = Vocabulary(NAMES, KNOWN).symbols
    text = f"{HEAD}mirror: {mirror}\n\ndefinitions\n"
    for definition in KNOWN:
        text += f"{definition.symbol} = {write_formula(definition.formula, symbols)}\n"
    for state in (0,) if mirror == "1 0" else (0, 1):
        text += f"\nstate {state}\n"
        for joint in (
            quadruped.JOINTS if mirror == "1 0" else (*quadruped.JOINTS[:3], *quadruped.JOINTS[6:9])
        ):
            a, b, c, d = generator.choice(symbols, size=4)
            x, y = generator.normal(size=2).round(3)
            text += f"{joint} = {x} + {a}*{b} - {y}*tanh({c}) - ({d} - 1)**2 - {a}\n"
    return text


@pytest.mark.parametrize("mirror", ["1 0", "0 1"])
def test_a_mirrored_file_holds_half_of_the_formulas_and_acts_alike_on_both_sides(mirror, samples):
    policy = policy_of(mirrored_text(mirror))
    assert sum(len(row) for row in policy.expressions) == 24
    lines = policy.to_text().splitlines()
    assert sum(line.startswith(quadruped.JOINTS) for line in lines) == 12
    reflect = reflect_observation(NAMES, policy.mirror)
    observation = samples(200)[0]
    own, image = policy(observation), policy(reflect(observation))
    np.testing.assert_allclose(image, REFLECT_JOINTS(own), rtol=1e-12, atol=1e-12)
    assert np.abs(own - REFLECT_JOINTS(own)).max() > 0.1


def test_what_stands_in_a_file_is_explained_in_it():
    text = "mirror: 1 0\n\ndefinitions\nlate = tanh(0.5*t - 2)\n\nstate 0\n"
    policy = policy_of(HEAD + text + shared(FL_hip="late*q.FL_hip"))
    written = policy.to_text()
    header, legend = written.split("\n\n")[:2]
    assert "mirror: 1 0    # states 0, 1, ... in a mirror" in header
    assert legend.split("\n") == [
        "# Each formula is the target of a joint, in rad. Greater angles turn a hip to the left,",
        "# swing a thigh back, and stretch a knee.",
        "# q: angle of a joint, rad.",
        "# t: control steps since the state began, counted up to cmd.t + 2.",
        "# In the mirror left and right feet change places, and hips (q, dq, a), cmd.yaw, v.y,",
        "# g.y, w.x and w.z their sign.",
    ]
    assert read_formulas(written).mirror == (1, 0)


def test_a_formula_that_is_no_mirror_image_stands_in_the_file():
    policy = policy_of(mirrored_text("1 0") + "\nstate 1\nFL_hip = 0.5\n")
    assert "\nstate 1\nFL_hip = 0.5\n" in policy.to_text()
    assert policy_of(policy.to_text()).expressions == policy.expressions


DAMAGE = "()+-*/=#:., \t\n019eaqs_tv'\"\\[é−\N{LINE SEPARATOR}"


def damaged(text, generator):
    """Changes a few characters or lines, or cuts the text."""
    for _ in range(generator.integers(1, 4)):
        lines = text.split("\n")
        i, j = generator.integers(len(lines), size=2)
        at = int(generator.integers(len(text) + 1))
        sign = DAMAGE[generator.integers(len(DAMAGE))]
        match generator.integers(7):
            case 0:
                text = text[:at] + text[at + int(generator.integers(1, 4)) :]
            case 1:
                text = text[:at] + sign + text[at:]
            case 2:
                text = text[:at] + sign + text[at + 1 :]
            case 3:
                text = "\n".join(lines[:i] + lines[i + 1 :])
            case 4:
                text = "\n".join([*lines[:i], lines[j], *lines[i:]])
            case 5:
                lines[i], lines[j] = lines[j], lines[i]
                text = "\n".join(lines)
            case _:
                text = text[: max(at, 30)]
    return text


@pytest.fixture
def whole_texts(symbolic):
    loose = shared(FL_hip="0.1 # here\n    + late*cmd.yaw\n  - t", RR_calf="-1.5 + 0.3*(q.RR_hip)")
    return (
        mirrored_text("1 0"),
        mirrored_text("0 1"),
        symbolic.to_text(),
        f"{HEAD}definitions\nlate = tanh(t)  # note\n\nevery state\n{loose}",
    )


@pytest.mark.parametrize("part", range(5))
def test_damaged_files_are_refused_with_the_place_or_work(part, whole_texts, samples, tmp_path):
    path, observation = tmp_path / f"policy{SUFFIX}", samples(3)[0]
    for seed in range(100 * part, 100 * part + 100):
        text = damaged(whole_texts[seed % len(whole_texts)], np.random.default_rng(seed))
        path.write_text(text)
        try:
            policy_of(text)
        except InputError as error:
            reported, lines = str(error), text.splitlines()
            place = PLACE.match(reported)
            assert place, (seed, reported)
            assert 1 <= int(place[1]) <= len(lines) + 1, (seed, reported)
            assert 1 <= int(place[2]) <= 1 + max(map(len, lines)), (seed, reported)
            assert "\n" not in reported
            assert len(reported) < 500
            with pytest.raises(InputError) as refused:
                load_policy(path)
            assert str(refused.value) == f"{path}: {reported}"
        else:
            assert load_policy(path)(observation).shape == (3, 12)


def test_a_refusal_is_short_where_there_are_many_names():
    names = "".join(f"{'speed' * 6}{i} = {i}*cmd.v\n" for i in range(MAX_DEFINITIONS))
    reported = refusal(f"{HEAD}definitions\n{names}every state\n{shared(FL_hip='speed')}")
    assert len(reported) < 500


@pytest.mark.parametrize("text", [f"gait:{' ' * 1500}\n  x", f"gait: a{' ' * 30_000}b"])
def test_spaces_take_no_time(text):
    start = time.process_time()
    refusal(text)
    assert time.process_time() - start < 2.0


EVERY = f"every state\n{shared()}"
ONE_EACH = f"state 0\n{shared()}state 1\n{shared()}"


@pytest.mark.parametrize(
    ("text", "line", "reported"),
    [
        ("", 1, "without a formula"),
        (HEAD, 3, "without a formula of FL_hip"),
        (f"gait: trot\nstates: 2\n{EVERY}", 3, "lacks 'format'"),
        (f"format: 1\nstates: 2\n{EVERY}", 3, "lacks 'gait'"),
        (f"format: 1\ngait:\nstates: 2\n{EVERY}", 4, "lacks 'gait'"),
        (f"format: 1\ngait: trot\n{EVERY}", 3, "lacks 'states'"),
        (f"format: 2\ngait: trot\nstates: 2\n{EVERY}", 1, "is of format '2', not 1"),
        (f"{HEAD}gait: trot\n{EVERY}", 4, "'gait' is said twice"),
        (f"format: 1\ngait: trot\nstates: 0\n{EVERY}", 3, "from 1 to 32"),
        (f"format: 1\ngait: trot\nstates: 33\n{EVERY}", 3, "from 1 to 32"),
        (f"format: 1\ngait: trot\nstates: two\n{EVERY}", 3, "from 1 to 32"),
        (f"{HEAD}mirror: 1\n{EVERY}", 4, "mirror: must name"),
        (f"{HEAD}mirror: 1 1\n{EVERY}", 4, "mirror: must name"),
        (f"{HEAD}mirror: 2 1\n{EVERY}", 4, "mirror: must name"),
        (f"{HEAD}mirror:\n{EVERY}", 4, "mirror: must name"),
        (f"{HEAD}targets: free\n{EVERY}", 4, "targets: must be 'limited', or be left out"),
        (f"{HEAD}targets:\n{EVERY}", 4, "targets: must be 'limited'"),
        (f"{HEAD}kind: symbolic\n{EVERY}", 4, "'kind: symbolic' is no line"),
        (f"{HEAD}FL_hip = 0.1\n", 4, "stands under 'state 0'"),
        (f"{HEAD}{EVERY}gait: pace\n", 17, "no line of a formula file"),
        (f"{HEAD}{EVERY}definitions\n", 17, "'definitions' stands too late"),
        (f"{HEAD}{EVERY}state 0\n", 17, "not both"),
        (f"{HEAD}{EVERY}FL_hip = 0.2\n", 17, "FL_hip has a formula above"),
        (f"{HEAD}{EVERY}FL_foot = 0.2\n", 17, "'FL_foot' is no joint; the joints are FL_hip"),
        (f"{HEAD}{ONE_EACH}state 2\n", 30, "there are states 0 to 1"),
        (f"{HEAD}{ONE_EACH}every state\n", 30, "not both"),
        (f"{HEAD}state 0\n{shared()}", 16, "without a formula of FL_hip in state 1"),
        (f"{HEAD}{EVERY.replace('RL_calf', '#')}", 16, "without a formula of RL_calf"),
        (f"  {HEAD}{EVERY}", 1, "do not indent"),
        (f"{HEAD}definitions\nt = 2\n{EVERY}", 5, "'t' cannot be defined"),
        (f"{HEAD}definitions\nFL_hip = 2\n{EVERY}", 5, "'FL_hip' cannot be defined"),
        (f"{HEAD}definitions\na = t\na = t\n{EVERY}", 6, "'a' cannot be defined"),
        (f"{HEAD}definitions\nlate = t\nb = late\n{EVERY}", 6, "nothing is called 'late'"),
    ],
)
def test_what_is_no_formula_file_is_refused_with_its_line(text, line, reported):
    message = refusal(text)
    assert message.startswith(f"line {line}, ")
    assert reported in message


@pytest.mark.parametrize("formula", ["foo", "t +", "", "t, t", "1 +\n    (t", "0.1\n    + foo"])
def test_a_formula_that_cannot_be_read_is_refused_with_its_own_line(formula):
    text = f"{HEAD}# a comment\n\nevery state\n{shared(RL_hip=formula)}"
    place = PLACE.match(refusal(text))
    assert 13 <= int(place[1]) <= 13 + formula.count("\n")


@pytest.mark.parametrize("title", ["every state", "definitions", "gait: trot"])
def test_a_line_that_goes_on_after_a_title_is_no_comment(title):
    text = f"{HEAD}definitions\nlate = t\n{EVERY}".replace(title, f"{title}  # so\n    FL_hip = t")
    refusal(text)


@pytest.mark.parametrize(
    ("line", "header"),
    [
        (1, "format: 2\ngait: trot\nstates: 2\n"),
        (3, "format: 1\ngait: trot\nstates: 99\n"),
        (4, HEAD + "mirror: 5 5\n"),
        (5, HEAD + "mirror: 1 0\ntargets: limit\n"),
    ],
)
def test_what_is_wrong_in_a_header_is_named_by_its_line(line, header):
    assert refusal(f"{header}\n\nevery state\n{shared()}").startswith(f"line {line}, column 1: ")

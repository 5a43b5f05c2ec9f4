"""Controllers in C, of one gait and of several: they do what Python does."""

import hashlib
import re
from collections.abc import Callable, Iterable
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from glassgait.models.errors import InputError
from glassgait.models.export.binding import (
    ACTION,
    BAD_INPUT,
    MACHINE,
    NO_NUMBER,
    ODOMETRY,
    OK,
    UNCHANGED,
    LoadedController,
    Sensors,
    unpacked_odometry,
)
from glassgait.models.export.controller import (
    ControllerSource,
    gait_identifiers,
    write_controller,
)
from glassgait.models.export.language import CArray, commented, is_identifier, number
from glassgait.models.export.reference import PythonController
from glassgait.models.export.reward_machine import cases, state_constants
from glassgait.models.formulas.reader import read_formulas
from glassgait.models.policies.controller import alone
from glassgait.models.policies.library import load_expert, load_student
from glassgait.models.policies.linear import StatewiseLinearPolicy
from glassgait.models.policies.neural import NeuralPolicy
from glassgait.models.policies.open_loop import OpenLoopPolicy
from glassgait.models.policies.switched import SwitchedPolicy
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.models.robots import quadruped
from glassgait.models.robots.joint_law import JointLaw
from glassgait.models.robots.library import load_robot
from glassgait.models.task.contact import UNCHANGED_STEPS
from glassgait.models.task.gait import gait_names, load_gait, parse_gait
from glassgait.models.task.gait_switch import GaitSwitch
from glassgait.models.task.observation import ObservationLayout
from glassgait.studies.export.agreement import (
    Agreement,
    compare_controllers,
    random_sequences,
)
from glassgait.studies.export.files import has_compiler, load_controller

A1 = load_robot()


NAMES = ObservationLayout(2).names

WRITTEN = {"name": "tested", "policy_name": "tested", "version": "0"}

needs_compiler = pytest.mark.skipif(not has_compiler(), reason="needs a C compiler, cc")

ODD = """
description: a /* b */ c \\
max_speed: 0.5
max_yaw_rate: 0.5
dwell: [1, 3]
clearance: 0.001
states: [a b, double, "3"]
initial: double
transitions:
  - {from: double, to: a b, when: (FL | FR) & ~(RL & RR), dwell: 0.5}
  - {from: a b, to: "3", when: RL | RR | ~FL, grace: 5}
  - {from: "3", to: double, when: FL & FR | RL & ~RR, dwell: 0}
"""


@pytest.fixture
def agree(tmp_path) -> Callable[..., Agreement]:
    """Lets Python and C take some hundred steps of random sensors."""

    def run(gait, policy, expert, real="double", n_steps=400) -> Agreement:
        controller = alone(policy, expert)
        names = {"name": "tested", "policy_name": policy.kind, "version": "0"}
        written = write_controller(gait, controller, real=real, **names)
        compiled: LoadedController = load_controller(written, tmp_path)
        python = PythonController(gait, controller)
        return compare_controllers(python, compiled, random_sequences(A1, gait, n_steps, 3))

    return run


KINDS = (
    "linear statewise_linear open_loop neural mirrored symbolic statewise_symbolic "
    "symbolic_with_readings trees "
    "rounded_trees additive additive_without_pairs"
)


@needs_compiler
@pytest.mark.parametrize("kind", KINDS.split())
def test_c_does_what_python_does(
    kind,
    trot,
    generator,
    small_expert,
    agree,
    make_policy,
    statewise,
    open_loop,
    symbolic,
    statewise_symbolic,
    random_trees,
    narrow_readings,
    random_additive,
):
    policies = {
        "linear": lambda: make_policy(trot),
        "statewise_linear": lambda: StatewiseLinearPolicy(
            "trot", NAMES, 0.05 * statewise.weights, statewise.intercepts
        ),
        "open_loop": lambda: open_loop,
        "neural": lambda: small_expert(trot, hidden=(8, 5, 4)),
        "mirrored": lambda: small_expert(trot, mirrored=True),
        "symbolic_with_readings": lambda: symbolic.with_readings(narrow_readings),
        "symbolic": lambda: symbolic,
        "statewise_symbolic": lambda: statewise_symbolic,
        "trees": lambda: random_trees(generator, rounded=False),
        "rounded_trees": lambda: random_trees(generator, rounded=True),
        "additive": lambda: random_additive(generator, n_pairs=40),
        "additive_without_pairs": lambda: random_additive(generator, n_pairs=0),
    }
    expert = small_expert(
        trot, mirrored=kind == "mirrored", hidden=() if kind == "linear" else (8,)
    )
    found = agree(trot, policies[kind](), expert)
    assert found.steps == 400
    assert found.machine == 0
    assert found.target < 1e-12
    assert found.changes > 0


@needs_compiler
@pytest.mark.parametrize(
    "ranges",
    [
        pytest.param(
            "q: calf -2 to -1.2, thigh 0.5 to 0.9, hip -0.1 to 0.2", marks=pytest.mark.slow
        ),
        "q: hip -0.1 to 0.2",
        pytest.param("h: 0 to 0.01", marks=pytest.mark.slow),
        "cmd: v -0.2 to 0.2\ng: y -0.1 to 0.1\nv: x -0.1 to 0.3",
        pytest.param("", marks=pytest.mark.slow),
    ],
)
def test_c_reads_within_whichever_ranges_there_are(trot, ranges, agree):
    text = load_student("trot", "sparse_formula").to_text()
    before, rest = text.split("readings\n")
    _, after = rest.split("\n\n", maxsplit=1)
    policy = FormulaPolicy.from_file(read_formulas(f"{before}readings\n{ranges}\n\n{after}"))
    found = agree(trot, policy, load_expert("trot"), n_steps=60)
    assert found.machine == 0
    assert found.target < 1e-12


@needs_compiler
@pytest.mark.parametrize("kind", ["limited", "free", "limited by its expert"])
def test_targets_stay_within_the_joints_ranges_where_the_policy_is_run_so(
    kind, trot, small_expert, make_policy, symbolic, tmp_path
):
    expert = small_expert(trot)
    if kind == "limited by its expert":
        expert = NeuralPolicy("trot", NAMES, *expert._networks.values())
        expert = expert.with_joint_law(JointLaw(limited=True))
    policy = symbolic if kind == "limited" else make_policy(trot)
    policy.joint_law = JointLaw(limited=kind == "limited")
    controller = alone(policy, expert)
    written = write_controller(trot, controller, **WRITTEN)
    assert written.joint_law.limited is (kind != "free")
    compiled, python = load_controller(written, tmp_path), PythonController(trot, controller)
    sensors, command, *_ = random_sequences(A1, trot, 1, 3)[0][0]
    memory = compiled.initial()
    memory[ACTION] = np.tile([-50.0, 50.0], 6)
    # A bad input holds the targets of the action before.
    broken = Sensors(np.full(12, np.nan), sensors.joint_velocity, sensors.touching)
    held = compiled.step(memory, broken, command).targets
    wanted = A1.joint_targets(memory[ACTION], limited=kind != "free")
    np.testing.assert_array_equal(held, wanted)
    acted = python.step(memory, sensors, command).targets
    np.testing.assert_allclose(compiled.step(memory, sensors, command).targets, acted, atol=1e-12)
    within = (acted >= A1.lower_limits) & (acted <= A1.upper_limits)
    assert within.all() or kind == "free"


@needs_compiler
@pytest.mark.parametrize(
    "name",
    [
        *(
            pytest.param(name, marks=() if name == "half_bound" else pytest.mark.slow)
            for name in gait_names()
        ),
        "odd",
    ],
)
def test_machines_of_all_gaits_agree(name, agree, make_policy, small_expert):
    gait = parse_gait(ODD, name="odd */ gait") if name == "odd" else load_gait(name)
    found = agree(gait, make_policy(gait), small_expert(gait), n_steps=1000)
    assert found.machine == 0
    assert found.changes > 3
    assert found.target < 1e-12


@needs_compiler
def test_faults_are_entered_and_left_alike(make_policy, small_expert, tmp_path):
    """The wrong rear foot of a half-bound leads to a fault, and the front feet out of it."""
    gait = load_gait("half_bound")
    controller = alone(make_policy(gait), small_expert(gait))
    compiled = load_controller(write_controller(gait, controller, **WRITTEN), tmp_path)
    python = PythonController(gait, controller)
    ours, theirs, visited = python.initial(), compiled.initial(), []
    for sequence in random_sequences(A1, gait, 2000, 5):
        for moment in sequence:
            ours = python.step(ours, *moment).memory
            theirs = compiled.step(theirs, *moment).memory
            np.testing.assert_array_equal(theirs[MACHINE], ours[MACHINE])
            visited.append(gait.states[int(ours[MACHINE][0])])
    for fault in gait.faults:
        left = [b for a, b in pairwise(visited) if a == fault != b]
        assert fault in visited
        assert set(left) == {"q1" if fault == "missed_right" else "q3"}


FORMULAS = """format: 1
gait: trot
states: 2

definitions
double = t/cmd.t    # a word of C's own */ int x; /* ??/
state = s0 - s1
tanh.x = exp(-q.FL_hip**2) + abs(v.y)
q.mean = q.FL_hip/3 + sqrt(2 + cmd.v)
late = log(3 + t)
late.FL = cos(h.FL)
unused = 1/0

every state
"""


@needs_compiler
def test_definitions_may_have_names_that_c_has_other_uses_for(trot, agree, small_expert):
    terms = "0.1*double - -0.2*state + 2*tanh.x - (q.mean - 1)/(late - 7)/2 + late.FL**3*-1"
    text = FORMULAS + "\n".join(
        f"{joint} = {i} - {terms}" for i, joint in enumerate(quadruped.JOINTS)
    )
    policy = FormulaPolicy.from_file(read_formulas(text))
    found = agree(trot, policy, small_expert(trot))
    assert found.target < 1e-12
    assert found.machine == 0


def mirrored_formulas(gait: str, states: str) -> str:
    """Formulas that treat left and right alike, of which the file holds one half."""
    begin = f"format: 1\ngait: {gait}\nstates: 2\nmirror: {states}\n\ndefinitions\n"
    return begin + "reach = v.y*t\n"


def some_formulas(joints: Iterable[str]) -> str:
    return "".join(
        f"{joint} = {i} - q.{joint}*cmd.yaw + 0.1*reach + h.FL - dq.RR_hip + 0.1*s0*a.{joint}\n"
        for i, joint in enumerate(joints)
    )


LEFT = [joint for joint in quadruped.JOINTS if joint[1] == "L"]


@needs_compiler
@pytest.mark.parametrize(
    ("text", "n_written"),
    [
        (mirrored_formulas("trot", "1 0") + f"\nstate 0\n{some_formulas(quadruped.JOINTS)}", 12),
        (
            mirrored_formulas("bound", "0 1")
            + "".join(f"\nstate {n}\n{some_formulas(LEFT[:: 1 - 2 * n])}" for n in range(2)),
            12,
        ),
        (mirrored_formulas("trot", "1 0") + f"\nevery state\n{some_formulas(LEFT)}", 6),
        (
            mirrored_formulas("trot", "1 0")
            + f"\nstate 0\n{some_formulas(quadruped.JOINTS)}\nstate 1\nRL_calf = -1.2 + reach\n",
            13,
        ),
    ],
    ids=["states exchanged", "states their own images", "every state", "one formula of its own"],
)
def test_what_is_left_out_acts_in_the_mirror(text, n_written, agree, small_expert):
    policy = FormulaPolicy.from_file(read_formulas(text))
    gait = load_gait(policy.gait)
    controller = alone(policy, small_expert(gait))
    source = write_controller(gait, controller, **WRITTEN).source
    assert len(re.findall(r" target\[\w+_\w+\] =", source)) == n_written
    found = agree(gait, policy, small_expert(gait))
    assert found.target < 1e-12
    assert found.changes > 0


@needs_compiler
def test_contact_sensors_that_are_stuck_are_believed_by_neither(trot, compiled_page):
    controller = alone(load_student("trot", "sparse_formula"), load_expert("trot"))
    pair = PythonController(trot, controller), compiled_page
    (moments, *_) = random_sequences(A1, trot, 200, 3)
    stuck = [
        moment._replace(
            sensors=replace(
                moment.sensors,
                touching=np.concatenate([[True, False], moment.sensors.touching[2:]]),
            )
        )
        for moment in moments
    ]
    found = compare_controllers(*pair, [stuck])
    assert found.machine == 0
    assert found.target < 1e-12
    memory, disbelieved = pair[0].initial(), 0
    for moment in stuck:
        memory = pair[0].step(memory, *moment).memory
        touching = unpacked_odometry(memory[ODOMETRY])[1].touching
        disbelieved += not np.array_equal(touching[:2], [True, False])
    assert memory[UNCHANGED].tolist()[:2] == [UNCHANGED_STEPS] * 2
    assert disbelieved > 0


@needs_compiler
def test_single_precision_is_near(trot, agree, small_expert, make_policy):
    found = agree(trot, make_policy(trot), small_expert(trot), real="float", n_steps=100)
    assert 0.0 < found.target < 1e-3


def test_formulas_stand_there_as_in_their_file(written_page):
    source = " ".join(written_page.source.split())
    text = load_student("trot", "sparse_formula").to_text()
    for joint in quadruped.JOINTS:
        (formula,) = re.findall(rf"^{joint} = (.*(?:\n    .*)*)", text, flags=re.MULTILINE)
        assert f"target[{joint.upper()}] = {' '.join(formula.split())};" in source
        # Those of the other state are the mirror images of these, and stand nowhere.
        assert source.count(f"target[{joint.upper()}] =") == 1
    assert "const double late = tanh(0.5*t - 2.0);" in source
    assert "now->contact[FL] && now->contact[RR] && !now->contact[FR]" in source
    assert "now->height[FR] >= CLEARANCE" in source


@pytest.fixture(scope="module")
def written_by_a_short_name() -> ControllerSource:
    names = {"name": "trot_page", "policy_name": "page", "version": "0"}
    controller = alone(load_student("trot", "sparse_formula"), load_expert("trot"))
    return write_controller(load_gait("trot"), controller, **names)


def test_a_gait_alone_has_the_file_that_it_always_had(written_by_a_short_name):
    """What is shared with files of several gaits must not show in those that robots run already.

    Whoever changes what a file holds, and means to, changes these digits too.
    """
    written = written_by_a_short_name
    whole = (written.header + written.source).encode()
    message = "0072c426a698d0ac22a0cd4b06065a4d2c3b519c1d06472b717096f478f8fc2d"
    assert hashlib.sha256(whole).hexdigest() == message


def test_no_line_before_the_numbers_is_long(
    written_by_a_short_name, written_pages, trot, symbolic, learned_expert
):
    small = write_controller(trot, alone(symbolic, learned_expert), **WRITTEN)
    counts = []
    for written in (written_by_a_short_name, written_pages, small):
        readable = written.source.partition("/* ---- The numbers")[0].splitlines()
        assert max(map(len, [*readable, *written.header.splitlines()])) <= 100
        counts.append(len(readable))
    # A page of 400 terms and its odometry are most of its file.
    assert counts[0] < 865
    assert counts[2] < 510


@pytest.mark.parametrize("names", [("trot",), ("trot", "walk")])
def test_the_header_reports_what_the_file_was_made_of(names, make_policy, small_expert):
    gaits = [load_gait(name) for name in names]
    own = [(make_policy(gait), small_expert(gait)) for gait in gaits]
    controllers = [alone(*pair) for pair in own]
    gait, controller = gaits[0], controllers[0]
    if len(gaits) > 1:
        gait = GaitSwitch(gaits)
        controller = alone(SwitchedPolicy(gait, controllers))
    written = write_controller(gait, controller, **WRITTEN)
    for one in (*gaits, *(policy for pair in own for policy in pair)):
        assert one.digest() in written.header
        assert one.digest() in written.source
    assert written.n_states == tuple(own.n_states for own in gaits)


@pytest.mark.parametrize("name", ["", "Trot", "9lives", "a-b", "for", "trot\n", "x" * 41, "é"])
def test_names_that_c_cannot_have_are_refused(name, trot, make_policy, small_expert):
    with pytest.raises(InputError, match="name"):
        write_controller(
            trot, alone(make_policy(trot), small_expert(trot)), **(WRITTEN | {"name": name})
        )


def test_a_policy_of_another_gait_is_refused(trot, make_policy, small_expert):
    pace = load_gait("pace")
    for policy, expert in [
        (make_policy(pace), small_expert(trot)),
        (make_policy(trot), small_expert(pace)),
    ]:
        with pytest.raises(InputError, match="pace"):
            write_controller(trot, alone(policy, expert), **WRITTEN)


def test_what_a_person_wrote_cannot_end_a_comment():
    assert commented("a */ b\n/* c ??/ é") == "a * / b / * c ? ?/ ?"


@pytest.mark.parametrize(
    ("value", "double", "single"),
    [
        (2.0, "2.0", "2.0f"),
        (-0.1, "-0.1", "-0.1f"),
        (1e30, "1e+30", "1e+30f"),
        (1e-60, "1e-60", "0.0f"),
        (1 / 3, "0.3333333333333333", "0.3333333333333333f"),
    ],
)
def test_numbers_are_written_in_full(value, double, single):
    assert (number(value, "double"), number(value, "float")) == (double, single)
    assert float(double) == value


def test_arrays_are_as_narrow_as_they_may_be():
    halves = CArray.of_reals("A", np.array([[0.5, np.inf]]), "double", "")
    assert halves.declaration == "static const float A[1][2]"
    assert halves.definition.splitlines()[1:-1] == ["{", "0.5f, INFINITY,", "},"]
    assert CArray.of_reals("A", np.array([0.1]), "double", "").type == "double"
    assert CArray.of_indices("A", np.array([256]), "").type == "unsigned short"


def test_identifiers_are_those_of_c():
    assert is_identifier("late")
    assert not any(map(is_identifier, ["", "for", "a b", "2a", "é", "_x"]))


def test_states_have_names_where_c_can_have_them():
    assert state_constants(load_gait("half_bound"))[-1] == "STATE_MISSED_LEFT"
    odd = parse_gait(ODD, name="odd")
    assert state_constants(odd) == ("STATE_0", "STATE_1", "STATE_2")
    (formula, condition, target), *_ = cases(odd, "double")[0].exits
    assert formula == "RL | RR | ~FL"
    feet = "((now->contact[RL] || now->contact[RR]) || !now->contact[FL])"
    assert condition == (feet, "&& now->spent >= now->dwell && now->age >= 5")
    assert target == "STATE_2"


@needs_compiler
def test_a_step_that_is_sound_says_so(compiled_page, trot):
    moment = random_sequences(A1, trot, 1, 0)[0][0]
    assert compiled_page.step(compiled_page.initial(), *moment).status == OK


@pytest.fixture
def switched(make_policy, small_expert):
    """Makes the policies of several gaits: small ones that move all joints."""

    def make(names, *, make_student=make_policy, patience=2.0, greatest_change=50.0):
        gaits = [load_gait(name) if isinstance(name, str) else name for name in names]
        walkers = [alone(make_student(gait), small_expert(gait)) for gait in gaits]
        return SwitchedPolicy(GaitSwitch(gaits, patience), walkers, greatest_change)

    return make


def both(policy, folder, **settings) -> tuple[PythonController, LoadedController]:
    own = (policy.switch, alone(policy))
    written = write_controller(*own, **WRITTEN, **settings)
    return PythonController(*own), load_controller(written, folder)


def tables_of(gait):
    """An open loop of its own for each gait: what C does with it is exact."""
    shape = (gait.n_states, 4, quadruped.N_JOINTS)
    table = np.random.default_rng(len(gait.name)).normal(size=shape)
    return OpenLoopPolicy(gait.name, ObservationLayout(gait.n_states).names, table)


@needs_compiler
@pytest.mark.parametrize(
    ("names", "patience"),
    [
        (("walk", "trot", "pace", "bound"), 2.0),
        (("half_bound", "three_one", "trot"), 1.5),
        (("trot", "walk"), 0.0),
    ],
)
def test_c_changes_gaits_as_python_does(names, patience, switched, tmp_path):
    policy = switched(names, patience=patience)
    sequences = random_sequences(A1, policy.switch, 1500, 3)
    found = compare_controllers(*both(policy, tmp_path), sequences)
    assert found.machine == 0
    assert found.target < 1e-12
    assert found.gaits is not None
    assert found.changes > found.gaits > 30


@needs_compiler
def test_a_bounded_action_is_the_same_to_the_last_bit(switched, tmp_path):
    policy = switched(("trot", "walk"), make_student=tables_of, greatest_change=5.0)
    python, compiled = both(policy, tmp_path)
    sequences = random_sequences(A1, policy.switch, 500, 4)
    assert compare_controllers(python, compiled, sequences).target == 0.0
    memory, bounded = python.initial(), 0
    for moment in sequences[0]:
        after = python.step(memory, *moment).memory
        change = np.sum(np.square(after[ACTION] - memory[ACTION]))
        assert change < 5.0 + 1e-9
        bounded += change > 5.0 - 1e-9
        memory = after
    assert bounded > 100


@needs_compiler
def test_an_action_is_bounded_from_the_target_that_joints_followed(switched, tmp_path):
    def far(gait):
        own = tables_of(gait)
        return OpenLoopPolicy(gait.name, own.observation_names, 6.0 * own.table)

    policy = switched(("trot", "walk"), make_student=far, greatest_change=5.0)
    policy = policy.with_joint_law(JointLaw(limited=True))
    python, compiled = both(policy, tmp_path)
    sequences = random_sequences(A1, policy.switch, 500, 4)
    assert compare_controllers(python, compiled, sequences).target < 1e-12
    memory, beyond = python.initial(), 0
    for moment in sequences[0]:
        after, last = python.step(memory, *moment).memory, A1.limited_action(memory[ACTION])
        assert np.sum(np.square(after[ACTION] - last)) < 5.0 + 1e-9
        beyond += np.sum(np.square(after[ACTION] - memory[ACTION])) > 5.0 + 1e-9
        memory = after
    assert beyond > 10


@needs_compiler
def test_single_precision_changes_gaits_at_the_same_steps(switched, tmp_path):
    policy = switched(("trot", "pace"))
    sequences = random_sequences(A1, policy.switch, 200, 5)
    found = compare_controllers(*both(policy, tmp_path, real="float"), sequences)
    assert found.machine == 0
    assert 0.0 < found.target < 1e-3


@needs_compiler
def test_kinds_of_policies_go_together(
    trot, switched, statewise_symbolic, random_trees, random_additive, small_expert, tmp_path
):
    """Each brings functions and tables, which must not have the names of another's."""
    generator = np.random.default_rng(6)
    own = [
        statewise_symbolic,
        random_trees(generator, rounded=True),
        random_additive(generator, n_pairs=40),
    ]
    gaits = [replace(trot, name=name) for name in ("formulas", "trees", "tables", "network")]
    for policy, gait in zip(own, gaits, strict=False):
        policy.gait = gait.name
    experts = [small_expert(gait, mirrored=gait.name == "network") for gait in gaits]
    walkers = [alone(policy, expert) for expert, policy in zip(experts, own, strict=False)]
    policy = SwitchedPolicy(GaitSwitch(gaits), [*walkers, alone(experts[-1])])
    sequences = random_sequences(A1, policy.switch, 600, 7)
    found = compare_controllers(*both(policy, tmp_path), sequences)
    assert found.machine == 0
    assert found.target < 1e-12


@needs_compiler
def test_gaits_may_have_names_that_c_cannot_have(trot, switched, tmp_path):
    names = ("my gait", "*/ int x; /*", "for")
    policy = switched([replace(trot, name=name) for name in names])
    assert gait_identifiers(policy.switch.gaits) == ["gait_0", "gait_1", "gait_2"]
    sequences = random_sequences(A1, policy.switch, 200, 8)
    assert compare_controllers(*both(policy, tmp_path), sequences).machine == 0


@needs_compiler
def test_a_request_for_no_gait_is_bad_input_and_changes_nothing(switched, tmp_path):
    policy = switched(("trot", "pace", "bound"))
    _, compiled = both(policy, tmp_path)
    *before, now = random_sequences(A1, policy.switch, 60, 9)[0]
    memory = compiled.initial()
    for moment in before:
        memory = compiled.step(memory, *moment).memory
    for requested in (NO_NUMBER, 3, 2**31 - 1, -(2**31)):
        step = compiled.step(memory, now.sensors, now.command, requested)
        assert step.status == BAD_INPUT
        np.testing.assert_array_equal(step.memory, memory)
        np.testing.assert_array_equal(step.targets, A1.joint_targets(memory[ACTION]))
    assert compiled.step(memory, *now).status == 0


@needs_compiler
def test_it_begins_in_the_first_gait_and_reports_the_running_one(switched, tmp_path):
    policy = switched(("walk", "trot", "half_bound"))
    _, compiled = both(policy, tmp_path)
    memory = compiled.initial()
    assert compiled.gait_of(memory) == 0
    for state in range(policy.switch.n_states):
        memory[MACHINE.start] = state
        assert compiled.gait_of(memory) == policy.switch.gait_of(state)


def defined(source):
    """Names of the functions that a C file defines."""
    return re.findall(r"^static \w+ (\w+)\(", source, flags=re.MULTILINE)


def test_what_gaits_share_stands_there_once(written_pages):
    functions = defined(written_pages.source)
    assert len(set(functions)) == len(functions)
    shared = {"observe", "all_sound", "estimate", "joints", "step_machine", "change_gait"}
    assert shared <= set(functions)
    for gait in ("walk", "trot", "bound"):
        own = {name for name in functions if name.startswith(f"{gait}_")}
        assert own == {f"{gait}_{name}" for name in ("act", "formulas", "next_state")}


def test_what_networks_share_stands_there_once(switched):
    policy = switched(("walk", "trot", "bound"))
    functions = defined(write_controller(policy.switch, alone(policy), **WRITTEN).source)
    assert len(set(functions)) == len(functions)
    assert {"observe", "all_sound", "elu", "step_machine", "change_gait"} <= set(functions)
    for gait in ("walk", "trot", "bound"):
        own = {name for name in functions if name.startswith(f"{gait}_")}
        layers = {f"{gait}_estimator_layer_{number}" for number in (1, 2)}
        assert own == {f"{gait}_{name}" for name in ("act", "estimate", "next_state")} | layers


def test_an_estimator_that_is_no_network_is_refused(trot, make_policy):
    class Estimating(type(make_policy(trot))):
        estimator = staticmethod(lambda own: np.zeros((*own.shape[:-1], 7)))

    policy = make_policy(trot)
    policy.__class__ = Estimating
    switched = SwitchedPolicy(GaitSwitch([trot]), [alone(policy)])
    with pytest.raises(InputError, match="estimator"):
        write_controller(switched.switch, alone(switched), **WRITTEN)

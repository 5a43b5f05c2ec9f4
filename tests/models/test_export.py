"""Exported C computes what Python computes, and names its gait and policies."""

import re
from collections.abc import Callable

import numpy as np
import pytest

from glassgait.models.control import Sensors
from glassgait.models.errors import InputError
from glassgait.models.estimation.odometry import Odometry
from glassgait.models.export.binding import (
    LoadedController,
    has_compiler,
    load_controller,
    write_source,
)
from glassgait.models.export.c_source import Interface, write_controller
from glassgait.models.export.contract import (
    CONTRACT,
    contract_of,
    contract_text,
    interface_of,
    read_contract,
)
from glassgait.models.formulas.quantities import Readings, RobotUnits
from glassgait.models.formulas.reader import read_formulas
from glassgait.models.policies.controller import alone
from glassgait.models.policies.library import load_student
from glassgait.models.policies.policy import Policy
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.models.robots import quadruped
from glassgait.models.robots.library import load_robot
from glassgait.models.robots.robot import JointLaw
from glassgait.models.task.gait import gait_names, load_gait, parse_gait
from glassgait.models.task.observation import ObservationLayout
from glassgait.studies.export.agreement import Agreement, compare_controllers, random_sequences

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
def narrow_readings():
    """Ranges of the paper's observation that are narrower than the observations in tests."""
    units = RobotUnits.of(load_robot(), NAMES)
    ends = (units.quantities(np.full(len(NAMES), end)) for end in (-0.4, 0.3))
    return Readings.around(NAMES, *ends)


@pytest.fixture
def agree(tmp_path) -> Callable[..., Agreement]:
    """Compares Python and C over some hundred steps with random sensors."""

    def run(gait, policy, expert=None, real="double", n_steps=200) -> Agreement:
        controller = alone(policy, expert)
        written = write_controller(gait, controller, real=real, **WRITTEN)
        compiled: LoadedController = load_controller(written, tmp_path)
        sequences = random_sequences(A1, gait, n_steps, 3)
        return compare_controllers(gait, controller, compiled, sequences)

    return run


KINDS = (
    "linear linear_per_state neural mirrored symbolic symbolic_per_state symbolic_with_readings "
    "trees rounded_trees additive additive_without_pairs"
)


@needs_compiler
@pytest.mark.parametrize("kind", KINDS.split())
def test_c_does_what_python_does(kind, request, trot, generator, small_expert, agree):
    fixture = request.getfixturevalue
    policies = {
        "linear": lambda: fixture("make_policy")(trot),
        "linear_per_state": lambda: fixture("per_state").with_arrays(
            weights=0.05 * fixture("per_state").weights
        ),
        "neural": lambda: small_expert(trot, hidden=(8, 5, 4)),
        "mirrored": lambda: small_expert(trot, mirrored=True),
        "symbolic_with_readings": lambda: fixture("symbolic").with_readings(
            fixture("narrow_readings")
        ),
        "symbolic": lambda: fixture("symbolic"),
        "symbolic_per_state": lambda: fixture("symbolic_per_state"),
        "trees": lambda: fixture("random_trees")(generator, rounded=False),
        "rounded_trees": lambda: fixture("random_trees")(generator, rounded=True),
        "additive": lambda: fixture("random_additive")(generator, n_pairs=40),
        "additive_without_pairs": lambda: fixture("random_additive")(generator, n_pairs=0),
    }
    hidden = () if kind == "linear" else (8,)
    expert = small_expert(trot, mirrored=kind == "mirrored", hidden=hidden)
    found = agree(trot, policies[kind](), expert)
    assert (found.steps, found.machine) == (200, 0)
    assert found.target < 1e-12
    assert found.changes > 0


@needs_compiler
@pytest.mark.parametrize("odometry", [Odometry(gain=0.3), None])
@pytest.mark.parametrize("mirrored", [True, False])
def test_c_with_an_imu_does_what_python_does(mirrored, odometry, trot, small_expert, agree):
    policy = small_expert(trot, mirrored=mirrored, imu=True, odometry=odometry)
    found = agree(trot, policy)
    assert found.machine == 0
    assert found.changes > 0
    assert found.target < 1e-12


@needs_compiler
@pytest.mark.parametrize("limited", [True, False])
def test_targets_stay_within_the_joints_ranges_if_the_policy_has_them_so(
    limited, trot, small_expert, make_policy, tmp_path
):
    law = JointLaw(((20.0, 20.0, 40.0) * 4, 0.5), limited=limited)
    controller = alone(make_policy(trot).with_joint_law(law), small_expert(trot))
    source = write_controller(trot, controller, **WRITTEN)
    assert "STIFFNESS_FL_CALF 40.0" in source.header
    compiled = load_controller(source, tmp_path)
    sensors, command, *_ = random_sequences(A1, trot, 1, 3)[0][0]
    memory = compiled.initial()
    memory["action"] = np.tile([-50.0, 50.0], 6)
    # After a bad input, the targets of the previous action stay.
    broken = Sensors(np.full(12, np.nan), sensors.joint_velocity, sensors.touching)
    held = compiled.step(memory, broken, command).targets
    np.testing.assert_array_equal(held, A1.joint_targets(memory["action"], limited=limited))


@needs_compiler
@pytest.mark.parametrize(
    "name",
    [
        *(
            pytest.param(name, marks=() if name == "half_bound" else pytest.mark.slow)
            for name in gait_names()
        ),
        "odd",
        "free",
    ],
)
def test_machines_of_all_gaits_agree(name, agree, make_policy, small_expert):
    gait = parse_gait(ODD, name="odd gait") if name == "odd" else load_gait(name)
    found = agree(gait, make_policy(gait), small_expert(gait), n_steps=4000)
    assert found.machine == 0
    assert found.changes > 3 or not gait.transitions
    assert found.target < 1e-12


FORMULAS = """format: 2
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


def mirrored_text(gait: str, states: list[int], *sections: str) -> str:
    header = f"format: 2\ngait: {gait}\nstates: 2\nmirror: {states}\n\ndefinitions\n"
    return header + "reach = v.y*t\n" + "".join(f"\n{section}" for section in sections)


def some_formulas(joints) -> str:
    return "".join(
        f"{joint} = {i} - q.{joint}*cmd.yaw + 0.1*reach + h.FL - dq.RR_hip + 0.1*s0*a.{joint}\n"
        for i, joint in enumerate(joints)
    )


LEFT = [joint for joint in quadruped.JOINTS if joint[1] == "L"]
ALL = some_formulas(quadruped.JOINTS)


@needs_compiler
@pytest.mark.parametrize(
    ("text", "n_written"),
    [
        (mirrored_text("trot", [1, 0], f"state 0\n{ALL}"), 12),
        (
            mirrored_text(
                "bound", "[0, 1]", *(f"state {n}\n{some_formulas(LEFT)}" for n in (0, 1))
            ),
            12,
        ),
        (mirrored_text("trot", [1, 0], f"every state\n{some_formulas(LEFT)}"), 6),
        (mirrored_text("trot", [1, 0], f"state 0\n{ALL}", "state 1\nRL_calf = -1.2 + reach\n"), 13),
    ],
    ids=["states exchanged", "states their own images", "every state", "one formula more"],
)
def test_formulas_that_are_left_out_act_in_the_mirror(text, n_written, agree, small_expert):
    policy = FormulaPolicy.from_file(read_formulas(text))
    gait = load_gait(policy.gait)
    source = write_controller(gait, alone(policy, small_expert(gait)), **WRITTEN).source
    assert len(re.findall(r" target\[\w+_\w+\] =", source)) == n_written
    found = agree(gait, policy, small_expert(gait))
    assert found.target < 1e-12
    assert found.changes > 0


@needs_compiler
def test_single_precision_is_near(trot, agree, small_expert, make_policy):
    found = agree(trot, make_policy(trot), small_expert(trot), real="float", n_steps=100)
    assert 0.0 < found.target < 1e-3


def test_formulas_stand_there_as_in_their_file(written_page):
    source = " ".join(written_page.source.split())
    text = load_student("trot", "formulas").to_text()
    for joint in quadruped.JOINTS:
        (formula,) = re.findall(rf"^{joint} = (.*(?:\n    .*)*)", text, flags=re.MULTILINE)
        assert f"target[{joint.upper()}] = {' '.join(formula.split())};" in source
        # The formulas of the other state are mirror images, and are not written.
        assert source.count(f"target[{joint.upper()}] =") == 1
    assert "now->contact[FL] && now->contact[RR] && !now->contact[FR]" in source
    assert not re.search("weight|elu|bias|layer|expm1|network|estimator_", source, re.I)
    assert max(map(len, written_page.source.splitlines())) <= 100


def test_both_files_name_what_they_were_made_of(trot, make_policy, small_expert):
    policy, expert = make_policy(trot), small_expert(trot)
    written = write_controller(trot, alone(policy, expert), **WRITTEN)
    for part in (trot, policy, expert):
        assert part.digest() in written.header
        assert part.digest() in written.source


@pytest.mark.parametrize("name", ["", "Trot", "9lives", "a-b", "for", "trot\n", "x" * 41, "é"])
def test_names_that_are_not_valid_in_c_are_refused(name, trot, make_policy, small_expert):
    controller = alone(make_policy(trot), small_expert(trot))
    with pytest.raises(InputError, match="name"):
        write_controller(trot, controller, **(WRITTEN | {"name": name}))


class Still(Policy):
    """A policy that always returns the default stance."""

    kind = "still"

    def act(self, observation):
        return np.zeros((*observation.shape[:-1], 12))


def test_policies_that_do_not_fit_are_refused(trot, make_policy, small_expert):
    pace = load_gait("pace")
    for policy, expert, said in [
        (make_policy(pace), small_expert(trot), "pace"),
        (make_policy(trot), small_expert(pace), "pace"),
        (Still("trot", NAMES), small_expert(trot), "there is no C for policies of kind 'still'"),
    ]:
        with pytest.raises(InputError, match=said):
            write_controller(trot, alone(policy, expert), **WRITTEN)


@needs_compiler
def test_another_library_is_refused(compiled_page, written_page, tmp_path):
    load_controller(written_page, tmp_path)
    other = Interface("another", "double", written_page.joint_law, True, True)
    with pytest.raises(InputError, match="is no controller 'another'"):
        LoadedController(tmp_path / f"{compiled_page.name}.so", other)
    with pytest.raises(InputError, match=r"missing\.so"):
        LoadedController(tmp_path / "missing.so", other)


@pytest.fixture
def contract_path(written_page, trot, tmp_path):
    """The contract of the trot's short formulas, beside their files."""
    controller = alone(load_student("trot", "formulas"))
    contract = contract_of(trot, controller, write_source(written_page, tmp_path), "formulas")
    path = tmp_path / CONTRACT
    path.write_text(contract_text(contract))
    return path


def test_a_contract_is_read_as_it_was_written(contract_path, written_page):
    contract = read_contract(contract_path)
    assert contract["joints"] == list(quadruped.JOINTS)
    assert contract["observations"][3]["offset"] == A1.default_stance[1]
    interface = interface_of(contract)
    assert interface.name == written_page.name
    assert interface.has_imu and interface.has_odometry
    assert interface.joint_law.gains == written_page.joint_law.gains_of(A1)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("version: 5", "version: 4", "version 5"),
        ("- FL_hip\n- FL_thigh", "- FL_thigh\n- FL_hip", "'digest' does not match"),
        ("limited: true\n", "", "'digest' does not match"),
        ("version: 5", "version: 5\nother: 1", "'digest' does not match"),
    ],
)
def test_a_contract_that_was_changed_is_refused(old, new, said, contract_path):
    text = contract_path.read_text()
    assert old in text
    contract_path.write_text(text.replace(old, new, 1))
    with pytest.raises(InputError, match=said):
        read_contract(contract_path)


@pytest.mark.parametrize(("ending", "key"), [("c", "file_digest"), ("h", "header_digest")])
def test_a_file_that_was_changed_is_refused(ending, key, contract_path):
    (file,) = contract_path.parent.glob(f"*.{ending}")
    file.write_text(file.read_text() + "\n")
    with pytest.raises(InputError, match=key):
        read_contract(contract_path)


def test_a_contract_of_another_robot_is_refused(contract_path):
    with pytest.raises(InputError, match="'robot' is 'a1', and the go2 has 'go2'"):
        read_contract(contract_path, load_robot("go2"))

"""Several gaits in one C file: it changes the gait where Python does, to the same action."""

import re
from dataclasses import replace

import numpy as np
import pytest

from glassgait.models.errors import InputError
from glassgait.models.export.binding import ACTION, BAD_INPUT, MACHINE, NO_GAIT, LoadedController
from glassgait.models.export.reference import PythonSwitchingController
from glassgait.models.export.switching_controller import (
    gait_identifiers,
    write_switching_controller,
)
from glassgait.models.policies.controller import alone
from glassgait.models.policies.open_loop import OpenLoopPolicy
from glassgait.models.policies.switched import SwitchedPolicy
from glassgait.models.robots import quadruped
from glassgait.models.robots.robot import load_robot
from glassgait.models.task.gait import load_gait
from glassgait.models.task.gait_switch import GaitSwitch
from glassgait.models.task.observation import ObservationLayout
from glassgait.studies.deployment.export.agreement import compare_controllers
from glassgait.studies.deployment.export.compiler import has_compiler, load_controller
from glassgait.studies.deployment.export.switching_agreement import random_switching_sequences

A1 = load_robot()


needs_compiler = pytest.mark.skipif(not has_compiler(), reason="needs a C compiler, cc")

WRITTEN = {"name": "tested", "policy_name": "tested", "version": "0"}


@pytest.fixture
def switched(make_policy, small_expert):
    """Makes the policies of several gaits: small ones that move all joints."""

    def make(names, *, make_student=make_policy, patience=2.0, greatest_change=50.0):
        gaits = [load_gait(name) if isinstance(name, str) else name for name in names]
        walkers = [alone(make_student(gait), small_expert(gait)) for gait in gaits]
        return SwitchedPolicy(GaitSwitch(gaits, patience), walkers, greatest_change)

    return make


def both(policy, folder, **settings) -> tuple[PythonSwitchingController, LoadedController]:
    written = write_switching_controller(policy, **WRITTEN, **settings)
    return PythonSwitchingController(policy), load_controller(written, folder)


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
    sequences = random_switching_sequences(A1, policy.switch, 1500, 3)
    found = compare_controllers(*both(policy, tmp_path), sequences)
    assert found.machine == 0
    assert found.target < 1e-12
    assert found.gaits is not None
    assert found.changes > found.gaits > 30


@needs_compiler
def test_a_bounded_action_is_the_same_to_the_last_bit(switched, tmp_path):
    policy = switched(("trot", "walk"), make_student=tables_of, greatest_change=5.0)
    python, compiled = both(policy, tmp_path)
    sequences = random_switching_sequences(A1, policy.switch, 500, 4)
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
def test_single_precision_changes_gaits_at_the_same_steps(switched, tmp_path):
    policy = switched(("trot", "pace"))
    sequences = random_switching_sequences(A1, policy.switch, 200, 5)
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
    sequences = random_switching_sequences(A1, policy.switch, 600, 7)
    found = compare_controllers(*both(policy, tmp_path), sequences)
    assert found.machine == 0
    assert found.target < 1e-12


@needs_compiler
def test_gaits_may_have_names_that_c_cannot_have(trot, switched, tmp_path):
    names = ("my gait", "*/ int x; /*", "for")
    policy = switched([replace(trot, name=name) for name in names])
    assert gait_identifiers(policy.switch.gaits) == ["gait_0", "gait_1", "gait_2"]
    sequences = random_switching_sequences(A1, policy.switch, 200, 8)
    assert compare_controllers(*both(policy, tmp_path), sequences).machine == 0


@needs_compiler
def test_a_request_for_no_gait_is_bad_input_and_changes_nothing(switched, tmp_path):
    policy = switched(("trot", "pace", "bound"))
    _, compiled = both(policy, tmp_path)
    *before, now = random_switching_sequences(A1, policy.switch, 60, 9)[0]
    memory = compiled.initial()
    for moment in before:
        memory = compiled.step(memory, *moment).memory
    for number in (NO_GAIT, 3, 2**31 - 1, -(2**31)):
        step = compiled.step(memory, now.sensors, now.command, number)
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
    shared = {"observe", "all_sound", "elu", "joints", "step_machine", "change_gait"}
    assert shared <= set(functions)
    for gait in ("walk", "trot", "bound"):
        own = {name for name in functions if name.startswith(f"{gait}_")}
        layers = {f"{gait}_estimator_layer_{number}" for number in (1, 2, 3)}
        assert own == {f"{gait}_{name}" for name in ("act", "estimate", "next_state")} | layers


def test_no_readable_line_is_long(written_pages):
    readable = written_pages.source.partition("/* ---- The numbers")[0]
    lines = [*readable.splitlines(), *written_pages.header.splitlines()]
    assert max(map(len, lines)) <= 100


def test_the_header_reports_what_the_file_was_made_of(switched):
    policy = switched(("trot", "walk"))
    written = write_switching_controller(policy, **WRITTEN)
    own = [*policy.switch.gaits, *policy.policies, *policy.experts]
    for digest in (one.digest() for one in own):
        assert digest in written.header
        assert digest in written.source
    assert written.n_states == (2, 4)


def test_an_estimator_that_is_no_network_is_refused(trot, make_policy, small_expert):
    class Estimating(type(make_policy(trot))):
        estimator = staticmethod(small_expert(trot).estimator)

    policy = make_policy(trot)
    policy.__class__ = Estimating
    switched = SwitchedPolicy(GaitSwitch([trot]), [alone(policy)])
    with pytest.raises(InputError, match="estimator"):
        write_switching_controller(switched, **WRITTEN)


def test_a_name_that_c_cannot_have_is_refused(switched):
    with pytest.raises(InputError, match="Two"):
        write_switching_controller(switched(("trot", "walk")), **(WRITTEN | {"name": "Two"}))

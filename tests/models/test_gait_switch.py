"""Several gaits in one machine: when one gives way, and where the other begins."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from glassgait.models.errors import InputError
from glassgait.models.task.formula import parse_formula, stance_code
from glassgait.models.task.gait import gait_names, load_gait
from glassgait.models.task.gait_switch import GaitSwitch
from glassgait.models.task.reward_machine import MachineState, RewardMachine

NAMES = ("walk", "trot", "pace", "bound")
DWELL = 6


@pytest.fixture(scope="module")
def switch():
    return GaitSwitch([load_gait(name) for name in NAMES])


def stance(text):
    """Reads which feet touch from their names."""
    return np.array([leg in text.split() for leg in ("FL", "FR", "RL", "RR")])


def machine_in(switch, state, iterations=DWELL - 1, age=50):
    index = switch.gait.states.index(state)
    return MachineState(*(np.array(value) for value in (index, iterations, age)))


def stepped(switch, machine, feet, requested, dwell=DWELL):
    contact = stance(feet)
    step = switch.step(
        machine,
        requested=np.array([gait.name for gait in switch.gaits].index(requested)),
        foot_contact=contact,
        foot_height=np.where(contact, 0.0, 0.05),
        commanded_dwell=dwell,
    )
    return switch.gait.states[int(step.machine.state)], step


def test_the_combined_gait_has_the_states_of_all_and_the_commands_that_all_are_made_for(switch):
    assert switch.gait.states[:5] == ("walk q0", "walk q1", "walk q2", "walk q3", "trot q0")
    assert (switch.n_states, switch.gait.initial) == (10, "walk q0")
    assert switch.gait_of(np.arange(10)).tolist() == [0] * 4 + [1] * 2 + [2] * 2 + [3] * 2
    assert (switch.gait.max_speed, switch.gait.dwell) == (0.5, (6, 11))


# The walk stands on three feet, so that one foot differs from any pair; no two pairs share both.
@pytest.mark.parametrize(
    ("state", "feet", "requested", "entered"),
    [
        ("walk q0", "FR RL RR", "trot", "trot q0"),
        ("walk q2", "FL RL RR", "trot", "trot q1"),
        ("walk q0", "FR RL RR", "pace", "pace q0"),
        ("walk q1", "FL FR RL", "bound", "bound q1"),
        ("trot q0", "FL RR", "walk", "walk q0"),
        ("trot q1", "FR RL", "walk", "walk q1"),
        ("pace q0", "FL RL", "trot", "trot q0"),
        ("bound q1", "RL RR", "walk", "walk q1"),
    ],
)
def test_a_gait_that_moves_on_gives_way_to_the_state_entered_from_the_nearest_stance(
    switch, state, feet, requested, entered
):
    found, step = stepped(switch, machine_in(switch, state), feet, requested)
    assert found == entered
    # The state that ended is paid; the new gait counts from its begin.
    assert (step.fired, step.multiplier, step.served_dwell) == (True, 1000, DWELL)
    assert (step.machine.iterations, step.machine.age) == (0, 0)


def test_a_gait_goes_on_until_it_moves_on(switch):
    for feet in ("FL RR", "FR RL", "FL FR RL RR", ""):
        early = machine_in(switch, "trot q0", iterations=2)
        found, step = stepped(switch, early, feet, "walk")
        assert (found, step.machine.iterations, step.machine.age) == ("trot q0", 3, 51)


def test_a_gait_that_is_not_asked_to_change_runs_as_its_own_machine(switch):
    found, step = stepped(switch, machine_in(switch, "trot q0"), "FL RR", "trot")
    assert (found, step.machine.age) == ("trot q1", 51)


def test_only_the_stances_nearest_to_the_new_gait_end_the_old_one():
    walk = load_gait("walk")
    # The trot's own stance ends one state of this walk, and the other stances wait for it.
    first, *others = walk.transitions
    near = replace(first, when=parse_formula("FR & RL & ~FL & ~RR"))
    switch = GaitSwitch([replace(walk, transitions=(near, *others)), load_gait("trot")])
    assert stepped(switch, machine_in(switch, "walk q1"), "FL FR RL", "trot")[0] == "walk q2"
    assert stepped(switch, machine_in(switch, "walk q0"), "FR RL", "trot")[0] == "trot q0"


def test_a_gait_that_lost_its_rhythm_is_waited_for_no_more(switch):
    for iterations, expected in ((2 * DWELL - 2, "trot q0"), (2 * DWELL - 1, "bound q1")):
        late = machine_in(switch, "trot q0", iterations=iterations)
        assert stepped(switch, late, "FL FR RR", "bound")[0] == expected


def test_without_patience_gaits_change_at_once():
    switch = GaitSwitch([load_gait("trot"), load_gait("pace")], patience=0.0)
    early = machine_in(switch, "trot q0", iterations=0)
    assert stepped(switch, early, "FL RL", "pace")[0] == "pace q1"
    fresh = machine_in(switch, "trot q0", iterations=0, age=0)
    assert stepped(switch, fresh, "FR RR", "pace")[0] == "trot q0"


def test_no_gait_begins_at_fault():
    switch = GaitSwitch([load_gait("trot"), load_gait("half_bound")])
    for code in range(16):
        contact = np.array([code >> i & 1 for i in range(4)], dtype=bool)
        feet = " ".join(np.array(["FL", "FR", "RL", "RR"])[contact])
        lost = machine_in(switch, "trot q0", iterations=99)
        assert "missed" not in stepped(switch, lost, feet, "half_bound")[0]


@settings(max_examples=40)
@given(st.sampled_from(gait_names()), st.integers(0, 2**32 - 1))
def test_one_gait_alone_runs_as_its_machine_does(name, seed):
    generator = np.random.default_rng(seed)
    switch, machine = GaitSwitch([load_gait(name)]), RewardMachine(load_gait(name))
    state, n = machine.initial((4,)), 4
    for _ in range(60):
        senses = {
            "foot_contact": generator.random((n, 4)) < 0.5,
            "foot_height": generator.uniform(0.0, 0.1, (n, 4)),
            "commanded_dwell": np.full(n, 6.0),
        }
        own, ours = machine.step(state, **senses), None
        ours = switch.step(state, requested=np.zeros(n, dtype=np.int64), **senses)
        for mine, theirs in zip(ours, own, strict=True):
            np.testing.assert_array_equal(mine, theirs)
        state = own.machine


@settings(max_examples=40)
@given(st.integers(0, 2**32 - 1))
def test_a_batch_is_its_robots_one_by_one_and_changes_where_it_may(seed):
    generator = np.random.default_rng(seed)
    switch = GaitSwitch([load_gait(name) for name in NAMES])
    n, dwell = 5, generator.integers(1, 4, 5).astype(float)
    batch = switch.machine.initial((n,))
    changes = 0
    for _ in range(80):
        senses = {
            "requested": generator.integers(0, 4, n),
            "foot_contact": generator.random((n, 4)) < 0.5,
            "foot_height": generator.uniform(0.0, 0.1, (n, 4)),
        }
        step = switch.step(batch, commanded_dwell=dwell, **senses)
        for i in range(n):
            alone = switch.step(
                MachineState(*(values[i] for values in batch)),
                commanded_dwell=dwell[i],
                **{name: values[i] for name, values in senses.items()},
            )
            assert [int(x) for x in alone.machine] == [int(x[i]) for x in step.machine]
        before, after = switch.gait_of(batch.state), switch.gait_of(step.machine.state)
        changed = before != after
        changes += int(changed.sum())
        np.testing.assert_array_equal(after[changed], senses["requested"][changed])
        overdue = batch.iterations + 1 >= 2.0 * dwell
        assert np.all((step.fired | overdue)[changed])
        assert not step.machine.iterations[changed].any()
        batch = step.machine
    assert changes > 0


def test_requests_of_no_gait_are_refused(switch):
    machine = machine_in(switch, "walk q0")
    senses = {"foot_contact": stance(""), "foot_height": np.zeros(4), "commanded_dwell": 6}
    for number in (-1, 4):
        with pytest.raises(ValueError, match="from 0 to 3"):
            switch.step(machine, requested=np.array(number), **senses)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({}, "each once"),
        ({"name": "hop", "dwell": (12, 13)}, "no dwell is in the range of all"),
        ({"name": "hop", "clearance": 0.05}, "different clearances"),
    ],
)
def test_gaits_that_do_not_go_together_are_refused(trot, change, message):
    with pytest.raises(InputError, match=message):
        GaitSwitch([trot, replace(trot, **change)])
    with pytest.raises(InputError, match="name one or more"):
        GaitSwitch([])


def test_the_state_entered_is_that_of_the_nearest_stance_for_every_stance(switch):
    """By counting feet, without the tables."""
    feet = [np.array([code >> i & 1 for i in range(4)], dtype=bool) for code in range(16)]
    for contact in feet:
        lost = machine_in(switch, "walk q0", iterations=99)
        step = switch.step(
            lost,
            requested=np.array(1),
            foot_contact=contact,
            foot_height=np.zeros(4),
            commanded_dwell=6,
        )
        away = [np.sum(contact != stance(enters)) for enters in ("FR RL", "FL RR")]
        assert switch.gait.states[int(step.machine.state)] == f"trot q{int(np.argmin(away))}", (
            stance_code(contact)
        )

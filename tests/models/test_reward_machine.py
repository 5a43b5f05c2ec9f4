"""The reward machine: its rules, and properties that hold for every gait."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from glassgait.models.task.gait import gait_names, load_gait
from glassgait.models.task.reward_machine import RewardMachine

FL_RR = np.array([True, False, False, True])
ALL = np.ones(4, dtype=bool)
LIFTED = 0.04


def heights(contact, lifted=LIFTED):
    return np.where(contact, 0.0, lifted)


def run(machine, contacts, dwell, difficulty=1.0, lifted=LIFTED):
    state, steps = machine.initial(), []
    for contact in contacts:
        step = machine.step(
            state,
            foot_contact=contact,
            foot_height=heights(contact, lifted),
            commanded_dwell=dwell,
            difficulty=difficulty,
        )
        steps.append(step)
        state = step.machine
    return steps


def test_leaves_state_only_after_the_commanded_dwell(trot):
    steps = run(RewardMachine(trot), [FL_RR] * 8, dwell=6)
    assert [bool(step.fired) for step in steps] == [False] * 5 + [True] + [False] * 2
    assert steps[5].machine.state == 1
    assert steps[5].machine.iterations == 0
    assert steps[5].multiplier == 1000
    assert steps[4].multiplier == 1


def test_swing_feet_must_clear_the_ground(trot):
    assert not any(step.fired for step in run(RewardMachine(trot), [FL_RR] * 20, 6, lifted=0.029))


def test_difficulty_scales_dwell_and_clearance(trot):
    steps = run(RewardMachine(trot), [FL_RR] * 4, dwell=10, difficulty=0.2, lifted=0.007)
    assert [bool(step.fired) for step in steps] == [False, True, False, False]


def test_a_sink_pays_nothing_and_is_never_left(unforgiving):
    machine = RewardMachine(unforgiving)
    sink = unforgiving.states.index("missed")
    steps = run(machine, [ALL] * 25, dwell=6)
    assert [int(step.machine.state) == sink for step in steps] == [False] * 20 + [True] * 5
    assert steps[20].multiplier == 0
    assert [bool(machine.in_sink(step.machine.state)) for step in steps[19:21]] == [False, True]
    assert steps[24].multiplier == 0


def test_neither_entering_nor_leaving_a_fault_is_paid_and_the_gait_goes_on(forgiving):
    machine = RewardMachine(forgiving)
    steps = run(machine, [ALL] * 27 + [FL_RR] * 6, dwell=6)
    fault = forgiving.states.index("missed")
    there = [int(step.machine.state) == fault for step in steps]
    assert there == [False] * 20 + [True] * 6 + [False] * 7
    assert [float(step.multiplier) for step in steps[19:28]] == [1.0] + [0.0] * 7 + [1.0]
    assert not any(machine.in_sink(step.machine.state) for step in steps)
    # Time in a fault state does not count as served dwell.
    assert [float(step.served_dwell) for step in steps] == [0.0] * 32 + [6.0]
    assert steps[-1].multiplier == 1000


@st.composite
def histories(draw):
    gait = draw(st.sampled_from(gait_names()))
    length = draw(st.integers(1, 60))
    codes = draw(st.lists(st.integers(0, 15), min_size=length, max_size=length))
    lifts = draw(st.lists(st.floats(0, 0.1), min_size=length, max_size=length))
    contacts = [np.array([code >> i & 1 for i in range(4)], dtype=bool) for code in codes]
    return gait, contacts, lifts, draw(st.integers(6, 11))


@given(histories())
def test_every_run_obeys_the_machine(history):
    name, contacts, lifts, dwell = history
    gait = load_gait(name)
    machine = RewardMachine(gait)
    edges = {
        (gait.states.index(t.source), gait.states.index(t.target)): t for t in gait.transitions
    }
    state = machine.initial()
    for age, (contact, lift) in enumerate(zip(contacts, lifts, strict=True)):
        step = machine.step(
            state, foot_contact=contact, foot_height=heights(contact, lift), commanded_dwell=dwell
        )
        after = step.machine
        assert after.age == age + 1
        served = 0.0
        if step.fired:
            edge = edges[int(state.state), int(after.state)]
            served = edge.dwell * dwell
            assert edge.when.table[int(contact @ [1, 2, 4, 8])]
            assert int(state.iterations) + 1 >= edge.dwell * dwell
            assert age >= edge.grace
            assert after.iterations == 0
        else:
            assert after.state == state.state
            assert after.iterations == state.iterations + 1
        at_fault = {gait.states[int(own.state)] for own in (state, after)} & {*gait.faults}
        assert float(step.multiplier) == (0 if at_fault else 1000 if step.fired else 1)
        assert float(step.served_dwell) == (0 if at_fault else served)
        state = after

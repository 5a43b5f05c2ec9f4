"""The studio without a browser: edits, terms, the live robot, messages and background work."""

import asyncio
import builtins
import json
import sys
import time
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import get_args

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from glassgait.diagrams.commands import FixedCommand
from glassgait.diagrams.scenario import Scenario, load_scenario
from glassgait.models.errors import InputError
from glassgait.models.policies.adjustable import AdjustablePolicy
from glassgait.models.policies.library import load_policy, load_student
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.models.robots import quadruped
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.gait import load_gait
from glassgait.models.task.observation import machine_state_entries
from glassgait.studies.cli import main
from glassgait.studies.common.policies import find_policies
from glassgait.studies.studio import background, live_robot
from glassgait.studies.studio.background import Work, counted, proved
from glassgait.studies.studio.messages import (
    Act,
    Choose,
    Coefficient,
    Evaluate,
    Gamepad,
    Ghost,
    Message,
    Number,
    Push,
    Steer,
    Surroundings,
    Switch,
    read_message,
)
from glassgait.studies.studio.session import EditSession
from glassgait.studies.studio.steered_robot import SteeredRobot, initial_command
from glassgait.studies.studio.studio import GAMEPAD_HOLDS, Studio
from glassgait.studies.studio.terms import GROUPS, Acting, TermReader, in_groups, open_texts
from glassgait.studies.studio.views import file_view, formula_view, frame, panel, setup, status

STANDING = Scenario(command=FixedCommand(0.0, 0.0, 8))


@pytest.fixture(scope="module")
def found():
    return find_policies(load_gait("trot"), quiet=True)


@pytest.fixture(scope="module")
def trot():
    return load_student("trot", "sparse_formula")


@pytest.fixture
def adjustable(trot):
    return AdjustablePolicy(trot)


@pytest.fixture
def session(adjustable, found):
    return EditSession(adjustable.numbered, found.file("sparse_formula").read_text())


@pytest.fixture
def studio(found, tmp_path):
    made = make_studio(found, tmp_path, "sparse_formula")
    yield made
    made.stop()


def make_studio(found, folder, name, **options):
    return Studio(
        found.gait,
        found.controller(name),
        STANDING,
        folder / "out",
        file=found.file(name),
        drawn=False,
        **options,
    )


def walk(studio, n_steps):
    """Advances as the thread does, without waiting for the clock."""
    robot = studio.robot
    robot._act()
    for _ in range(n_steps):
        robot._advance()
    return robot.latest()


# Edits.


def test_undo_restores_the_digits_of_the_file(session):
    before = session.written()
    for index in range(40, 60):
        session.change(index, 0.123456789 * (index + 1))
    session.switch(41, on=False)
    assert session.written() != before
    while session.can_undo:
        session.undo()
    assert session.written() == before == session.text
    assert not session.is_changed and session.diff() == ()
    while session.can_redo:
        session.redo()
    assert len(session.changed()) == 20


def test_what_is_dragged_is_one_change(session):
    session.change(27, 0.1)
    for value in (0.2, 0.3, 0.4):
        session.change(27, value, goes_on=True)
    assert session.numbers[27] == 0.4
    session.undo()
    assert session.numbers == session.numbered.start
    # Another number begins another change, whatever the message says.
    session.change(27, 0.1)
    session.change(28, 0.1, goes_on=True)
    session.undo()
    assert session.numbers[27] == 0.1


def test_a_drag_is_not_one_with_what_came_before_another_act(session):
    session.change(27, 0.1)
    session.change(27, 0.2)
    session.undo()
    session.change(27, 0.3, goes_on=True)
    session.undo()
    assert session.numbers[27] == 0.1
    session.switch(27, on=False)
    session.change(27, 0.4, goes_on=True)
    session.undo()
    assert session.version.off == {27: 0.1}
    session.undo()
    assert not session.version.off and session.numbers[27] == 0.1


def test_a_change_after_undo_drops_what_was_undone(session):
    session.change(27, 0.1)
    session.undo()
    session.change(28, 0.2)
    assert not session.can_redo


def test_a_term_that_is_off_keeps_its_number(session):
    start = session.numbers[27]
    session.switch(27, on=False)
    assert (session.numbers[27], session.shown(27)) == (0.0, start)
    session.change(27, 0.5)
    assert (session.numbers[27], session.shown(27)) == (0.0, 0.5)
    session.switch(27, on=True)
    assert session.numbers[27] == 0.5
    session.reset()
    assert session.numbers == session.numbered.start
    session.undo()
    assert session.numbers[27] == 0.5


def test_the_diff_shows_the_changed_line(session):
    session.change(27, 0.07)
    head, old, *_ = session.diff()
    new = next(line for line in session.diff() if line.startswith("+"))
    assert head.startswith("@@")
    assert old.startswith("-FL_hip = 0.324 - 0.0624*cmd.yaw")
    assert new.startswith("+FL_hip = 0.324 - 0.07*cmd.yaw")


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e31])
def test_numbers_that_no_file_holds_are_refused(session, value):
    with pytest.raises(InputError, match="give a smaller one"):
        session.change(27, value)
    with pytest.raises(InputError, match="is not in the file"):
        session.change(10_000, 1.0)


# Terms.


def test_terms_add_up_to_the_target_and_to_its_mirror_image(trot, adjustable):
    generator = np.random.default_rng(2)
    for place in ((0, 0), (0, 4), (0, 11)):
        reader = TermReader(adjustable, place)
        for state in (0, 1):
            observation = generator.normal(size=len(trot.observation_names))
            observation[machine_state_entries(trot.observation_names)] = np.eye(2)[state]
            (acting,) = reader.acting(state)
            values, _ = reader.evaluate(observation, mirrored=acting.mirrored)
            asked = reader.sign(mirrored=acting.mirrored) * values.sum()
            target = trot.robot.joint_targets(trot(observation))[acting.joint]
            assert asked == pytest.approx(target, abs=1e-12)


@pytest.mark.parametrize("gait", ["walk", "bound"])
def test_the_formulas_of_a_file_are_all_targets(gait):
    policy, machine = load_student(gait, "sparse_formula"), load_gait(gait)
    adjustable, names = AdjustablePolicy(policy), policy.observation_names
    observations = np.random.default_rng(4).normal(size=(machine.n_states, len(names)))
    observations[:, machine_state_entries(names)] = np.eye(machine.n_states)
    targets = policy.robot.joint_targets(policy(observations))
    asked = np.full_like(targets, np.nan)
    for place in adjustable.numbered.formulas:
        reader = TermReader(adjustable, place)
        for state, observation in enumerate(observations):
            for acting in reader.acting(state):
                values, _ = reader.evaluate(observation, mirrored=acting.mirrored)
                sum_of = reader.sign(mirrored=acting.mirrored) * values.sum()
                asked[state, acting.joint] = sum_of
    np.testing.assert_allclose(asked, targets, atol=1e-10)


def test_a_formula_acts_on_one_side_in_each_state(adjustable):
    reader = TermReader(adjustable, (0, 0))
    assert reader.acting(0) == (Acting(0, mirrored=False),)
    assert reader.acting(1) == (Acting(3, mirrored=True),)


def test_terms_are_grouped_by_their_last_factor(adjustable):
    reader = TermReader(adjustable, (0, 0))
    groups = {
        group: [" ".join(reader.terms[index].factors) for index in indices]
        for group, indices in in_groups(reader.terms)
    }
    assert list(groups) == [group for group in GROUPS if group in groups]
    assert groups["constant"] == [""]
    assert "cmd.yaw" in groups["command"] and "sent.FR_calf e.v" in groups["command"]
    assert groups["damping"] == ["sent.RL_calf dq.RL_thigh"]
    assert "sent.FL_calf sent.RR_hip" in groups["memory"]
    assert groups["rhythm"] == ["sent.FL_calf phase"]


def test_a_coefficient_is_changed_by_the_number_of_its_own(adjustable):
    reader = TermReader(adjustable, (0, 0))
    term = reader.terms[1]
    assert term.coefficient(adjustable.numbers) == -0.0624
    numbers = list(adjustable.numbers)
    numbers[term.own] = term.number_for(0.2, numbers)
    assert term.coefficient(numbers) == pytest.approx(0.2)
    assert all(own.own is not None for own in reader.terms)


def test_numbers_of_definitions_are_open(adjustable):
    texts = {symbol: text for symbol, text, _ in open_texts(adjustable.numbered)}
    assert texts["late"] == "tanh(⟦0⟧*t - ⟦1⟧)"
    assert "lifted.FR" not in texts


# The robot.


def test_an_edit_changes_the_gait_within_a_second(studio):
    walk(studio, 100)
    constant = studio.reader.terms[0]
    assert constant.group == "constant"
    before = studio.robot.latest(1)[0]
    np.testing.assert_array_equal(before.robot.state, before.ghost.state)
    studio.handle(Choose(place=1))
    studio.handle(Coefficient(term=0, value=0.8))
    moments = walk(studio, 50)[-40:]
    thigh = quadruped.joint_index("FL_thigh")
    robot, ghost = (
        np.mean([getattr(moment, own).joints[thigh] for moment in moments])
        for own in ("robot", "ghost")
    )
    assert abs(robot - ghost) > 0.02


def test_undo_brings_the_robots_policy_back(studio):
    studio.handle(Coefficient(term=0, value=0.8))
    walk(studio, 1)
    assert studio.adjustable.numbers != studio.adjustable.numbered.start
    studio.handle(Act(what="undo"))
    walk(studio, 1)
    assert studio.adjustable.numbers == studio.adjustable.numbered.start


def test_an_unedited_robot_and_its_ghost_go_the_same_way(studio):
    studio.handle(Push(angle=90.0, speed=0.5))
    moment = walk(studio, 60)[-1]
    np.testing.assert_array_equal(moment.robot.state, moment.ghost.state)


def test_a_push_to_the_left_moves_the_robot_to_the_left(studio):
    walk(studio, 60)
    before = studio.robot.latest(1)[0].robot.state[quadruped.POSITION][1]
    studio.handle(Push(angle=90.0, speed=1.0))
    after = walk(studio, 10)[-1].robot.state[quadruped.POSITION][1]
    assert after - before > 0.03


STICKS = {"left forward": (0.0, -1.0, 0.0, 0.0), "right to the right": (0.0, 0.0, 1.0, 0.0)}


def test_a_gamepad_commands_as_the_robots_remote_does(studio):
    gait = studio.gait
    for held, command in (
        ("left forward", (gait.max_speed, 0.0)),
        ("right to the right", (0.0, -gait.max_yaw_rate)),
    ):
        studio.handle(Gamepad(axes=STICKS[held]))
        walk(studio, 1)
        steering = studio.robot.steering
        assert (steering.speed, steering.yaw_rate) == pytest.approx(command)
        assert status(studio)["steering"]["speed"] == steering.speed
    dwell = studio.robot.steering.dwell
    assert dwell == initial_command(gait).dwell


@pytest.mark.parametrize("axes", [(), (0.0, 0.0, 0.0, 0.0), (0.05, -0.09, 0.09, 0.0)])
def test_a_gamepad_that_is_let_go_or_gone_stops_the_robot(studio, axes):
    studio.handle(Gamepad(axes=STICKS["left forward"]))
    walk(studio, 1)
    studio.handle(Gamepad(axes=axes))
    walk(studio, 1)
    assert (studio.robot.steering.speed, studio.robot.steering.yaw_rate) == (0.0, 0.0)


def test_a_gamepad_that_rests_leaves_the_sliders_command(studio):
    studio.handle(Steer(speed=0.4, yaw_rate=0.1, dwell=8.0))
    studio.handle(Gamepad(axes=(0.02, -0.03, 0.0, 0.0)))
    walk(studio, 1)
    assert studio.robot.steering == FixedCommand(0.4, 0.1, 8)


def test_a_gamepad_that_is_not_heard_of_any_more_stops_the_robot(studio):
    """Its browser may have been closed, or its machine may sleep."""
    now = [0.0]
    studio.robot._clock = lambda: now[0]
    studio.handle(Gamepad(axes=STICKS["left forward"]))
    walk(studio, 5)
    now[0] = GAMEPAD_HOLDS - 0.01
    walk(studio, 1)
    assert studio.robot.steering.speed == studio.gait.max_speed
    now[0] = GAMEPAD_HOLDS
    walk(studio, 1)
    assert studio.robot.steering == replace(initial_command(studio.gait), speed=0.0)
    studio.handle(Steer(speed=0.4, yaw_rate=0.0, dwell=8.0))
    now[0] = 100.0
    walk(studio, 1)
    assert studio.robot.steering.speed == 0.4


def test_commands_are_followed(studio):
    studio.handle(Steer(speed=0.8, yaw_rate=0.0, dwell=8.0))
    moments = walk(studio, 150)
    assert np.mean([moment.robot.speed for moment in moments[-50:]]) > 0.6


def test_a_robot_that_falls_begins_anew(studio):
    studio.handle(Push(angle=90.0, speed=3.0))
    studio.handle(Push(angle=90.0, speed=3.0))
    walk(studio, 200)
    assert studio.robot.count.falls == 1
    assert studio.robot.latest(1)[0].robot.step < 150


def test_robots_that_begin_anew_are_built_only_once(studio):
    robot = studio.robot
    first = [walk(studio, 5)[-1].robot.state]
    built = [*robot._robots]
    robot.restart()
    first.append(walk(studio, 5)[-1].robot.state)
    studio.handle(Ghost(walks=False))
    assert walk(studio, 1)[-1].ghost is None
    studio.handle(Ghost(walks=True))
    walk(studio, 1)
    assert all(own is before for own, before in zip(robot._robots, built, strict=True))
    np.testing.assert_array_equal(*first)


@pytest.mark.parametrize("name", ["sparse_formula", "expert"])
def test_a_steered_robot_that_begins_anew_goes_as_a_new_one(found, name):
    scenario = load_scenario("push_1.0")
    again, new = (
        SteeredRobot(found.gait, scenario, found.controller(name), seed=seed) for seed in (1, 2)
    )
    for steered in (again, new):
        steered.steer(initial_command(found.gait))
    for _ in range(30):
        again.advance()
    again.begin_anew(2)
    for _ in range(30):
        again.advance()
        new.advance()
    np.testing.assert_array_equal(again.sample().state, new.sample().state)
    np.testing.assert_array_equal(again.sample().observation, new.sample().observation)


def test_steps_that_are_asked_for_at_once_are_taken_one_by_one(studio):
    robot = studio.robot
    robot.pause(True)
    for _ in range(30):
        robot.step()
    studio.start()
    end = time.monotonic() + 60
    while len(robot.latest()) < 30 and time.monotonic() < end:
        time.sleep(0.02)
    studio.stop()
    moments = robot.latest()
    assert [moment.robot.step for moment in moments] == list(range(1, 31))
    assert [moment.number for moment in moments] == list(range(1, 31))
    assert robot.problem is None


def test_an_action_that_is_not_finite_halts_the_robot(studio, monkeypatch):
    # A division by zero: the share of a time of no length.
    def refused():
        raise InputError("not finite")

    with monkeypatch.context() as patched:
        patched.setattr(studio.robot._robots[0], "advance", refused)
        walk(studio, 1)
    assert studio.robot.paused and studio.robot.problem == "not finite"
    studio.handle(Act(what="go"))
    walk(studio, 5)
    assert not studio.robot.paused and studio.robot.problem is None


def test_surroundings_change(studio):
    studio.handle(Surroundings(slope=8.0, latency=0.021))
    walk(studio, 2)
    scenario = studio.robot.scenario
    assert scenario.station.terrain.slope == 8.0
    assert scenario.latency == pytest.approx(0.02)
    assert studio.robot.latest(1)[0].robot.step == 2


def test_as_many_surroundings_are_kept_as_may_be(studio, monkeypatch):
    monkeypatch.setattr(live_robot, "MOST_SCENARIOS", 3)
    for slope in (4.0, 8.0):
        studio.handle(Surroundings(slope=slope, latency=0.0))
    with pytest.raises(InputError, match="keeps 3 slopes and latencies"):
        studio.handle(Surroundings(slope=12.0, latency=0.0))
    studio.handle(Surroundings(slope=4.0, latency=0.0))
    walk(studio, 1)
    assert studio.robot.scenario.station.terrain.slope == 4.0


def test_the_robot_keeps_real_time_and_counts_what_is_late(found, tmp_path):
    now = [0.0]

    def clock():
        # Every look at the clock takes as long as a robot that is slower than time.
        now[0] += 0.03
        return now[0]

    studio = make_studio(found, tmp_path, "sparse_formula")
    studio.robot._clock = clock
    studio.start()
    end = time.monotonic() + 60
    while studio.robot.count.steps < 20 and time.monotonic() < end:
        time.sleep(0.05)
    studio.stop()
    assert studio.robot.count.late > 0


def test_a_steered_robot_begins_as_the_diagram_does(found):
    steered = SteeredRobot(found.gait, STANDING, found.controller("sparse_formula"), seed=1)
    steered.steer(initial_command(found.gait))
    steered.advance()
    sample = steered.sample()
    assert sample.step == 1 and not sample.fallen
    assert sample.observation.shape == (len(found.policy("sparse_formula").observation_names),)


# Messages.


@pytest.mark.parametrize(
    "values",
    [
        None,
        [],
        "push",
        {},
        {"kind": "exec"},
        {"kind": ["push"]},
        {"kind": "push"},
        {"kind": "push", "angle": 0, "speed": 1e9},
        {"kind": "push", "angle": "left", "speed": 1},
        {"kind": "coefficient", "term": -1, "value": 1.0},
        {"kind": "coefficient", "term": 1, "value": float("nan")},
        {"kind": "number", "index": 1, "value": None},
        {"kind": "act", "what": "rm -rf"},
        {"kind": "act", "what": "save", "path": "/etc/passwd"},
        {"kind": "evaluate", "scenarios": ["a" * 1000]},
        {"kind": "surroundings", "slope": 89, "latency": 0},
        {"kind": "gamepad"},
        {"kind": "gamepad", "axes": [0.0, "x"]},
        {"kind": "gamepad", "axes": [float("nan")]},
        {"kind": "gamepad", "axes": [0.0] * 1000},
        {"kind": "joint", "joint": 12},
        {"kind": "shown", "number": -1},
        {"kind": "joint", "joint": float("inf")},
    ],
)
def test_malformed_messages_are_refused(values):
    with pytest.raises(InputError):
        read_message(values)


PLAIN = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=5), inner),
    max_leaves=8,
)
FIELDS = st.fixed_dictionaries(
    {"kind": st.sampled_from([kind.title for kind in get_args(Message)])},
    optional={
        name: st.one_of(st.integers(-5, 50), st.floats(), st.booleans(), PLAIN)
        for kind in get_args(Message)
        for name in kind.__dataclass_fields__
    },
)


@given(values=PLAIN | FIELDS)
def test_whatever_a_page_sends_is_a_message_or_is_refused(values):
    try:
        message = read_message(values)
    except InputError:
        return
    assert isinstance(message, get_args(Message))


FINITE = st.floats(-1e30, 1e30)


@pytest.fixture(scope="module")
def messaged(found, tmp_path_factory):
    made = make_studio(found, tmp_path_factory.mktemp("messaged"), "sparse_formula")
    yield made
    made.stop()


@given(
    message=st.one_of(
        st.builds(Gamepad, axes=st.lists(FINITE, max_size=32).map(tuple)),
        st.builds(Steer, speed=FINITE, yaw_rate=FINITE, dwell=FINITE),
        st.builds(Coefficient, term=st.integers(0, 60), value=FINITE, goes_on=st.booleans()),
        st.builds(Number, index=st.integers(0, 2000), value=FINITE),
        st.builds(Switch, term=st.integers(0, 60), on=st.booleans()),
        st.builds(Choose, place=st.integers(0, 40)),
        st.builds(Act, what=st.sampled_from(["undo", "redo", "reset", "step", "pause"])),
    )
)
def test_messages_leave_commands_within_the_range_and_a_file_that_can_be_shown(messaged, message):
    studio = messaged
    with suppress(InputError):
        studio.handle(message)
    studio.robot._act()
    studio.robot.steering.check(studio.gait)
    assert formula_view(studio)["lines"]
    json.dumps(status(studio), allow_nan=False)


def test_messages_stand_for_what_they_say():
    assert read_message({"kind": "push", "angle": 90, "speed": 1}) == Push(90.0, 1.0)
    assert read_message({"kind": "switch", "term": 3, "on": False}) == Switch(3, on=False)


@pytest.mark.parametrize(
    "message",
    [
        Choose(place=99),
        Coefficient(term=999, value=1.0),
        Switch(term=999, on=True),
        Number(index=99_999, value=1.0),
        Evaluate(scenarios=("../../secret.yaml",)),
        Steer(speed=1e9, yaw_rate=0.0, dwell=8.0),
        Steer(speed=0.5, yaw_rate=-2.0, dwell=8.0),
        Steer(speed=0.5, yaw_rate=0.0, dwell=-5.0),
        Steer(speed=0.5, yaw_rate=0.0, dwell=1e9),
    ],
)
def test_messages_of_what_is_not_there_change_nothing(studio, message):
    with pytest.raises(InputError):
        studio.handle(message)
    steering = studio.robot.steering
    walk(studio, 1)
    assert not studio.session.is_changed and studio.robot.steering == steering


# Files, proofs and falls.


def test_saved_files_are_the_policy_that_walks(studio, tmp_path):
    studio.handle(Coefficient(term=3, value=0.2))
    studio.handle(Switch(term=5, on=False))
    studio.handle(Number(index=2, value=90.0))
    studio.handle(Act(what="save"))
    walk(studio, 1)
    assert studio.saved.parent == tmp_path / "out"
    loaded = load_policy(studio.saved)
    assert isinstance(loaded, FormulaPolicy)
    assert loaded.digest() == studio.adjustable.digest()
    assert studio.saved.read_text() == studio.session.written()


def test_a_session_replaces_what_it_saved_and_not_what_another_did(studio, found, tmp_path):
    studio.handle(Act(what="save"))
    before = studio.saved.read_text()
    later = make_studio(found, tmp_path, "sparse_formula")
    later.handle(Coefficient(term=0, value=0.11))
    later.handle(Act(what="save"))
    assert later.saved.name == "sparse_formula_edited_2.formulas"
    assert str(later.saved) in status(later)["problem"]
    later.handle(Coefficient(term=0, value=0.12))
    later.handle(Act(what="save"))
    later.stop()
    assert studio.saved.read_text() == before
    assert later.saved.read_text() == later.session.written()
    assert len([*studio.saved.parent.iterdir()]) == 2


def test_a_file_that_is_not_changed_is_saved_as_it_is(studio, found):
    studio.handle(Act(what="save"))
    assert studio.saved.read_bytes() == found.file("sparse_formula").read_bytes()


def test_a_changed_file_voids_its_certificate(studio):
    assert file_view(studio)["holds"]
    studio.handle(Coefficient(term=3, value=0.2))
    voided = file_view(studio)
    assert not voided["holds"] and voided["certificate"] != voided["digest"]
    studio.handle(Act(what="undo"))
    assert file_view(studio)["holds"]


@pytest.mark.slow
def test_claims_that_no_longer_hold_are_lost(studio):
    """A joint whose target follows another joint by a hundred is no longer kept within torque."""
    reader = studio.reader
    term = next(i for i, own in enumerate(reader.terms) if own.factors == ("q.FL_calf",))
    studio.handle(Coefficient(term=term, value=30.0))
    studio.verification = finished(proved(studio._policy(), studio.gait))
    lost = studio.lost()
    assert lost
    before = studio.certified
    after = {own["name"]: own["outcome"] for own in studio.verification.found}
    assert all(before[name] == "proved" != after[name] for name in lost)
    rows = status(studio)["verification"]["rows"]
    assert {row["name"] for row in rows if row["lost"]} == set(lost)


def finished(generator):
    """Work that was done here, without a process."""
    work = Work.__new__(Work)
    work.found = [vars(own) for own in generator]
    work.problem, work._ended = None, True
    return work


def test_falls_are_counted_of_both(found, monkeypatch):
    few = background.RolloutConfig(n_robots=2, n_steps=10, seed=500, n_seeds=1)
    monkeypatch.setattr(background, "ROLLOUTS", few)
    own = found.controller("sparse_formula")
    rows = list(counted(found.gait, (own, own), ["training", "slope_5deg"]))
    assert [(row.number, row.original, row.falls, row.robots) for row in rows] == [
        (1, False, 0, 2), (2, True, 0, 2), (3, False, 0, 2), (4, True, 0, 2),
    ]  # fmt: skip


def test_page_and_readme_say_how_many_robots_walk_and_for_how_long(studio):
    said = setup(studio, "sparse_formula")["counted"]
    assert said == "26 robots fall in 10 s"
    rollouts = background.ROLLOUTS
    assert (rollouts.n_robots, rollouts.n_steps * CONTROL_PERIOD) == (26, 10.0)
    page = Path(background.__file__).with_name("README.md").read_text()
    assert "falls of 26 robots in 10 s" in page


def squares(count):
    for number in range(count):
        yield FixedCommand(float(number), 0.0, 1)
    if count > 3:
        raise InputError("too many")


@pytest.mark.slow
@pytest.mark.parametrize(("count", "problem"), [(3, None), (4, "InputError: too many")])
def test_work_goes_on_in_a_process_of_its_own(count, problem):
    work = Work(squares, count)
    end = time.monotonic() + 120
    while work.runs and time.monotonic() < end:
        work.look()
        time.sleep(0.05)
    assert [own["speed"] for own in work.found] == [float(number) for number in range(count)]
    assert work.problem == problem


# What the page shows.


def test_views_are_json_and_hold_what_the_page_needs(studio):
    walk(studio, 60)
    whole = {
        "setup": setup(studio, "sparse_formula"),
        "panel": panel(studio),
        "status": status(studio),
        "frame": frame(studio, 0, 0),
        "file": file_view(studio),
    }
    again = json.loads(json.dumps(whole, allow_nan=False))
    assert len(again["frame"]["steps"]) == 60
    assert len(again["frame"]["terms"]["values"]) == sum(
        len(group["terms"]) for group in again["panel"]["groups"]
    )
    assert again["setup"]["certificate"]["counts"]["proved"] > 0
    later = frame(studio, 60, 0)
    assert later["steps"] == [] and later["number"] == 60


def test_the_shown_lines_are_of_the_numbers_that_count(studio):
    studio.handle(Coefficient(term=0, value=0.123))
    studio.handle(Switch(term=1, on=False))
    text = " ".join(formula_view(studio)["lines"])
    assert "0.123" in text and "0.0624" not in text
    studio.handle(Act(what="reset"))
    assert "0.0624" in " ".join(formula_view(studio)["lines"])


def test_a_formula_all_of_whose_terms_are_off_is_zero(studio):
    for term in range(len(studio.reader.terms)):
        studio.handle(Switch(term=term, on=False))
    assert formula_view(studio)["lines"] == ["FL_hip = 0"]


def test_a_page_is_sent_no_more_than_it_takes(studio):
    page = pytest.importorskip("glassgait.studies.studio.page", reason="needs the extra 'studio'")
    sent = []
    client = SimpleNamespace(has_socket_connection=True, run_javascript=sent.append)
    connection = page._Connection(studio, client)

    def send_often():
        for _ in range(10):
            walk(studio, 1)
            asyncio.run(connection.send())

    send_often()
    assert len(sent) == page.MOST_AHEAD
    assert "window.studio" in sent[0] and '"panel"' in sent[0] and '"formula"' in sent[0]
    for taken, expected in ((2, 2), (-1, 2), (10**6, 2 + page.MOST_AHEAD)):
        connection.take(SimpleNamespace(args={"kind": "shown", "number": taken}))
        send_often()
        assert len(sent) == page.MOST_AHEAD + expected
    for malformed in (None, 7, {"kind": "exec"}, {"kind": "joint", "joint": float("inf")}):
        connection.take(SimpleNamespace(args=malformed))
        assert studio.notice


def test_policies_without_formulas_walk_and_are_not_edited(found, tmp_path):
    studio = make_studio(found, tmp_path, "expert")
    assert not setup(studio, "expert")["formulas"]
    walk(studio, 20)
    assert len(frame(studio, 0, 4)["steps"]) == 20
    assert file_view(studio) is None and status(studio)["edits"] is None
    with pytest.raises(InputError, match="no formulas to edit"):
        studio.handle(Act(what="save"))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--scenario", "cenic_1e-5"], "discrete plants of Drake"),
        (["--scenario", "mujoco"], "discrete plants of Drake"),
        (["--gait", "gallop"], "gallop"),
        (["--port", "70000"], "port"),
    ],
)
def test_the_command_refuses_what_cannot_be_done(arguments, message, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as ended:
        main(["studio", *arguments])
    assert ended.value.code == 2
    assert message in " ".join(capsys.readouterr().err.replace("│", " ").split())


def test_the_command_says_how_to_install_what_is_missing(capsys, monkeypatch):
    usual = builtins.__import__

    def without_nicegui(name, *arguments, **options):
        if name.partition(".")[0] == "nicegui":
            raise ModuleNotFoundError(name=name)
        return usual(name, *arguments, **options)

    monkeypatch.delitem(sys.modules, "glassgait.studies.studio.page", raising=False)
    monkeypatch.setattr(builtins, "__import__", without_nicegui)
    with pytest.raises(SystemExit) as ended:
        main(["studio"])
    assert ended.value.code == 2
    assert "pip install 'glassgait[studio]'" in capsys.readouterr().err

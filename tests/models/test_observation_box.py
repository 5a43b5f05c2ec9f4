"""Boxes of observations: what is in them, their files, and what they are widened by."""

import numpy as np
import pytest

from glassgait.models.certificates.observation_box import (
    ObservationBox,
    commanded,
    load_box,
    operating_box,
    physical_box,
    rounded_outward,
)
from glassgait.models.errors import InputError
from glassgait.models.formulas.quantities import RobotUnits
from glassgait.models.policies.library import shipped_students
from glassgait.models.robots.library import load_robot
from glassgait.models.task.gait import gait_names, load_gait
from glassgait.models.task.observation import OVERDUE, ObservationLayout

A1 = load_robot()


NAMES = ObservationLayout(2, imu=True).names
TROT = load_gait("trot")


def box(low: float = -1.0, high: float = 1.0) -> ObservationBox:
    return ObservationBox(A1, NAMES, np.full(len(NAMES), low), np.full(len(NAMES), high))


def test_clips_what_is_beyond_its_corners_and_nothing_else():
    observations = np.zeros((2, len(NAMES)))
    observations[0, 5], observations[1, 5] = 1.0, 1.5
    assert np.array_equal(box().clipped(observations), np.minimum(observations, 1.0))


def test_is_widened_by_a_share_of_its_width_on_both_sides():
    wide = box().widened(0.1)
    assert wide.lower == pytest.approx(-1.2)
    assert wide.upper == pytest.approx(1.2)


def test_a_hull_holds_both():
    hull = box(0.0, 1.0).hull(box(-2.0, 0.5))
    assert (hull.lower == -2.0).all()
    assert (hull.upper == 1.0).all()


def test_takes_named_ranges_from_another():
    mixed = box().taking(["Foot Height FL"], box(-3.0, 4.0))
    index = NAMES.index("Foot Height FL")
    assert (mixed.lower[index], mixed.upper[index]) == (-3.0, 4.0)
    assert np.delete(mixed.upper, index).max() == 1.0


def test_holds_the_machine_in_one_state():
    held = physical_box(TROT, operating_box(TROT, A1)).in_state(1)
    first = NAMES.index("RM State 0")
    assert held.lower[first : first + 2].tolist() == [0.0, 1.0]
    assert held.upper[first : first + 2].tolist() == [0.0, 1.0]


def test_draws_whole_counts_and_one_state():
    whole = operating_box(TROT, A1)
    observations = whole.random(200, np.random.default_rng(0))
    assert np.array_equal(whole.clipped(observations), observations)
    quantities = RobotUnits.of(A1, NAMES).quantities(observations)
    counts = quantities[:, [NAMES.index("RM Iters"), NAMES.index("Command RM Iters")]]
    assert counts == pytest.approx(np.round(counts))
    assert set(counts[:, 1].round()) == set(range(6, 12))
    first = NAMES.index("RM State 0")
    assert (observations[:, first : first + 2].sum(axis=1) == 1.0).all()
    held = whole.in_state(1).random(50, np.random.default_rng(0))
    assert (held[:, first + 1] == 1.0).all()


def test_a_file_keeps_a_box(tmp_path):
    measured = rounded_outward(operating_box(TROT, A1).widened(0.0123))
    measured.save(tmp_path / "box.yaml", TROT, "by a test")
    again = load_box(tmp_path / "box.yaml", TROT, A1)
    assert np.array_equal(again.lower, measured.lower)
    assert np.array_equal(again.upper, measured.upper)
    assert measured.lines()[2].startswith("q.FL_hip: ")
    assert measured.lines()[2].endswith(" rad")


def test_ends_are_rounded_outward():
    exact = ObservationBox(A1, NAMES, np.full(len(NAMES), -1 / 3), np.full(len(NAMES), 1 / 3))
    rounded = rounded_outward(exact)
    assert (rounded.lower <= exact.lower).all()
    assert (rounded.upper >= exact.upper).all()
    assert np.allclose(rounded.upper, exact.upper, atol=1e-3)


def test_the_physical_box_is_of_limits_commands_and_counts():
    low, high = physical_box(TROT, box(0.0, 0.0)).quantities
    at = {name: (low[i], high[i]) for i, name in enumerate(NAMES)}
    assert at["RM Iters"] == (0.0, TROT.dwell[1] + OVERDUE)
    assert at["Command X"] == (-TROT.max_speed, TROT.max_speed)
    assert at["DoF Pos FL Hip"] == pytest.approx((-0.8629, 0.8629))
    assert at["Prev Action RR Calf"] == (-2.6965, -0.9163)


@pytest.mark.parametrize("gait", gait_names())
def test_every_gait_with_students_ships_its_operating_box(gait):
    assert shipped_students(gait)
    machine = load_gait(gait)
    operating = operating_box(machine, A1)
    commands = commanded(operating, machine)
    assert np.array_equal(commands.lower, operating.lower)
    physical = physical_box(machine, operating)
    assert (physical.lower <= operating.lower).all()
    assert (physical.upper >= operating.upper).all()
    assert (operating.upper > operating.lower).all()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("ranges: 3", "lacks the key 'ranges'"),
        ("ranges: {}", "key 'gait' is None; give a box of the trot"),
        ("gait: pace\nranges: {}", "key 'gait' is 'pace'; give a box of the trot"),
        ("gait: trot\nranges: {q.FL_hip: 3}", "must be \\[least, greatest\\]"),
        ("gait: trot\nranges: {q.FL_hip: [0, yes]}", "must be \\[least, greatest\\]"),
        ("gait: trot\nranges: {q.FL_knee: [0, 1]}", "no quantity is called 'q.FL_knee'"),
        ("gait: trot\nranges: {q.FL_hip: [0, 1]}", "lacks 'cmd.v'"),
    ],
)
def test_refuses_a_file_that_is_no_box(tmp_path, text, message):
    path = tmp_path / "box.yaml"
    path.write_text(text)
    with pytest.raises(InputError, match=message) as refused:
        load_box(path, TROT, A1)
    assert str(path) in str(refused.value)


def test_refuses_an_empty_range():
    with pytest.raises(InputError, match="least"):
        box(1.0, 0.0)


def test_reports_how_to_measure_a_box_that_is_not_there(tmp_path):
    with pytest.raises(InputError, match="--measure"):
        operating_box(TROT, tmp_path / "none.yaml")


@pytest.mark.parametrize("imu", [False, True])
def test_a_box_of_robots_is_loaded_as_one_of_what_they_observe(imu, trot, tmp_path):
    names = ObservationLayout(2, imu=imu).names
    narrow = ObservationBox(A1, names, np.full(len(names), -0.1), np.full(len(names), 0.1))
    box = commanded(narrow, trot)
    assert box.names == names
    path = tmp_path / "trot.yaml"
    box.save(path, trot, "by a test")
    assert load_box(path, trot, A1).names == names
    assert (operating_box(trot, A1).names == names) == imu
    assert physical_box(trot, box).names == names


def test_gravitys_direction_may_be_any_and_its_noise_besides():
    names, physical = NAMES, physical_box(TROT, box(-0.1, 0.1))
    gravity = [i for i, name in enumerate(names) if name.startswith("Gravity")]
    assert np.all(physical.upper[gravity] > 1.0) and np.all(physical.lower[gravity] < -1.0)

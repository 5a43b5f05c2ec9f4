"""Boxes of observations: their ranges, random observations and files."""

import numpy as np
import pytest

from glassgait.models.certificates.box import (
    ObservationBox,
    load_box,
    measured_box,
    operating_box,
    physical_box,
)
from glassgait.models.errors import InputError
from glassgait.models.formulas.quantities import RobotUnits
from glassgait.models.robots.library import load_robot
from glassgait.models.task.gait import gait_names, load_gait
from glassgait.models.task.observation import OVERDUE, ObservationLayout

A1, TROT = load_robot(), load_gait("trot")
NAMES = ObservationLayout(2, imu=True).names


def box(low: float = -1.0, high: float = 1.0) -> ObservationBox:
    return ObservationBox(A1, NAMES, np.full(len(NAMES), low), np.full(len(NAMES), high))


def test_draws_whole_counts_and_one_state():
    whole = operating_box(TROT, A1)
    quantities = whole.random(200, np.random.default_rng(0))
    assert np.all((whole.lower <= quantities) & (quantities <= whole.upper))
    counts = quantities[:, sorted(whole.counted)]
    assert np.array_equal(counts, np.round(counts))
    assert set(counts[:, 1]) == set(range(6, 12))
    first = NAMES.index("RM State 0")
    assert (quantities[:, first : first + 2].sum(axis=1) == 1.0).all()
    held = whole.in_state(1)
    assert held.lower[first : first + 2].tolist() == [0.0, 1.0]
    assert (held.random(50, np.random.default_rng(0))[:, first + 1] == 1.0).all()


def test_a_file_keeps_a_measured_box(tmp_path):
    generator, units = np.random.default_rng(0), RobotUnits.of(A1, NAMES)
    low, width = generator.uniform(-1, 1, len(NAMES)), generator.uniform(0.1, 1, len(NAMES))
    measured = measured_box(TROT, A1, NAMES, low, low + width)
    sensed = [i for i, name in enumerate(NAMES) if name.startswith(("DoF", "Base", "Foot"))]
    ends = units.quantities(low), units.quantities(low + width)
    # Each range is widened by a tenth on both sides, and rounded outward to four decimals.
    margin = 0.1 * (ends[1] - ends[0])
    assert (measured.lower <= ends[0] - margin + 1e-12)[sensed].all()
    assert np.allclose(measured.lower[sensed], (ends[0] - margin)[sensed], atol=1e-4)
    assert np.allclose(measured.upper[sensed], (ends[1] + margin)[sensed], atol=1e-4)
    measured.save(tmp_path / "box.yaml", TROT, "by a test")
    again = load_box(tmp_path / "box.yaml", TROT, A1)
    assert np.array_equal(again.lower, measured.lower)
    assert np.array_equal(again.upper, measured.upper)


def test_the_physical_box_is_of_limits_commands_counts_and_noise():
    at = physical_box(TROT, box(0.0, 0.0)).ranges
    assert at["t"] == [0.0, TROT.dwell[1] + OVERDUE]
    assert at["cmd.v"] == [-TROT.max_speed, TROT.max_speed]
    assert at["q.FL_hip"] == [-0.8629, 0.8629]
    assert at["a.RR_thigh"] == [-1.0472, 4.1888]
    assert at["g.x"][0] < -1.0 < 1.0 < at["g.x"][1]


@pytest.mark.parametrize("gait", gait_names())
def test_every_gait_ships_its_operating_box(gait):
    machine = load_gait(gait)
    operating = operating_box(machine, A1)
    assert (operating.upper > operating.lower).all()
    physical = physical_box(machine, operating)
    assert (physical.lower <= operating.lower).all()
    assert (physical.upper >= operating.upper).all()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("gait: trot", "lacks the key 'ranges'"),
        ("gait: pace\nranges: {}", "key 'gait' is 'pace'; give a box of the trot"),
        ("gait: trot\nranges: {q.FL_hip: 3}", "ranges.q.FL_hip is 3"),
        ("gait: trot\nranges: {q.FL_hip: [1, 0]}", "the least, then the greatest"),
        ("gait: trot\nranges: {q.FL_hip: [0, 1]}", "lacks 'cmd.v'"),
    ],
)
def test_refuses_a_file_that_is_no_box(tmp_path, text, message):
    path = tmp_path / "box.yaml"
    path.write_text(text)
    with pytest.raises(InputError, match=message) as refused:
        load_box(path, TROT, A1)
    assert str(path) in str(refused.value)


def test_refuses_unknown_ranges():
    with pytest.raises(InputError, match="no quantity is called"):
        ObservationBox.of_ranges(A1, NAMES, box().ranges | {"q.FL_knee": [0.0, 1.0]})

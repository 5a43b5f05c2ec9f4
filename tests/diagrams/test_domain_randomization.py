"""The worlds that robots meet while they learn."""

from dataclasses import replace

import numpy as np
import pytest

from glassgait.diagrams.domain_randomization import (
    DomainRandomization,
    GroupRanges,
    TerrainRanges,
    at_hardship,
)
from glassgait.diagrams.station import StationConfig
from glassgait.models.errors import InputError
from glassgait.models.robots.library import load_robot
from glassgait.models.task.terrain import PLANE, grid_of

A1 = load_robot()


def drawn(worlds, seed=0):
    return worlds.stations(A1, np.random.default_rng(seed))


@pytest.mark.parametrize(
    ("name", "least", "greatest"),
    [
        ("payload", 0.0, 5.0),
        ("motor_strength", 0.8, 1.2),
        ("stiffness", 0.8 * A1.stiffness, 1.2 * A1.stiffness),
        ("damping", 0.8 * A1.damping, 1.2 * A1.damping),
        ("armature", 0.0, 0.01),
        ("relaxation_time", 0.005, 0.03),
    ],
)
def test_groups_cover_every_range_evenly(name, least, greatest):
    # All in Drake: MuJoCo's contacts have no relaxation time.
    worlds = DomainRandomization(mujoco_share=0.0)
    values = np.sort([getattr(station, name) for station in drawn(worlds)])
    # One in each sixteenth of the range.
    parts = (values - least) / (greatest - least) * len(values)
    np.testing.assert_array_equal(np.floor(parts), np.arange(len(values)))


def test_the_first_groups_are_of_mujoco():
    stations = drawn(DomainRandomization(mujoco_share=0.2, fine_steps=(0.005,)))
    engines = [(station.engine, station.time_step) for station in stations]
    assert engines == [("mujoco", 0.005)] * 3 + [("drake", 0.01)] * 12 + [("drake", 0.005)]
    assert len({station.payload for station in stations}) == 16


def test_ranges_of_one_value_change_nothing():
    station = StationConfig(friction=0.7, stiffness=(20.0,) * 12, damping=0.5)
    none = GroupRanges(
        terrains=TerrainRanges(share=0.0),
        payload=(0, 0),
        payload_offset=0,
        motor_strength=(1, 1),
        gains=(1, 1),
        armature=(0, 0),
        relaxation_time=(0.01, 0.01),
    )
    same = DomainRandomization(n_groups=3, groups=none, mujoco_share=0.0, station=station)
    assert drawn(same) == [station] * 3


def on_grounds(**settings):
    return DomainRandomization(groups=GroupRanges(terrains=TerrainRanges(**settings)))


def test_a_share_of_the_groups_stands_on_other_ground_and_nothing_else_changes():
    worlds = on_grounds(share=0.75, slope=20.0, amplitude=0.08, height=0.06)
    stations, usual = drawn(worlds), drawn(on_grounds(share=0.0))
    assert [replace(station, terrain=PLANE) for station in stations] == usual
    grounds = [station.terrain for station in stations if station.terrain != PLANE]
    assert len(grounds) == 12
    slopes = [ground.slope for ground in grounds if ground.kind == "plane"]
    assert len(slopes) == 6 and 10.0 < max(slopes) <= 20.0
    assert len({ground.direction for ground in grounds if ground.kind == "plane"}) == 6
    assert {ground.kind for ground in grounds} == {"plane", "blocks", "steps", "uneven"}
    assert len({ground.seed for ground in grounds}) == 12 - len(slopes) + 1
    assert all(abs(ground.height) <= 0.06 and ground.amplitude <= 0.08 for ground in grounds)


def test_hardship_scales_the_ground_alone():
    whole = drawn(on_grounds(share=1.0, patches=0.2))
    half, level = at_hardship(whole, 0.5), at_hardship(whole, 0.0)
    assert half == [replace(own, terrain=own.terrain.scaled(0.5)) for own in whole]
    assert any(own.terrain.kind == "steps" for own in whole)
    assert all(np.ptp(grid_of(own.terrain).top) < 1e-2 for own in level)
    assert not any(own.terrain.slope for own in level)


def test_more_fine_steps_than_groups_are_refused():
    with pytest.raises(InputError, match="do not fit in n_groups = 1"):
        DomainRandomization(n_groups=1, fine_steps=(0.005, 0.0025))

"""Draws of commands."""

import numpy as np

from glassgait.models.task.command import DEAD_BAND, sample_commands
from glassgait.models.task.gait import load_gait


def test_commands_cover_the_gaits_range_and_no_more(generator):
    gait = load_gait("walk")
    command = sample_commands(gait, 5000, generator)
    speed, turn = command.velocity.T
    assert 0.48 < np.abs(speed).max() <= gait.max_speed
    assert 0.98 < np.abs(turn).max() <= gait.max_yaw_rate
    assert set(command.dwell) == set(range(6, 12))


def test_slow_commands_become_standing_and_a_speed_range_narrows_the_draw(generator, trot):
    speed = sample_commands(trot, 2000, generator).velocity[:, 0]
    assert np.all((speed == 0) | (np.abs(speed) >= DEAD_BAND))
    assert 0.1 < np.mean(speed == 0) < 0.3
    speed = sample_commands(trot, 500, generator, speed_range=(0.0, 0.75)).velocity[:, 0]
    assert 0.0 <= speed.min() < speed.max() <= 0.75

"""The locomotion task: gaits, reward machine, observation, reward, commands and termination."""

from glassgait.models import CONTROL_PERIOD

__all__ = ["COMMAND_STEPS", "CONTROL_PERIOD", "EPISODE_STEPS", "MOST_STATES"]

EPISODE_STEPS = 1000  # control steps of an episode (20 s)
COMMAND_STEPS = 500  # control steps between two commands (10 s)
MOST_STATES = 32  # greatest number of RM states of a gait; each is an entry of the observation

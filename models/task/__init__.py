"""The locomotion task: gaits, reward machine, observation, reward, commands and termination."""

CONTROL_PERIOD = 0.02
"""Time between two actions (s)."""

EPISODE_STEPS = 1000
"""Control steps of an episode (20 s)."""

COMMAND_STEPS = 500
"""Control steps between two commands (10 s)."""

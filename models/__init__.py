"""Robots, the task, estimation and policies, without Drake, loops over time or printing."""

CONTROL_PERIOD = 0.02  # time between two actions (s)
BASE_VELOCITY_SCALE = 2.0  # factor on the trunk's velocity as policies observe it
GRAVITY = 9.81  # acceleration by gravity (m/s²)

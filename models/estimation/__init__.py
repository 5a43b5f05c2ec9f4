"""State estimation: readings of the IMU, trusted contacts, and odometry."""

BASE_VELOCITY_SCALE = 2.0
"""Factor on the trunk's velocity as policies observe it."""

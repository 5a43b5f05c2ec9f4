"""State estimation: readings of the IMU, trusted contacts, and odometry."""

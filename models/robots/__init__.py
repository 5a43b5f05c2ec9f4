"""The Unitree A1: its description, constants and closed-form kinematics."""

"""Robots as data, what quadrupeds have in common, and their closed-form kinematics."""

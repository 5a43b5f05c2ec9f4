"""Robots as data, the layout that quadrupeds share, and their closed-form kinematics."""

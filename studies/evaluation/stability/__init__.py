"""How each gait answers small differences: the stride map's orbits, modes and predictions."""

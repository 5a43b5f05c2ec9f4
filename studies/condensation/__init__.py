"""Short formulas: a gait on one page."""

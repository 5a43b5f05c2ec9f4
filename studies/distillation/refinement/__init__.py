"""Refinement: a policy of formulas learns on, alone and in closed loop."""

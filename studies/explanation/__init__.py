"""Explanations of policies: a page of each action's terms, formulas, and tests in simulation."""

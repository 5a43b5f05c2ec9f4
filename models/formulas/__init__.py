"""Expressions: their text, their values, and what holds over boxes of observations."""

"""Formulas: their text, values and mirror images, and interval arithmetic."""

"""Simplification: an expert learns on, so that few terms say what it does."""

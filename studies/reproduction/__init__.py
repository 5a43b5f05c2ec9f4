"""Reproduction of the paper by its own settings."""

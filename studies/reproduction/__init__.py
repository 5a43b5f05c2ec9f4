"""Reproduction of the paper with its settings."""

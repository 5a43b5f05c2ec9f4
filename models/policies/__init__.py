"""Policies: maps from an observation to an action, saved without pickles."""

"""Evaluates policies in closed loop: falls, tracking, rhythm and reward."""

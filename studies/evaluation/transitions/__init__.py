"""Gaits that change while walking: who falls from which to which, and how fast the rhythm comes."""

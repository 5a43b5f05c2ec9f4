"""Proofs of claims about formula policies, over all observations of a box."""

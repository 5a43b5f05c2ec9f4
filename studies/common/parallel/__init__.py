"""Loops in parallel processes, on this machine or on a cluster of many."""

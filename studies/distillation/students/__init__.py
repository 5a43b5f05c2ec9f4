"""The students: how each kind is fitted, and where those that are fitted are kept."""

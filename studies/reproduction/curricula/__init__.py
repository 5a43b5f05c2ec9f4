"""Is the curriculum needed? Students of other ways to collect samples, alone."""

"""Export of a whole controller as C, written from a gait and its policies."""

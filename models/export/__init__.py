"""A whole controller in C: what stands in the file, written from a gait and its policies."""

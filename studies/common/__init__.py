"""What studies share: runs, tables, figures, processes and rollouts."""

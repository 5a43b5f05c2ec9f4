"""One page a gait that shows, at every moment of a rollout, why each joint does what it does."""

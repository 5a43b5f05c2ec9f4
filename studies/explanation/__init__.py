"""One page a gait that tells, at every moment of a rollout, why each joint does what it does."""

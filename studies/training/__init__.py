"""Training neural experts by PPO on the batch simulator (paper, Section III-A)."""

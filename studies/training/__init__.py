"""Training of neural experts by PPO in the batch simulator (paper, Section III-A)."""

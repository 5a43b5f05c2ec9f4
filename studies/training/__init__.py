"""Training neural experts by PPO on the batch simulator (paper, Section III-A)."""

import os

# Between two operations torch's threads would spin, on the cores that physics needs: training would
# be a seventh slower. OpenMP reads this once, when torch is loaded.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")

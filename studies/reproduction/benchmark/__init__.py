"""Speed, measured as ratios against the obvious alternative in one run."""

"""What a policy can never do, proved over all observations of a box at once."""

"""Which contact solvers and time steps agree: a dropped robot and a walking one in each."""

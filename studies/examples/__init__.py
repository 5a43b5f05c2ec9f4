"""Short scripts, each of which shows one way to use the project from Python."""

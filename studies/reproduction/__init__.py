"""What others published, done again by their own settings, which a file holds."""

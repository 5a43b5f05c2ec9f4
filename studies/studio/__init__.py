"""Edit a formula while a robot walks by it."""

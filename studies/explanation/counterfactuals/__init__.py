"""What a joint would have had to observe to do something else, and what follows if it does."""

"""What a policy would have had to observe to ask something else of a joint."""

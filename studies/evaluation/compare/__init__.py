"""Two policies side by side: their lines, their targets, their scores, and one replay of both."""

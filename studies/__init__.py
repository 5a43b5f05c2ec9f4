"""Commands that run studies and draw tables and figures of their results."""

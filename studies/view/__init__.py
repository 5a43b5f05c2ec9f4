"""Watching one robot: live in Meshcat, and as a replay that opens without a server."""

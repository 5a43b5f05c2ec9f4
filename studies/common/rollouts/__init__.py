"""Rolling policies out and scoring what they did: the ground that several studies share."""

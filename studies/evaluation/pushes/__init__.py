"""Which pushes a walking robot survives: by direction, speed and phase of the gait."""

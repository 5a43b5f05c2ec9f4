"""Drake leaf systems, each a thin wrapper of a pure function in `models`."""

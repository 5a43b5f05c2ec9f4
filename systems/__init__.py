"""Drake leaf systems, one a file, each thin over a pure function of `models`."""

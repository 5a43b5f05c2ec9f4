"""Studies: from a configuration to a run, and from a run to tables and figures."""

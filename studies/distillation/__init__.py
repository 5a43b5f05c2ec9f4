"""Distilling experts into glass-box students by DAgger with alternation (paper, Section III-B)."""

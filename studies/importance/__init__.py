"""What each controller looks at, and whether that is true (paper, Section IV-B)."""

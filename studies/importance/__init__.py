"""The importance of observations, and figures of students from within (paper, Section IV-B)."""

"""Importances of observations, and figures of the students' models (paper, Section IV-B)."""

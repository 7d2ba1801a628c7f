"""The bins of told obstacle probability, in which rows of free cells are counted."""

EDGES = (0.0, 0.001, 0.0025, 0.005, 0.0075, 0.01, 0.0125, 0.015, 0.02, 0.03, 0.05, 0.1, 0.2, 0.4, 1.0)
"""Ends of the bins."""

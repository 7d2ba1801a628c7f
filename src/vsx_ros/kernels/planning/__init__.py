"""Compiled loops of curves, searches and trees of the planner."""

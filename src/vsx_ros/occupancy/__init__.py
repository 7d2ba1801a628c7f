"""Occupancy grids of the ground."""

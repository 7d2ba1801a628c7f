"""Compiled loops of the ground map, distances and lines of sight."""

"""Compiled loops of cameras and rigid motions."""

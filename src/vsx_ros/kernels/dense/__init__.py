"""Compiled loops of planes and surfaces."""

"""Compiled loops of the emulated camera."""

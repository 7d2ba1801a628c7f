"""Kobuki, the base of the TurtleBot 2."""

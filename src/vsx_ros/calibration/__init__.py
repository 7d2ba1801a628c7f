"""Calibration of a robot's camera, wheels and camera mount from its own recordings."""

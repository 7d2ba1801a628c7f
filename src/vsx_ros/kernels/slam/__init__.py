"""Compiled loops of the SLAM (poses, adjustments, searches along rays)."""

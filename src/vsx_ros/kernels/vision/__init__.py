"""Compiled loops of images (patches, alignment)."""

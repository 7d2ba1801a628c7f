"""Second floor, west: images."""

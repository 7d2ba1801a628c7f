"""The roof, west: the command line."""

"""First floor: mathematics with names."""

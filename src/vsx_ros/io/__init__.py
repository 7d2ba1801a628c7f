"""Fourth floor: files."""

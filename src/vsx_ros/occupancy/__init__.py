"""Second floor, east: grids."""

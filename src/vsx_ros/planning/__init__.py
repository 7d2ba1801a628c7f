"""Third floor, east: motion planning (paper 4)."""

"""Fourth floor: frontier exploration and the mission (paper 5.2)."""

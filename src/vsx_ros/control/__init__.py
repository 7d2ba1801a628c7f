"""Fourth floor: following a plan."""

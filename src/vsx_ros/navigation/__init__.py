"""Fifth floor: from a goal to velocities. No clock and no threads: all times are arguments."""

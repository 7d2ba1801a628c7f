"""Timeouts: for how long one who must speak may be silent [s]."""

LEASE_S = 0.3
"""Whoever wants motion says so again and again; after so long it counts as gone."""
VSLAM_GONE_S = 2.0
"""The base waits for a silent vslam, but not longer."""
ODOMETRY_S = 0.5
"""On a busy machine an odometry reading may be late."""
FOLLOWER_S = 1.0
"""The follower tells its status five times a second."""
PLANNER_S = 15.0
"""Plans take a second or two; a planner that needs this long hangs."""

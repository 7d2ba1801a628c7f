"""Dubious tracking slows the base, for a moment longer than it lasts."""

from vsx_ros.config import FollowerConfig
from vsx_ros.navigation.follower import TrackingSpeedLimiter
from vsx_ros.slam.state import TrackingState

MS = 1_000_000


def test_dubious_frames_slow_down_and_their_end_is_waited_for():
    limiter = TrackingSpeedLimiter(FollowerConfig(dubious_speed_factor=0.4, dubious_hold_s=0.5))
    assert limiter.speed_factor(0, TrackingState.GOOD) == 1.0
    assert limiter.speed_factor(100 * MS, TrackingState.DUBIOUS) == 0.4
    assert limiter.speed_factor(200 * MS, TrackingState.GOOD) == 0.4
    assert limiter.speed_factor(300 * MS, TrackingState.DUBIOUS) == 0.4
    assert limiter.speed_factor(800 * MS, TrackingState.GOOD) == 0.4
    assert limiter.speed_factor(801 * MS, TrackingState.GOOD) == 1.0

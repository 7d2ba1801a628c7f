"""A computer that tracks few images a second: the base drives slowly, and stops when no more come."""

import math

import numpy as np
import pytest
from driving import LaggingBase

from vsx_ros.config import Config
from vsx_ros.control.localization import Localization
from vsx_ros.control.trajectory_tracker import FollowStatus
from vsx_ros.geometry.se2 import SE2
from vsx_ros.navigation.follower import Follower, MessageAges
from vsx_ros.planning.joint_qp import connect
from vsx_ros.planning.path import Path
from vsx_ros.planning.time_scaling import time_scale
from vsx_ros.robot import STOP
from vsx_ros.slam.state import TrackingState

STEP_S = 1.0 / 30.0
LIMITS = Config().limits
GOAL = SE2(1.6, 0.5, 0.4)
WAY = connect(SE2(), GOAL, 1.0)
assert isinstance(WAY, Path)
TRAJECTORY = time_scale(WAY, LIMITS)


class Slow:
    """A base at so many images a second. Each takes up to a fifth longer or shorter; a share is lost, but never two in
    a row. rows: time [s], commanded speed [m/s], image-free time [s]."""

    def __init__(self, rate_hz: float, seed: int, frame: str = "map", lost: float = 0.1) -> None:
        self.base, self.follower, self.localization = LaggingBase(), Follower(Config()), Localization()
        self.rng, self.period_s, self.is_lost = np.random.default_rng(seed), 1.0 / rate_hz, False
        self.next_s, self.heard_s, self.comes, self.lost = 0.0, 0.0, True, lost
        self.seen: list[tuple[float, int, SE2]] = []
        self.rows: list[tuple[float, float, float]] = []
        self.go_on(4.0)
        self.begun_s = self.now_s
        self.follower.follow(self.base.now_ns, TRAJECTORY, frame, 1)

    @property
    def now_s(self) -> float:
        return 1e-9 * self.base.now_ns

    @property
    def status(self) -> FollowStatus:
        return self.follower.report.status

    def images(self) -> None:
        """Take the poses that are ready, and begin with the next image when it is time."""
        while self.seen and self.seen[0][0] <= self.now_s:
            self.heard_s, stamp_ns, pose = self.seen.pop(0)
            self.localization.add_pose(stamp_ns, pose)
            self.localization.add_state(TrackingState.GOOD, "")
        if self.comes and self.now_s >= self.next_s:
            self.is_lost = not self.is_lost and self.rng.random() < self.lost
            if not self.is_lost:
                ready_s = self.now_s + 0.03 + 0.8 * self.period_s
                self.seen.append((ready_s, self.base.now_ns, self.base.pose))
            self.next_s += self.period_s * self.rng.uniform(0.8, 1.2)

    def go_on(self, seconds: float) -> None:
        for _ in range(round(seconds / STEP_S)):
            self.base.advance(self.base.now_ns + round(1e9 * STEP_S))
            self.localization.add_odometry(self.base.odometry)
            self.images()
            silent_s = self.now_s - self.heard_s
            where = self.localization.at(self.base.now_ns)
            command = self.follower.step(self.base.now_ns, where, MessageAges(vslam_s=silent_s)) or STOP
            self.rows.append((self.now_s, command.v, silent_s))
            self.base.tell(command)

    def until_end(self) -> None:
        while self.status in (FollowStatus.FOLLOWING, FollowStatus.STALE) and self.now_s < self.begun_s + 90.0:
            self.go_on(STEP_S)

    @property
    def hard_stops(self) -> int:
        """How often the speed fell faster than the limits allow; the rest of a stop may end at once."""
        falls = -np.diff(np.array(self.rows)[:, 1])
        return int(np.sum(falls > LIMITS.a_m_s2 * STEP_S * 1.05 + 0.011))


@pytest.mark.parametrize("frame", ["map", "odom"])
@pytest.mark.parametrize("rate_hz", [30.0, 10.0, 5.0, 3.0])
@pytest.mark.parametrize("seed", range(20))
def test_the_goal_is_reached_without_a_hard_stop(rate_hz: float, seed: int, frame: str) -> None:
    drive = Slow(rate_hz, seed, frame)
    drive.until_end()
    assert drive.status is FollowStatus.ARRIVED, drive.follower.report
    assert drive.hard_stops == 0
    assert drive.base.pose.distance_to(GOAL) < 0.03


@pytest.mark.parametrize("rate_hz", [30.0, 10.0, 5.0, 3.0])
def test_the_way_between_two_images_is_about_that_at_ten_a_second(rate_hz: float) -> None:
    drive = Slow(rate_hz, 1)
    drive.go_on(4.0)
    fastest = max(v for _, v, _ in drive.rows)
    assert fastest == pytest.approx(LIMITS.v_m_s * min(1.0, rate_hz / 10.0), rel=0.35)


@pytest.mark.parametrize(
    ("rate_hz", "within_s"), [(30.0, 0.3), (15.0, 0.3), (10.0, 0.3), (5.0, 0.6), (3.0, 0.7), (1.0, 0.7)]
)
@pytest.mark.parametrize("seed", range(20))
def test_the_base_is_told_to_stand_when_no_more_images_come(rate_hz: float, within_s: float, seed: int) -> None:
    drive = Slow(rate_hz, seed, lost=0.0 if rate_hz == 10.0 else 0.1)
    drive.go_on(2.0 + 0.1 * seed)
    drive.comes = False
    drive.seen.clear()
    begin = len(drive.rows)
    drive.go_on(2.5)
    told = np.array(drive.rows[begin:])
    late = told[:, 2] > within_s + STEP_S
    assert not np.any(told[late, 1]), told[late]
    assert drive.status in (FollowStatus.STALE, FollowStatus.STOPPED)


@pytest.mark.parametrize("seed", range(5))
def test_one_slow_image_among_fast_ones_allows_no_longer_silence(seed: int) -> None:
    """Neither does a pause: the base stops as fast as before it."""
    drive = Slow(30.0, seed)
    for pause_s in (0.25, 0.25, 1.5):
        drive.comes = False
        drive.go_on(pause_s)
        drive.comes, drive.next_s = True, drive.now_s
        drive.go_on(1.0)
    drive.comes = False
    drive.go_on(0.3 + 0.06 + STEP_S)
    assert drive.rows[-1][1] == 0.0
    assert math.isfinite(drive.rows[-1][2])

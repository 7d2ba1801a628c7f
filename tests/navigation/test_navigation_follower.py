"""When the follower drives, waits, stops on the way and stops at once."""

from collections.abc import Callable

import numpy as np
import pytest
from driving import POSE_LATE_NS, LaggingBase

from vsx_ros.config import Config, LimitsConfig
from vsx_ros.control.localization import UNLOCALIZED, Localization, LocalizationState
from vsx_ros.control.trajectory_tracker import FollowStatus
from vsx_ros.errors import InputError
from vsx_ros.geometry.se2 import SE2
from vsx_ros.navigation.follower import Follower, MessageAges, decode_report
from vsx_ros.planning.path import Trajectory, certified
from vsx_ros.planning.pieces import arc_piece
from vsx_ros.planning.time_scaling import time_scale
from vsx_ros.robot import STOP
from vsx_ros.slam.state import TrackingState

STEP_NS = 33_333_333
CONFIG = Config()
LIMITS = CONFIG.limits


def ahead(pose: SE2, limits: LimitsConfig = LIMITS) -> Trajectory:
    """Straight on from a pose."""
    pieces = (arc_piece(pose, 0.0, 3.0, 1),)
    return time_scale(certified(pose, pieces[-1].end, pieces, "arcs and lines"), limits)


class Drive:
    """A follower above a base; told: its commands."""

    def __init__(self, config: Config = CONFIG) -> None:
        self.base, self.follower, self.localization = LaggingBase(), Follower(config), Localization()
        self.told: list[float | None] = []
        self.state, self.ages, self.ahead = TrackingState.GOOD, MessageAges(), ""
        self.changed: Callable[[LocalizationState], LocalizationState] = lambda where: where
        self.go_on(0.1)
        self.follower.follow(self.base.now_ns, ahead(SE2(), config.limits), "map", 1)

    def go_on(self, seconds: float) -> None:
        for _ in range(round(1e9 * seconds / STEP_NS)):
            base = self.base
            base.advance(base.now_ns + STEP_NS)
            self.localization.add_odometry(base.odometry)
            self.localization.add_pose(base.now_ns, base.pose)
            self.localization.add_state(self.state, "", self.ahead)
            where = self.changed(self.localization.at(base.now_ns))
            command = self.follower.step(base.now_ns, where, self.ages)
            self.told.append(None if command is None else command.v)
            base.tell(command or STOP)

    @property
    def status(self) -> FollowStatus:
        return self.follower.report.status


@pytest.fixture
def drive() -> Drive:
    """At full speed."""
    begun = Drive()
    begun.go_on(2.5)
    assert begun.told[-1] == pytest.approx(LIMITS.v_m_s, abs=0.02)
    return begun


def test_dubious_tracking_slows_the_base_for_a_moment_longer_than_it_lasts(drive: Drive) -> None:
    slow = pytest.approx(Config().follower.dubious_speed_factor * LIMITS.v_m_s, abs=0.02)
    drive.state = TrackingState.DUBIOUS
    drive.go_on(1.5)
    assert drive.told[-1] == slow
    drive.state = TrackingState.GOOD
    drive.go_on(Config().follower.dubious_hold_s - 0.1)
    assert drive.told[-1] == slow
    drive.go_on(1.0)
    assert drive.told[-1] == pytest.approx(LIMITS.v_m_s, abs=0.02)


def test_the_base_waits_for_what_hides_the_map_ahead_and_goes_on_when_it_is_gone(drive: Drive) -> None:
    drive.ahead, begin = "something hides 30 of 40 points ahead", len(drive.told)
    drive.go_on(1.5)
    assert drive.told[-1] == 0.0
    assert drive.status is FollowStatus.STALE
    assert drive.follower.report.reason == "waiting: something hides 30 of 40 points ahead"
    speeds = np.array(drive.told[begin - 1 :])
    assert -np.diff(speeds).min() <= LIMITS.a_m_s2 * 1e-9 * STEP_NS * (1 + 1e-6)
    drive.ahead = ""
    drive.go_on(2.0)
    assert drive.told[-1] == pytest.approx(LIMITS.v_m_s, abs=0.02)


def test_it_does_not_wait_for_ever_for_what_stays(drive: Drive) -> None:
    drive.ahead = "something hides 30 of 40 points ahead"
    drive.go_on(Config().follower.hidden_wait_s - 0.1)
    assert drive.told[-1] == 0.0
    drive.go_on(2.0)
    assert drive.told[-1] > 0.1
    assert drive.status is FollowStatus.FOLLOWING


def test_it_waits_for_what_hides_the_map_on_each_drive_anew(drive: Drive) -> None:
    drive.ahead = "something hides 30 of 40 points ahead"
    drive.go_on(1.0)
    drive.follower.end(drive.base.now_ns, "cancelled")
    drive.ahead = ""
    drive.go_on(10.0)
    drive.ahead = "something hides 20 of 40 points ahead"
    drive.follower.follow(drive.base.now_ns, ahead(drive.base.pose, CONFIG.limits), "map", 2)
    drive.go_on(1.0)
    assert drive.told[-1] == 0.0


def test_a_camera_that_is_found_soon_lets_the_drive_go_on(drive: Drive) -> None:
    drive.state = TrackingState.LOST
    drive.go_on(4.9)
    assert (drive.told[-1], drive.status) == (0.0, FollowStatus.STALE)
    drive.state = TrackingState.GOOD
    drive.go_on(2.0)
    assert drive.told[-1] == pytest.approx(LIMITS.v_m_s, abs=0.02)


@pytest.mark.parametrize("state", [TrackingState.LOST, TrackingState.NOT_INITIALISED])
def test_a_camera_that_stays_lost_ends_the_drive_for_good(drive: Drive, state: TrackingState) -> None:
    drive.state = state
    drive.go_on(5.2)
    assert drive.status is FollowStatus.STOPPED
    assert "tracking stays lost" in drive.follower.report.reason
    drive.state, begin = TrackingState.GOOD, len(drive.told)
    drive.go_on(10.0)
    assert not any(drive.told[begin:]), "nobody expects the base to drive on"


def test_each_drive_gives_a_lost_camera_its_time_and_one_by_odometry_needs_none(drive: Drive) -> None:
    drive.state = TrackingState.LOST
    for _ in range(3):
        drive.go_on(4.0)
        drive.follower.follow(drive.base.now_ns, ahead(drive.base.pose), "map", 2)
    drive.go_on(4.0)
    assert drive.status is FollowStatus.STALE
    drive.follower.follow(drive.base.now_ns, ahead(drive.base.pose), "odom", 3)
    drive.go_on(6.0)
    assert drive.status is FollowStatus.FOLLOWING


@pytest.mark.parametrize(
    ("ages", "reason"),
    [(MessageAges(vslam_s=0.31), "no word from vslam"), (MessageAges(odometry_s=0.51), "no odometry")],
)
def test_silence_stops_at_once_and_is_waited_for_and_the_speed_grows_from_rest(
    drive: Drive, ages: MessageAges, reason: str
) -> None:
    drive.ages = ages
    drive.go_on(0.04)
    assert drive.told[-1] == 0.0
    assert reason in drive.follower.report.reason
    drive.go_on(1.0)
    assert drive.status is FollowStatus.STALE
    drive.ages, begin = MessageAges(), len(drive.told)
    drive.go_on(1.5)
    speeds = np.array([0.0, *drive.told[begin:]])
    assert speeds.max() > 0.1
    assert np.diff(speeds).max() <= LIMITS.a_m_s2 * 1e-9 * STEP_NS * (1 + 1e-6)


@pytest.mark.parametrize(
    ("ages", "reason"),
    [(MessageAges(vslam_s=2.1), "vslam is silent"), (MessageAges(executor_s=0.31), "move_base is silent")],
)
def test_a_long_silence_and_one_of_the_executor_end_the_drive(drive: Drive, ages: MessageAges, reason: str) -> None:
    drive.ages = ages
    drive.go_on(0.04)
    assert (drive.told[-1], drive.status, drive.follower.report.reason) == (0.0, FollowStatus.STOPPED, reason)


def test_a_trajectory_given_while_vslam_is_silent_waits_for_it() -> None:
    drive = Drive()
    drive.ages = MessageAges(vslam_s=60.0)
    drive.go_on(1.9)
    assert drive.status is FollowStatus.STALE
    drive.go_on(0.3)
    assert drive.status is FollowStatus.STOPPED


def test_a_new_hazard_ends_the_drive_and_one_that_is_there_may_be_backed_away_from(drive: Drive) -> None:
    now_ns, follower = drive.base.now_ns, drive.follower
    assert follower.take_hazards(now_ns, frozenset(["bumper left"])) == STOP
    assert follower.report.reason == "hazard: bumper left"
    follower.follow(now_ns, ahead(SE2()), "map", 2)
    assert follower.take_hazards(now_ns, frozenset(["bumper left"])) is None
    assert follower.take_hazards(now_ns, frozenset(["bumper left", "cliff"])) == STOP
    assert follower.report.reason == "hazard: cliff"


def test_getting_stuck_ends_the_drive_and_being_stuck_does_not(drive: Drive) -> None:
    drive.changed = lambda where: where._replace(stuck="stuck: the wheels turned")
    drive.go_on(0.04)
    assert (drive.told[-1], drive.follower.report.reason) == (0.0, "stuck: the wheels turned")
    drive.follower.follow(drive.base.now_ns, ahead(drive.base.pose), "map", 2)
    drive.go_on(0.5)
    assert drive.status is FollowStatus.FOLLOWING


@pytest.mark.parametrize("a_m_s2", [LIMITS.a_m_s2, LIMITS.a_stop_m_s2])
def test_stopping_on_the_way_is_told_beforehand_and_keeps_its_deceleration(drive: Drive, a_m_s2: float) -> None:
    assert drive.follower.brake(drive.base.now_ns, a_m_s2) is None
    stop, begin = drive.follower.report.stop_in("map"), len(drive.told)
    assert stop is not None
    assert drive.follower.report.stop_in("odom") is None
    drive.go_on(1.5)
    assert drive.status is FollowStatus.STOPPED
    assert abs(drive.base.pose.x - stop.x) < 0.06
    speeds = np.array([v for v in drive.told[begin - 1 :] if v is not None])
    assert -np.diff(speeds).min() <= a_m_s2 * 1e-9 * STEP_NS * 1.05 + 0.011, "then the rest at once"
    assert drive.told[-1] is None


def test_braking_harder_on_the_way_to_a_stop_is_done_and_more_gently_is_not() -> None:
    limits = LimitsConfig(a_m_s2=0.4, jerk_m_s3=2.0)
    drive = Drive(Config(limits=limits))
    drive.go_on(2.5)
    now_ns, follower = drive.base.now_ns, drive.follower
    follower.brake(now_ns, limits.a_m_s2)
    gentle = follower.report.stop_in("map")
    drive.go_on(0.1)
    follower.brake(drive.base.now_ns, limits.a_stop_m_s2)
    hard = follower.report.stop_in("map")
    follower.brake(drive.base.now_ns, limits.a_m_s2)
    assert gentle is not None
    assert hard is not None
    assert follower.report.stop_in("map") == hard
    assert hard.x < gentle.x - 0.03
    drive.go_on(1.0)
    assert drive.status is FollowStatus.STOPPED
    assert drive.base.pose.x - hard.x < 0.06


def test_after_a_stop_zero_is_said_for_a_moment_and_then_nothing(drive: Drive) -> None:
    assert drive.follower.end(drive.base.now_ns, "cancelled") == STOP
    assert drive.follower.end(drive.base.now_ns, "again") is None
    begin = len(drive.told)
    drive.go_on(1.0)
    said = drive.told[begin:]
    assert said[:8] == [0.0] * 8
    assert said[10:] == [None] * len(said[10:])


def test_a_report_is_the_same_after_the_wire_and_what_is_none_is_named(drive: Drive) -> None:
    drive.follower.brake(drive.base.now_ns, LIMITS.a_m_s2)
    drive.go_on(0.1)
    report = drive.follower.report
    assert decode_report(report.encode()) == report
    assert report.stop is not None
    assert not report.says_more_than(decode_report(report.encode()))
    for text in ("", "{}", '{"trajectory": 1, "status": "flying", "reason": "", "frame": "map"}'):
        with pytest.raises(InputError, match="no report of the follower"):
            decode_report(text)


def test_before_anything_came_nothing_moves() -> None:
    follower = Follower(Config())
    assert follower.step(POSE_LATE_NS, UNLOCALIZED) is None
    follower.follow(POSE_LATE_NS, ahead(SE2()), "map", 1)
    assert follower.step(2 * POSE_LATE_NS, UNLOCALIZED) == STOP

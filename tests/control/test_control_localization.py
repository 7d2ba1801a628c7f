"""The fused pose is SLAM's where there is one, odometry's in between, and not thrown by what comes late or never."""

import math

import numpy as np
import pytest

from vsx_ros.control.localization import Localization
from vsx_ros.errors import InputError
from vsx_ros.geometry.se2 import SE2, integrate
from vsx_ros.robot import Odometry, OdometryEpochs

MS = 1_000_000


def close(a: SE2 | None, b: SE2, metres: float, radians: float) -> bool:
    return a is not None and a.distance_to(b) <= metres and abs(a.angle_to(b)) <= radians


def test_before_the_first_slam_pose_there_is_none():
    fuser = Localization()
    assert fuser.pose() is None
    assert math.isinf(fuser.slam_age_s(5))
    fuser.add_odometry(Odometry(0, SE2()))
    assert fuser.pose() is None


def test_without_odometry_the_last_slam_pose_is_given():
    fuser = Localization()
    fuser.add_pose(10 * MS, SE2(1.0, 2.0, 3.0))
    assert fuser.pose() == SE2(1.0, 2.0, 3.0)
    assert fuser.slam_age_s(510 * MS) == pytest.approx(0.5)


def test_a_late_pose_is_compared_with_the_odometry_of_its_own_instant():
    fuser = Localization()
    T_world_odom = SE2(3.0, -1.0, 1.2)
    odom = SE2(0.5, 0.2, -0.3)
    poses = {}
    for k in range(60):  # 50 Hz
        poses[k] = odom
        fuser.add_odometry(Odometry(k * 20 * MS, odom, 0.25, 0.2))
        if k >= 10:
            fuser.add_pose((k - 10) * 20 * MS, T_world_odom @ poses[k - 10])  # 200 ms late
            assert close(fuser.pose(), T_world_odom @ odom, 1e-6, 1e-6)
        odom = integrate(odom, 0.25 * 0.02, 0.2 * 0.02)


def test_noise_is_smoothed_and_a_bend_of_the_wheels_learnt():
    rng = np.random.default_rng(1)
    fuser = Localization()
    true, odom = SE2(), SE2()
    errors = []
    for k in range(1500):
        stamp = k * 20 * MS
        fuser.add_odometry(Odometry(stamp, odom, 0.25, 0.0))
        if k % 3 == 0:
            seen = SE2(true.x + rng.normal(0, 0.01), true.y + rng.normal(0, 0.01), true.theta + rng.normal(0, 0.007))
            fuser.add_pose(stamp, seen)
        pose = fuser.pose()
        assert pose is not None
        if k > 500:
            errors.append((pose.distance_to(true), abs(pose.angle_to(true))))
        odom = integrate(odom, 0.005, 0.0)
        true = integrate(true, 0.005, 0.15 * 0.005)  # bends by 0.15 rad per metre
    position, heading = np.median(errors, axis=0)
    assert 1e-4 < position < 0.008
    assert 1e-5 < heading < 0.006
    # Half a second without SLAM: the learnt bend carries on.
    for k in range(1500, 1525):
        fuser.add_odometry(Odometry(k * 20 * MS, odom, 0.25, 0.0))
        odom, true = integrate(odom, 0.005, 0.0), integrate(true, 0.005, 0.15 * 0.005)
    pose = fuser.pose()
    assert pose is not None
    assert abs(pose.angle_to(true)) < 0.012


AHEAD, BACK = (0.3, 0.0), (-0.3, 0.0)  # m/s, rad/s


def bent_drive(bend_rad_m: float, *legs: tuple[tuple[float, float], float, bool]) -> tuple[SE2, SE2]:
    """Where the base is believed to be and where it is, after legs of (twist, seconds, whether the camera sees), on
    wheels of which odometry does not know that they bend the way."""
    rng, fuser, true, odom, now_ns = np.random.default_rng(0), Localization(), SE2(), SE2(), 0
    for (v, omega), seconds, seen in legs:
        for k in range(round(50 * seconds)):
            now_ns += 20 * MS
            odom = integrate(odom, 0.02 * v, 0.02 * omega)
            true = integrate(true, 0.02 * v, 0.02 * (omega + bend_rad_m * v))
            fuser.add_odometry(Odometry(now_ns, odom, v, omega))
            if seen and k % 2 == 0:
                x, y, theta = rng.normal(0.0, 0.003, 3).tolist()
                fuser.add_pose(now_ns, SE2(true.x + x, true.y + y, true.theta + theta))
    pose = fuser.pose()
    assert pose is not None
    return pose, true


@pytest.mark.parametrize("bend_rad_m", [0.05, -0.1])
@pytest.mark.parametrize(
    "legs",
    [
        [(AHEAD, 20.0, True), (AHEAD, 3.4, False)],
        [(AHEAD, 20.0, True), (BACK, 3.4, False)],
        [(BACK, 20.0, True), (AHEAD, 3.4, False)],
        [(AHEAD, 20.0, True), (BACK, 4.0, True), (BACK, 3.4, False)],
        [(AHEAD, 20.0, True), ((0.0, 1.0), 2.0, False), (AHEAD, 3.4, False)],
    ],
    ids=["ahead", "back", "learnt back", "learnt both ways", "ahead after a turn"],
)
def test_wheels_that_bend_the_way_bend_it_back_in_reverse(bend_rad_m, legs):
    """A metre without the camera; its bend of the wrong sign would be 6 or 11 degrees."""
    assert close(*bent_drive(bend_rad_m, *legs), 0.02, math.radians(1.2))


def test_a_relocalisation_is_believed_at_once():
    fuser = Localization()
    for k in range(5):
        fuser.add_odometry(Odometry(k * 20 * MS, SE2()))
        fuser.add_pose(k * 20 * MS, SE2(0.0, 0.0, 0.0))
    fuser.add_odometry(Odometry(100 * MS, SE2()))
    fuser.add_pose(100 * MS, SE2(2.0, 0.0, 0.0))
    assert close(fuser.pose(), SE2(2.0, 0.0, 0.0), 1e-9, 1e-9)


def test_a_corrected_map_is_believed_at_once_and_a_single_wrong_pose_is_not():
    fuser, here, there = Localization(), SE2(1.0, 0.0, 0.0), SE2(1.0, 0.25, 0.02)

    def stands_at(*poses: SE2) -> SE2 | None:
        for pose in poses:
            stands_at.now_ns += 100 * MS
            fuser.add_odometry(Odometry(stands_at.now_ns, SE2()))
            fuser.add_pose(stands_at.now_ns, pose)
        return fuser.pose()

    stands_at.now_ns = 0
    assert close(stands_at(*[here] * 100), here, 1e-6, 1e-6)
    assert close(stands_at(there, here, here), here, 0.02, 0.02)
    assert close(stands_at(there, SE2(1.0, -0.2, 0.0), here, here), here, 0.02, 0.02)
    assert close(stands_at(there, there), there, 1e-6, 1e-6)


@pytest.mark.parametrize("silence_ns", [20 * MS, 4000 * MS])
def test_odometry_that_restarts_does_not_move_the_base(silence_ns: int):
    fuser, epochs, T_world_odom = Localization(), OdometryEpochs(), SE2(-4.0, 1.0, 0.3)
    odom = SE2(5.0, 3.0, 0.4)
    for k in range(40):
        fuser.add_odometry(epochs.enter(Odometry(k * 20 * MS, odom, 0.2, 0.0)))
        fuser.add_pose(k * 20 * MS, T_world_odom @ odom)
        odom = integrate(odom, 0.004, 0.0)
    true = fuser.pose()
    assert true is not None
    now = 39 * 20 * MS + silence_ns
    fuser.add_odometry(epochs.enter(Odometry(now, SE2())))
    assert close(fuser.pose(), true, 1e-9, 1e-9)
    fuser.add_pose(now - silence_ns // 2, true)  # of an image between the two epochs
    odom = SE2()
    for k in range(1, 40):
        odom, true = integrate(odom, 0.004, 0.0), integrate(true, 0.004, 0.0)
        fuser.add_odometry(epochs.enter(Odometry(now + k * 20 * MS, odom, 0.2, 0.0)))
        assert close(fuser.pose(), true, 0.01, 0.02)
        fuser.add_pose(now + k * 20 * MS, true)
    assert epochs.enter(Odometry(now + 1000 * MS, odom)).odom_epoch == 1
    assert close(fuser.pose(), true, 0.002, 0.002)


def test_a_base_that_was_moved_while_its_wheels_were_silent_is_found_where_the_camera_sees_it():
    fuser, epochs = Localization(), OdometryEpochs()
    for k in range(20):
        fuser.add_odometry(epochs.enter(Odometry(k * 20 * MS, SE2(5.0, 3.0, 0.4))))
        fuser.add_pose(k * 20 * MS, SE2(1.0, 0.0, 0.0))
    fuser.add_odometry(epochs.enter(Odometry(5000 * MS, SE2())))
    fuser.add_pose(5000 * MS, SE2(1.2, 0.1, 0.2))
    assert close(fuser.pose(), SE2(1.2, 0.1, 0.2), 0.005, 0.005)


def test_old_and_broken_input():
    fuser = Localization()
    fuser.add_odometry(Odometry(100 * MS, SE2(1.0, 0.0, 0.0)))
    fuser.add_odometry(Odometry(50 * MS, SE2(9.0, 0.0, 0.0)))  # older: ignored
    fuser.add_pose(10 * MS, SE2(5.0, 5.0, 0.0))  # from before the odometry: no correction
    assert fuser.pose() is None
    fuser.add_pose(100 * MS, SE2(0.0, 0.0, 0.0))
    fuser.add_pose(90 * MS, SE2(7.0, 7.0, 0.0))  # out of order: ignored
    assert close(fuser.pose(), SE2(), 1e-12, 1e-12)
    with pytest.raises(InputError, match="odometry"):
        fuser.add_odometry(Odometry(200 * MS, SE2(math.nan, 0.0, 0.0)))
    with pytest.raises(InputError, match="cannot be"):
        fuser.add_odometry(Odometry(200 * MS, SE2(1e300, 0.0, 0.0)))
    with pytest.raises(InputError, match="SLAM"):
        fuser.add_pose(200 * MS, SE2(0.0, math.inf, 0.0))


def test_after_the_clock_was_set_back_readings_and_poses_count_from_then_on():
    fuser, epochs = Localization(), OdometryEpochs()
    at = 1_000_000 * MS

    def drive(since_ns: int, begin_m: float) -> list[bool]:
        readings = [Odometry(since_ns + k * 20 * MS, SE2(begin_m + 0.002 * k, 0.0, 0.0), 0.1) for k in range(50)]
        return [fuser.add_odometry(epochs.enter(reading)) for reading in readings]

    drive(at, 0.0)
    fuser.add_pose(at + 980 * MS, SE2(5.098, 0.0, 0.0))
    back = at - 3_600_000 * MS
    assert all(drive(back, 0.1))
    assert close(fuser.pose(), SE2(5.198, 0.0, 0.0), 1e-6, 1e-6), "odometry goes on: only the clock has changed"
    assert math.isinf(fuser.slam_age_s(back + 1000 * MS)), "no image of the present time yet"
    for k in range(40, 50):
        fuser.add_pose(back + 20 * k * MS, SE2(7.0, 1.0, 0.5))
    assert close(fuser.pose(), SE2(7.0, 1.0, 0.5), 0.01, 0.01)
    assert fuser.slam_age_s(back + 1000 * MS) == pytest.approx(0.02)


def test_a_reading_that_is_a_little_older_is_out_of_order_and_no_clock_set_back():
    fuser = Localization()
    fuser.add_odometry(Odometry(5000 * MS, SE2(1.0, 0.0, 0.0)))
    fuser.add_pose(5000 * MS, SE2(1.0, 0.0, 0.0))
    assert not fuser.add_odometry(Odometry(4900 * MS, SE2()))
    fuser.add_pose(4900 * MS, SE2())
    assert fuser.pose() == SE2(1.0, 0.0, 0.0)

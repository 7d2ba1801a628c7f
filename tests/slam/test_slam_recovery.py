"""A lost camera: how far from the wheels' pose it is looked for, and when it must have been carried away."""

import numpy as np
import pytest

from vsx_ros.config import Config
from vsx_ros.geometry.mount import mount_pose
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3
from vsx_ros.slam.recovery import Recovery
from vsx_ros.slam.relocalizer import REACH_M
from vsx_ros.slam.slam import SequentialSlam

MOUNT = mount_pose(-0.09, 0.0, 0.31, 0.05)


@pytest.fixture
def lost(arc_drive):
    """The recovery of a camera that was tracked at frame 40, and the frame ``k`` of the drive with the wheels at x."""
    slam = SequentialSlam(arc_drive.camera, arc_drive.T_base_cam, Config().slam, 1)
    front = slam._front
    frames = [front._preprocessor.take(*arc_drive.frames[k][:2], metric=True) for k in range(41)]
    motion = front._motion
    recovery = Recovery(arc_drive.camera, arc_drive.T_base_cam, Config().slam, front._tracker, motion)

    def frame(k, x=0.0, heading=0.0):
        return frames[k]._replace(T_odom_base=SE2(x, 0.0, heading))

    motion.update(frame(40), SE3.identity(), measured=True)
    recovery.over(frame(40))
    return recovery, frame


def slip(recovery, frame):
    """How far [m] the wheels may have slipped, once a frame more is lost."""
    by_odometry = recovery._motion.predict(frame).T_world_cam
    recovery._travel(by_odometry)
    recovery._motion.update(frame, by_odometry, measured=False)
    return recovery.expected_pose(by_odometry, 0).slip


def test_wheels_that_stand_leave_the_camera_where_it_was(lost):
    recovery, frame = lost
    begin = slip(recovery, frame(40))
    for _ in range(50):
        recovery.missed(frame(40))
        again = slip(recovery, frame(40))
    assert again == pytest.approx(begin)
    assert REACH_M + begin < 0.1, "the next brick of a wall is 0.2 m away"


def test_the_way_by_the_wheels_widens_where_the_camera_can_be(lost):
    recovery, frame = lost
    begin = slip(recovery, frame(40))
    for x in np.arange(0.0, 1.01, 0.1):
        there = slip(recovery, frame(40, x))
    back = slip(recovery, frame(40))
    assert there == pytest.approx(begin + 0.1, abs=0.01)
    assert back == pytest.approx(begin + 0.2, abs=0.02), "the way back is way too"


@pytest.mark.parametrize(
    ("error", "allowed"), [(SE2(0.05, 0.0, 0.04), True), (SE2(0.1, 0.0, 0.0), False), (SE2(0.0, 0.0, 0.1), False)]
)
def test_a_camera_on_wheels_errs_along_the_floor(lost, error, allowed):
    recovery, frame = lost
    expected = SE3.from_se2(SE2(2.0, 1.0, 0.7)) @ MOUNT
    recovery._T_base_cam = MOUNT
    expected_pose = recovery.expected_pose(expected, 0)
    assert expected_pose.allows(SE3.from_se2(SE2(2.0, 1.0, 0.7) @ error) @ MOUNT, 0) == allowed
    assert not expected_pose.allows(expected, 1), "another map"


@pytest.mark.parametrize("off", [SE3(np.eye(3), np.array([0.0, 0.0, -0.04])), SE3.exp(np.array([0, 0, 0, 0.06, 0, 0]))])
def test_a_camera_on_wheels_stays_on_the_floor(lost, off):
    recovery, frame = lost
    expected = SE3.from_se2(SE2(2.0, 1.0, 0.7)) @ MOUNT
    recovery._T_base_cam, recovery._way_m = MOUNT, 3.0
    expected_pose = recovery.expected_pose(expected, 0)
    assert expected_pose.allows(expected, 0)
    assert not expected_pose.allows(off @ expected, 0)


def test_only_another_image_before_wheels_that_stood_was_carried_there(lost):
    recovery, frame = lost
    for _ in range(50):
        assert not recovery.missed(frame(39)), "much the same image, that nothing is found in"
    other = frame(0)._replace(small=-frame(0).small)
    assert [recovery.missed(other) for _ in range(25)].count(True) == 1
    assert recovery.carried
    assert not recovery.expected_pose(SE3.identity(), 0).is_firm


@pytest.mark.parametrize("rate_hz", [5, 60])
def test_a_second_map_begins_after_a_second_at_any_rate(lost, rate_hz):
    recovery, frame = lost
    for k in range(1, 2 * rate_hz):
        other = frame(k % 40)._replace(stamp_ns=frame(40).stamp_ns + round(k * 1e9 / rate_hz))
        recovery.missed(other)
        recovery.second_map(other, has_odometry=False)
        if recovery._initializer is not None:
            break
    assert (k - 1) / rate_hz == pytest.approx(1.0, abs=1.0 / rate_hz)

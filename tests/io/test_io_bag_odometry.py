"""Odometry of a bag: which is believed, and what is made of it."""

import math

import numpy as np
import pytest
from ros1_bags import T, header, image, numbers, odometry, write

from vsx_ros.config import OdometryConfig
from vsx_ros.errors import InputError
from vsx_ros.io.bag import open_recording


def test_odometry_is_interpolated_within_carried_on_and_absent_far_outside(drive):
    recording = open_recording(drive)
    assert recording.odometry_at(5 * 10**7).T_odom_base.x == pytest.approx(0.01, abs=1e-6)
    assert recording.odometry_at(6 * 10**8).T_odom_base.x == pytest.approx(0.12, abs=1e-5)
    assert recording.odometry_at(6 * 10**8 + 1) is None
    assert recording.odometry_at(-1) is None


def test_odometry_that_its_driver_does_not_trust_is_not_trusted(tmp_path):
    messages = [("/odom", odometry(k * 10**8, 0.0, variance)) for k, variance in enumerate((0.01, 1.0, 1e3))]
    messages += [("/camera/rgb/image_raw", image(10**8))]
    readings = open_recording(write(tmp_path / "doubt.bag", messages)).odometry
    assert [reading.trusted for reading in readings] == [True, False, False]


def test_odometry_is_sorted_and_what_is_left_out_told(tmp_path):
    stamps = [10**12 + k * 10**8 for k in (0, 2, 1, 3, 3, 4)]
    messages = [("/odom", odometry(s, 0.0)) for s in (*stamps[:3], 10**15, *stamps[3:])]
    recording = open_recording(write(tmp_path / "d.bag", [*messages, ("/image", image(10**12))]))
    assert [reading.stamp_ns for reading in recording.odometry] == sorted(set(stamps))
    assert recording.damage == "2 readings of /odom left out: their stamps are those of others or out of order"


def test_speeds_from_poses_are_those_of_the_order_of_stamps(tmp_path):
    def pose(stamp_ns, x):
        at = odometry(stamp_ns, x).pose.pose
        return T["geometry_msgs/msg/PoseStamped"](header(stamp_ns), at)

    messages = [("/pose", pose(10**9 + k * 10**8, 0.02 * k)) for k in (0, 2, 1, 3)]
    path = write(tmp_path / "p.bag", [*messages, ("/image", image(10**9))])
    readings = open_recording(path, odometry_topic="/pose").odometry
    assert [reading.v for reading in readings[1:]] == pytest.approx([0.2] * 3)


def test_odometry_whose_driver_tells_no_speeds_has_those_of_its_poses(tmp_path):
    readings = [odometry(10**9 + k * 10**8, 0.02 * k) for k in range(4)]
    for reading in readings:
        reading.twist.twist.linear.x = reading.twist.twist.angular.z = 0.0
    messages = [("/odom", reading) for reading in readings]
    path = write(tmp_path / "n.bag", [*messages, ("/image", image(10**9))])
    assert [reading.v for reading in open_recording(path).odometry] == pytest.approx([0.0, 0.2, 0.2, 0.2])


def test_odometry_is_not_looked_at_if_none_is_wanted(tmp_path):
    messages = [("/a/odom", odometry(1, 0.0)), ("/b/odom", odometry(1, np.nan)), ("/image", image(1))]
    path = write(tmp_path / "n.bag", messages)
    with pytest.raises(InputError, match="several odometry topics; choose one with --odometry-topic, or none: /a/odom"):
        open_recording(path)
    recording = open_recording(path, odometry_topic="none")
    assert (recording.odometry, recording.odometry_topic, recording.damage) == ([], None, "")
    assert len(list(recording.frames())) == 1


@pytest.mark.parametrize(
    ("offset_s", "used"), [(0, True), (2.65, True), (2.95, False), (-3.15, False), (-1.5e9, False)]
)
def test_odometry_of_another_clock_is_not_used_and_the_clocks_are_told(tmp_path, offset_s, used):
    stamps = [1_600_000_000 * 10**9 + k * 10**8 for k in range(30)]
    messages = [("/image", image(s)) for s in stamps]
    messages += [("/odom", odometry(s + round(1e9 * offset_s), 0.01 * k)) for k, s in enumerate(stamps)]
    recording = open_recording(write(tmp_path / "k.bag", messages))
    assert bool(recording.odometry) is bool(recording.odometry_topic) is used
    told = "odometry of /odom is not used, as 0 of 30 images have any: its stamps are from"
    assert recording.damage.startswith(told) if not used else recording.damage == ""


def test_odometry_too_far_away_is_not_used(tmp_path):
    messages = [m for k in range(1, 9) for m in (("/image", image(k)), ("/odom", odometry(k, 5e5)))]
    recording = open_recording(write(tmp_path / "u.bag", messages))
    assert recording.odometry == []
    assert "0 of 8 images have any: odometry at (500000, 0) m" in recording.damage


def test_odometry_of_a_camera_in_the_hand_is_not_that_of_wheels(tmp_path):
    messages = [("/image", image(k * 10**8 + 1)) for k in range(20)]
    for k in range(20):
        reading = odometry(k * 10**8 + 1, 0.01 * k)
        reading.pose.pose.orientation.x, reading.pose.pose.orientation.w = math.sin(0.2), math.cos(0.2)
        messages.append(("/vio/odom", reading))
    recording = open_recording(write(tmp_path / "h.bag", messages))
    assert (recording.odometry, recording.odometry_topic) == ([], None)
    told = (
        "odometry of /vio/odom is not used: 20 of 20 poses are none of wheels on a floor (up to 23 deg of tilt, 0.0 m"
    )
    assert recording.damage.startswith(told)


def test_odometry_at_a_tenth_of_the_images_is_enough(tmp_path):
    messages = [("/image", image(k * 10**8 + 1)) for k in range(50)]
    messages += [("/odom", odometry(k * 10**8 + 1, 0.0)) for k in range(45, 50)]
    assert len(open_recording(write(tmp_path / "late.bag", messages)).odometry) == 5
    gone = [("/odom", odometry(k * 10**8 + 1, 0.0)) for k in range(48, 60)]
    assert (
        open_recording(write(tmp_path / "few.bag", messages[:50] + gone)).damage.count("2 of 50 images have any") == 1
    )


@pytest.mark.parametrize("kind", ["PoseStamped", "PoseWithCovarianceStamped"])
def test_poses_serve_as_odometry_when_asked_for(tmp_path, kind):
    def pose(stamp_ns, x):
        stamped = odometry(stamp_ns, x)
        held = stamped.pose.pose if kind == "PoseStamped" else stamped.pose
        return T[f"geometry_msgs/msg/{kind}"](header(stamp_ns), held)

    messages = [("/image", image(10**8)), *(("/robot_pose", pose(i * 10**8, 0.03 * i)) for i in range(4))]
    path = write(tmp_path / "p.bag", messages)
    assert open_recording(path).odometry == []
    readings = open_recording(path, odometry_topic="robot_pose").odometry
    assert [reading.T_odom_base.x for reading in readings] == pytest.approx([0.0, 0.03, 0.06, 0.09])
    assert [reading.v for reading in readings] == pytest.approx([0.0, 0.3, 0.3, 0.3], rel=1e-4)
    assert all(reading.omega == 0.0 for reading in readings)


@pytest.mark.parametrize("space", ["", "/robot"])
def test_the_factors_that_the_base_told_are_the_recordings_each_once(tmp_path, space):
    """A node that starts again tells them again; those of another robot are of no interest."""
    told = [(f"{space}/mobile_base/odometry_factors", numbers(factors)) for factors in ((0.974, 1.02),) * 2]
    other = [("/other/mobile_base/odometry_factors", numbers((0.9, 0.9)))]
    drive = [(f"{space}/odom", odometry(10**8, 0.0)), ("/camera/rgb/image_raw", image(10**8))]
    recording = open_recording(write(tmp_path / "a.bag", told + other + drive))
    assert recording.factors == (OdometryConfig(0.974, 1.02),)
    assert open_recording(write(tmp_path / "b.bag", other + drive)).factors == ()
    assert open_recording(tmp_path / "a.bag", None, "none").factors == ()


@pytest.mark.parametrize("factors", [[], [1.0], [1.0, 0.0], [1.0, np.nan], [1.0, 1.0, 1.0]])
def test_factors_that_cannot_be_are_one_sentence(tmp_path, factors):
    path = write(tmp_path / "a.bag", [("/mobile_base/odometry_factors", numbers(factors)),
                                      ("/odom", odometry(1, 0.0)), ("/image", image(1))])  # fmt: skip
    with pytest.raises(InputError, match="the factors of distance and turn"):
        _ = open_recording(path)

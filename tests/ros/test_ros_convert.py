"""Conversions need neither node nor master, so they are tested like any function."""

import math

import numpy as np
import pytest

pytest.importorskip("rospy")

from geometry_msgs.msg import Pose, Quaternion
from hypothesis import given
from hypothesis import strategies as st
from sensor_msgs.msg import Image
from std_msgs.msg import Float64MultiArray

from vsx_ros.config import MountConfig
from vsx_ros.errors import CalibrationError, InputError, MapFileError
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.geometry.mount import mount_pose
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3
from vsx_ros.occupancy.grid import OccupancyGrid
from vsx_ros.planning.path import Trajectory
from vsx_ros.robot import Odometry
from vsx_ros.ros import convert, driving, images, topics

STAMP_NS = 1_700_000_000_123_456_789
metres = st.floats(-50, 50)
angles = st.floats(-3.1, 3.1)


def padded_image(encoding: str, pixels: np.ndarray, padding: int) -> Image:
    rows = pixels.reshape(len(pixels), -1)
    wide = np.full((rows.shape[0], rows.shape[1] + padding), 99, np.uint8)
    wide[:, : rows.shape[1]] = rows
    msg = images.image_msg(STAMP_NS, pixels, encoding, topics.OPTICAL_FRAME)
    msg.step, msg.data = wide.shape[1], wide.tobytes()
    return msg


@pytest.mark.parametrize("padding", [0, 5])
def test_mono8_survives_the_journey_with_padded_rows(padding: int) -> None:
    pixels = np.random.default_rng(0).integers(0, 256, (20, 30), np.uint8)
    frame = images.Frames().of(padded_image("mono8", pixels, padding))
    assert frame.stamp_ns == STAMP_NS
    np.testing.assert_array_equal(frame.image, pixels)


def test_a_camera_of_twelve_bits_is_as_bright_as_in_a_recording() -> None:
    """Its 4095 is not the 65535 of the encoding: dropping eight bits left 16 of 256 grey levels."""
    values = np.linspace(0, 4095, 600).astype("<u2").reshape(20, 30)
    frames = images.Frames()
    msg = Image(encoding="mono16", height=20, width=30, step=60, data=values.tobytes())
    np.testing.assert_array_equal(frames.of(msg).image, values // 16)


@pytest.mark.parametrize(("encoding", "red_channel"), [("rgb8", 0), ("bgr8", 2)])
def test_colour_order_is_honoured(encoding: str, red_channel: int) -> None:
    pixels = np.zeros((16, 16, 3), np.uint8)
    pixels[..., red_channel] = 200
    gray = images.Frames().of(padded_image(encoding, pixels, 3)).image
    np.testing.assert_allclose(gray, 0.299 * 200, atol=1)


@pytest.mark.parametrize("pattern", ["rggb", "grbg", "gbrg", "bggr"])
def test_bayer_pattern_names_the_first_two_rows(pattern: str) -> None:
    colour = {"r": 200, "g": 100, "b": 30}
    cell = np.array([colour[letter] for letter in pattern], np.uint8).reshape(2, 2)
    gray = images.Frames().of(padded_image(f"bayer_{pattern}8", np.tile(cell, (8, 8)), 2)).image
    expected = 0.299 * 200 + 0.587 * 100 + 0.114 * 30
    np.testing.assert_allclose(gray[2:-2, 2:-2], expected, atol=2)


def test_damaged_images_are_refused() -> None:
    pixels = np.zeros((16, 16), np.uint8)
    short = images.image_msg(STAMP_NS, pixels, "mono8", "c")
    short.data = short.data[:-1]
    unknown = images.image_msg(STAMP_NS, pixels, "mono8", "c")
    unknown.encoding = "yuv422"
    for msg in (short, unknown):
        with pytest.raises(InputError):
            images.Frames().of(msg)


def test_camera_info_round_trip_and_refusals() -> None:
    camera = PinholeCamera(640, 480, 525.1, 524.2, 319.5, 239.5, (0.1, -0.2, 0.001, -0.002, 0.05))
    wide = PinholeCamera(640, 480, 203.0, 203.0, 319.5, 239.5, (0.1, -0.2, 0.3, -0.4), "equidistant")
    assert images.camera(images.camera_info(wide, STAMP_NS, topics.OPTICAL_FRAME)) == wide
    msg = images.camera_info(camera, STAMP_NS, topics.OPTICAL_FRAME)
    assert images.camera(msg) == camera
    msg.binning_x = 2
    with pytest.raises(CalibrationError, match="binning"):
        images.camera(msg)
    msg.binning_x, msg.K = 0, [0.0] * 9
    with pytest.raises(CalibrationError, match="no calibration"):
        images.camera(msg)


@given(metres, metres, angles)
def test_poses_on_the_floor_survive(x: float, y: float, theta: float) -> None:
    T = convert.se2(convert.pose_msg(SE2(x, y, theta)))
    assert (T.x, T.y) == (x, y)
    assert abs(SE2(x, y, theta).angle_to(T)) < 1e-9


def test_poses_in_space_survive() -> None:
    T = SE3.exp(np.array([1.0, -2.0, 0.5, 0.3, -0.9, 1.4]))
    np.testing.assert_allclose(convert.se3(convert.pose_msg(T)).matrix(), T.matrix(), atol=1e-12)


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_poses_that_are_no_poses_are_refused(bad: float) -> None:
    pose = convert.pose_msg(SE2(1.0, 2.0, 0.0))
    pose.position.x = bad
    with pytest.raises(InputError):
        convert.se3(pose)
    with pytest.raises(InputError):
        convert.se3(Pose())  # an unset quaternion has length zero


NO_ROTATIONS = [(0.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1e200), (math.inf, 0.0, 0.0, 1.0), (0.0, 0.0, math.nan, 1.0)]


@pytest.mark.parametrize("numbers", NO_ROTATIONS)
def test_quaternions_that_are_no_rotations_are_refused(numbers: tuple[float, ...]) -> None:
    with pytest.raises(InputError, match="pose message holds"):
        convert.se2(Pose(orientation=Quaternion(*numbers)))
    msg = driving.trajectory_msg(Trajectory(np.zeros(1), np.zeros((1, 3)), np.zeros(1), np.zeros(1)), "map", 0)
    msg.points[0].transforms[0].rotation = Quaternion(*numbers)
    with pytest.raises(InputError, match="pose message holds"):
        driving.wanted(msg)


@given(metres, metres, angles, st.floats(-1, 1), st.floats(-3, 3))
def test_odometry_survives(x: float, y: float, theta: float, v: float, omega: float) -> None:
    reading = Odometry(STAMP_NS, SE2(x, y, theta), v, omega)
    back = convert.odometry(convert.odometry_msg(reading, topics.ODOM_FRAME, topics.BASE_FRAME))
    assert (back.stamp_ns, back.v, back.omega) == (STAMP_NS, v, omega)
    assert back.T_odom_base.distance_to(reading.T_odom_base) < 1e-9


def test_odometry_of_what_is_carried_is_refused() -> None:
    msg = convert.odometry_msg(Odometry(STAMP_NS, SE2(1.0, 2.0, 0.5), 0.0, 0.0), topics.ODOM_FRAME, topics.BASE_FRAME)
    msg.pose.pose.orientation = Quaternion(math.sin(0.15), 0.0, 0.0, math.cos(0.15))
    with pytest.raises(InputError, match="odometry is tilted by 17 deg, as no base on wheels is"):
        convert.odometry(msg)


def test_maps_survive_and_other_mappers_probabilities_are_thresholded() -> None:
    data = np.array([[-1, 0, 100], [100, -1, 0]], np.int8)
    msg = convert.grid_msg(OccupancyGrid(data, 0.05, -1.5, 2.0), topics.MAP_FRAME, STAMP_NS)
    back = convert.grid(msg)
    np.testing.assert_array_equal(back.data, data)
    assert (back.origin_x, back.origin_y) == (-1.5, 2.0)
    msg.data = [10, 40, 70, 65, 19, -1]
    np.testing.assert_array_equal(convert.grid(msg).data, [[0, -1, 100], [100, 0, -1]])


def test_maps_that_lie_are_refused() -> None:
    grid = OccupancyGrid(np.zeros((2, 3), np.int8), 0.05, 0.0, 0.0)
    short = convert.grid_msg(grid, "map", STAMP_NS)
    short.data = short.data[:-1]
    rotated = convert.grid_msg(grid, "map", STAMP_NS)
    rotated.info.origin = convert.pose_msg(SE2(0.0, 0.0, 0.3))
    for msg in (short, rotated):
        with pytest.raises(MapFileError):
            convert.grid(msg)


def test_places_of_keyframes_survive_and_others_are_refused() -> None:
    cameras = [SE3.from_quaternion(np.array([1.0, k, 0.3]), (-0.5, 0.5, -0.5, 0.5)) for k in range(3)]
    msg = convert.places_msg(np.array([0, 4, 7]), cameras)
    places = convert.keyframe_places(msg)
    assert places.ids.tolist() == [0, 4, 7]
    np.testing.assert_allclose(places.poses, [[1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [1.0, 2.0, 0.0]], atol=1e-12)
    assert convert.keyframe_places(convert.places_msg(np.zeros(0, np.int64), [])).poses.shape == (0, 3)
    for numbers in (msg.data[:-1], msg.data[4:] + msg.data[:4], [0.0, math.nan, 0.0, 0.0]):
        with pytest.raises(InputError, match="no places of keyframes"):
            convert.keyframe_places(Float64MultiArray(data=numbers))


def test_clouds_survive_in_single_precision() -> None:
    points = np.random.default_rng(1).normal(size=(50, 3))
    np.testing.assert_allclose(convert.cloud_points(convert.cloud_msg(points, "map", 0)), points, atol=1e-6)
    assert convert.cloud_points(convert.cloud_msg(np.zeros((0, 3)), "map", 0)).shape == (0, 3)


def test_the_mount_chain_multiplies_to_the_mount() -> None:
    mount = MountConfig(forward_m=-0.09, left_m=0.02, height_m=0.31, pitch_down_rad=0.1, yaw_left_rad=-0.05)
    product = SE3.identity()
    parent = topics.BASE_FRAME
    *chain, gyro = convert.mount_transforms(mount, STAMP_NS)
    assert (gyro.header.frame_id, gyro.child_frame_id) == (topics.BODY_FRAME, topics.GYRO_FRAME)
    for edge in chain:
        assert edge.header.frame_id == parent
        parent = edge.child_frame_id
        move, turn = edge.transform.translation, edge.transform.rotation
        product = product @ SE3.from_quaternion(np.array([move.x, move.y, move.z]), (turn.x, turn.y, turn.z, turn.w))
    assert parent == topics.OPTICAL_FRAME
    np.testing.assert_allclose(product.matrix(), mount_pose(-0.09, 0.02, 0.31, 0.1, -0.05).matrix(), atol=1e-12)


def test_trajectories_survive_with_their_headings_unwrapped() -> None:
    times = np.linspace(0.0, 4.0, 41)
    theta = np.linspace(2.5, 5.0, 41)  # passes pi, where a quaternion jumps
    poses = np.stack([np.cos(theta), np.sin(theta), theta], axis=1)
    sent = Trajectory(times, poses, np.linspace(0.0, -0.2, 41), np.full(41, 0.3))
    msg = driving.trajectory_msg(sent, topics.ODOM_FRAME, STAMP_NS)
    assert msg.header.frame_id == topics.ODOM_FRAME
    back = driving.wanted(msg)
    assert isinstance(back, Trajectory)
    np.testing.assert_allclose(back.times_s, times, atol=1e-9)
    np.testing.assert_allclose(back.poses, poses, atol=1e-9)
    np.testing.assert_array_equal(back.v, sent.v)
    np.testing.assert_array_equal(back.omega, sent.omega)


@pytest.mark.parametrize("a_m_s2", [0.4, math.inf])
def test_how_hard_to_brake_survives(a_m_s2: float) -> None:
    assert driving.wanted(driving.brake_msg(a_m_s2, "map", 0)) == a_m_s2


@pytest.mark.parametrize("a_m_s2", [0.0, -0.4, math.nan])
def test_a_deceleration_that_is_none_is_refused(a_m_s2: float) -> None:
    msg = driving.brake_msg(0.4, "map", 0)
    msg.points[0].accelerations[0].linear.x = -a_m_s2
    with pytest.raises(InputError, match="to brake by"):
        driving.wanted(msg)


def test_a_trajectory_without_speeds_is_refused() -> None:
    trajectory = Trajectory(np.array([0.0, 1.0]), np.zeros((2, 3)), np.zeros(2), np.zeros(2))
    msg = driving.trajectory_msg(trajectory, "map", 0)
    msg.points[1].velocities = []
    with pytest.raises(InputError):
        driving.wanted(msg)


def test_hazards_in_words() -> None:
    assert convert.hazard_words(0) == ""
    assert convert.hazard_words(4 | 16) == "bumper left, cliff center"


@pytest.mark.parametrize("resolution", [0.05, 0.1, 0.025, 0.5, 1.0])
def test_a_map_keeps_its_resolution_on_the_wire(resolution: float) -> None:
    sent = convert.grid_msg(OccupancyGrid(np.zeros((2, 3), np.int8), resolution, 0.0, 0.0), "map", 1)
    sent.info.resolution = float(np.float32(resolution))  # as a subscriber reads it
    assert convert.grid(sent).resolution == resolution

"""Wheels and gyro that nobody calibrated: a short drive finds them, and the map gets its true size."""

import itertools
import math
from typing import Any

import numpy as np
import pytest

from vsx_ros.calibration.corrected_odometry import CorrectedOdometry, OdometryCorrection
from vsx_ros.config import Config, overridden
from vsx_ros.geometry.camera import nominal_camera
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3
from vsx_ros.kernels.vision.patches import PATCH
from vsx_ros.robot import Odometry
from vsx_ros.session import SlamSession
from vsx_ros.slam.keyframe import FrameData, Observations
from vsx_ros.slam.map import Map
from vsx_ros.slam.mapper import Mapper
from vsx_ros.slam.recount import Recount, recount
from vsx_ros.slam.slam import SequentialSlam
from vsx_ros.slam.templates import NewTemplates


def test_a_short_drive_finds_wheels_and_gyro_and_resizes_the_map(wrong_wheels_drive: Any) -> None:
    drive = wrong_wheels_drive
    config = overridden(Config(), {"self_calibration.enabled": True})
    session = SlamSession(drive.T_base_cam, config)
    slam = session.begin(SequentialSlam, drive.camera, 1)
    for frame, odometry, _ in drive.frames:
        session.track(frame, odometry)
    assert session.calibration is not None
    now = session.calibration.correction
    assert "calibrated" in [event.kind for event in slam.drain_events()]
    assert now.linear == pytest.approx(1.1, abs=0.035)  # the mount's height is 1.6 % wrong at worst
    assert now.angular == pytest.approx(1.0 / 1.05, abs=0.015)
    assert math.degrees(now.zero) == pytest.approx(1.0, abs=0.2)
    true, seen = {frame.stamp_ns: T for frame, _, T in drive.frames}, slam.snapshot()
    there = np.array([true[int(stamp_ns)].translation for stamp_ns in seen.keyframe_stamps_ns])
    here = np.array([T.translation for T in seen.T_world_cams])
    size = np.linalg.norm(here - here[0], axis=1).sum() / np.linalg.norm(there - there[0], axis=1).sum()
    assert size == pytest.approx(1.0, abs=0.035)


def small_map() -> Map:
    """Three keyframes 1 m apart by odometry, which was ignored for the second; a point seen first in each."""
    world = Map()
    for k in range(3):
        data = FrameData.without_image(k, None if k == 1 else SE2(float(k), 0.0, 0.0))
        world.add_keyframe(data, SE3(np.eye(3), np.array([k, 0.0, 0.3])), Observations.none())
        template = NewTemplates(np.zeros((1, 4)), np.zeros((1, 2)), np.zeros((1, PATCH, PATCH), np.uint8))
        world.add_points(np.array([[k, 2.0, 0.03]]), template, k)
    return world


def test_a_map_is_resized_about_its_first_camera_and_its_odometry_goes_on_from_the_newest() -> None:
    world = small_map()
    counted = {k: SE2(1.1 * k, 0.0, 0.1 * k) for k in range(3)}
    recount(world, Recount(counted, 1.1, 3, "wheels"))
    centres = [keyframe.T_world_cam.translation for keyframe in world.keyframes]
    np.testing.assert_allclose(centres, [[1.1 * k, 0.0, 0.3] for k in range(3)], atol=1e-12)
    np.testing.assert_allclose(world.points, [[1.1 * k, 2.2, 0.003] for k in range(3)], atol=1e-12)
    first, second, third = (k.data.T_odom_base for k in world.keyframes)
    assert first is not None
    assert second is not None
    assert third is not None
    assert third.as_array() == pytest.approx([2.0, 0.0, 0.0]), "the next keyframe's odometry goes on from here"
    way = first.inverse() @ second
    assert (way.x, way.y, way.theta) == pytest.approx((1.1, 0.0, 0.1))
    assert [k.scale for k in world.keyframes] == pytest.approx([1.1] * 3)


def test_keyframes_of_another_time_keep_their_odometry() -> None:
    world = small_map()
    recount(world, Recount({2: SE2()}, 1.0, 3, "gyro"))
    assert [k.data.T_odom_base for k in world.keyframes] == [SE2(), None, SE2(2.0, 0.0, 0.0)]


def test_odometry_from_before_what_is_counted_again_follows_in_one_piece() -> None:
    world = Map()
    for k in range(6):
        data = FrameData.without_image(k, SE2(float(k), 0.0, 0.0))
        world.add_keyframe(data, SE3(np.eye(3), np.array([k, 0.0, 0.3])), Observations.none())
    counted = {k: SE2(1.0 + 0.9 * (k - 3), 0.5 * (k - 3), 0.2 * (k - 3)) for k in range(3, 6)}
    recount(world, Recount(counted, 1.0, 6, "wheels"))
    bases = [keyframe.data.T_odom_base for keyframe in world.keyframes]
    steps = [a.inverse() @ b for a, b in itertools.pairwise(bases) if a is not None and b is not None]
    np.testing.assert_allclose([step.as_array() for step in steps[:3]], [[1.0, 0.0, 0.0]] * 3, atol=1e-12)
    wanted = (counted[3].inverse() @ counted[4]).as_array()
    assert steps[3].as_array() == pytest.approx(wanted)
    assert bases[5].as_array() == pytest.approx([5.0, 0.0, 0.0])


def steps_of(world: Map) -> list[tuple[float, float]]:
    """How far keyframes ahead of each other are from the one before: by their poses, and by odometry."""
    poses = [k.T_world_cam.translation[0] for k in world.keyframes]
    odometry = [k.data.T_odom_base.x for k in world.keyframes if k.data.T_odom_base is not None]
    return list(zip(np.diff(poses).tolist(), np.diff(odometry).tolist(), strict=True))


@pytest.mark.parametrize("restart", [6, 12])
def test_the_way_before_a_restart_of_the_base_is_corrected_with_the_map(restart: int) -> None:
    """Wheels that count 4 % too much: 0.104 m for 0.1 m. The base restarts at a keyframe, the last time after all."""
    world, corrected = Map(), CorrectedOdometry()
    for k in range(12):
        corrected.take(Odometry(k, SE2(0.104 * (k if k < restart else k - restart)), odom_epoch=int(k >= restart)))
        data = FrameData.without_image(k, SE2(0.104 * k))
        world.add_keyframe(data, SE3(np.eye(3), np.array([0.104 * k, 0.0, 0.3])), Observations.none())
    if restart == 12:
        corrected.take(Odometry(12, SE2(), odom_epoch=1))
    before, corrected.correction = corrected.correction, OdometryCorrection(1.0 / 1.04)
    older = corrected.correction.since(before).of
    recount(world, Recount(corrected.counted_again(0.0), 1.0 / 1.04, 13, "wheels", older))
    np.testing.assert_allclose(steps_of(world), [(0.1, 0.1)] * 11, atol=1e-12)


def test_keyframes_of_a_loaded_map_keep_their_ways_by_odometry() -> None:
    loaded = Map()
    for k in range(3):
        loaded.add_keyframe(FrameData.without_image(k, SE2(float(k))), SE3.identity(), Observations.none())
    mapper = Mapper(nominal_camera(640, 480), None, Config().slam, loaded)
    for k in range(3, 6):
        loaded.add_keyframe(FrameData.without_image(k, SE2(float(k))), SE3.identity(), Observations.none())
    correction = OdometryCorrection(0.5)
    mapper.recount(Recount({5: SE2()}, 1.0, 6, "wheels", correction.of))
    assert [by_odometry for _, by_odometry in steps_of(loaded)] == pytest.approx([1.0, 1.0, 1.0, 0.5, 0.5])


def test_a_map_that_the_wheels_measured_before_a_restart_of_the_base_is_resized() -> None:
    world = Map()
    for k, map_id in enumerate([0, 0, 1, 1, 0, 0]):
        place = SE3(np.eye(3), np.array([k, 0.0, 0.3]))
        world.add_keyframe(FrameData.without_image(k, SE2(float(k))), place, Observations.none(), map_id)
    recount(world, Recount({5: SE2()}, 1.1, 6, "wheels"))
    x = [keyframe.T_world_cam.translation[0] for keyframe in world.keyframes]
    assert x == pytest.approx([0.0, 1.1, 2.0, 3.1, 4.4, 5.5])


def test_every_map_that_the_wheels_measured_is_resized() -> None:
    world = Map()
    for k in range(5):
        place = SE3(np.eye(3), np.array([k % 3, 0.0, 0.3]))
        data = FrameData.without_image(k, SE2(float(k), 0.0, 0.0))
        world.add_keyframe(data, place, Observations.none(), map_id=k // 3)
    recount(world, Recount({k: SE2(1.1 * k, 0.0, 0.0) for k in range(5)}, 1.1, 6, "wheels"))
    x = [keyframe.T_world_cam.translation[0] for keyframe in world.keyframes]
    assert x == pytest.approx([0.0, 1.1, 2.2, 0.0, 1.1])


def test_without_a_map_there_is_nothing_to_put_right() -> None:
    recount(Map(), Recount({0: SE2()}, 1.1, 3, "wheels"))

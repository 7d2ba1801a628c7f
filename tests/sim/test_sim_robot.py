import math

import numpy as np
import pytest

from vsx_ros.errors import ConfigError, InputError
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3
from vsx_ros.kernels.sim.raycast_cull import plane_forms
from vsx_ros.kernels.sim.raycast_pixels import expose
from vsx_ros.kernels.sim.raycast_render import render_tile_rows
from vsx_ros.kernels.warmup import warm_up
from vsx_ros.robot import STOP, VelocityCommand
from vsx_ros.sim.camera import CameraSettings
from vsx_ros.sim.robot import EmulatedRobot, SimulationConfig, WheelOdometry
from vsx_ros.sim.world import World


def test_same_seed_same_bits_other_seed_others(lab: World) -> None:
    runs = []
    for seed in (1, 1, 2):
        robot = EmulatedRobot(lab, seed)
        seen = [robot.step(VelocityCommand(0.15, 0.2)) for _ in range(4)]
        runs.append((seen, robot.truth))
    (a, truth_a), (b, truth_b), (c, truth_c) = runs
    assert all(np.array_equal(x.frame.image, y.frame.image) and x.odometry == y.odometry for x, y in zip(a, b))
    assert truth_a.T_world_base == truth_b.T_world_base
    assert truth_a.T_world_base != truth_c.T_world_base
    assert not np.array_equal(a[3].frame.image, c[3].frame.image)


def test_odometry_follows_the_truth_within_its_errors(empty_room: World) -> None:
    robot = EmulatedRobot(empty_room, 5)
    for k in range(120):
        seen = robot.step(VelocityCommand(0.2, 0.4 * math.sin(k / 12)))
    truth = robot.truth
    assert seen.frame.stamp_ns == seen.odometry.stamp_ns == truth.stamp_ns == 8_000_000_000
    start = empty_room.start_pose
    expected = start.inverse() @ truth.T_world_base
    assert truth.path_length_m == pytest.approx(0.2 * (8.0 - 0.06 - 0.08), abs=0.02)  # latency and lag
    error = expected.distance_to(seen.odometry.T_odom_base)
    assert 1e-5 < error < 0.02 * truth.path_length_m
    assert abs(expected.angle_to(seen.odometry.T_odom_base)) < 0.01
    assert seen.odometry.v == pytest.approx(0.2, abs=0.02)
    assert truth.collisions == 0


@pytest.mark.compiled
def test_warm_up_compiles_what_an_emulated_camera_uses(lab: World) -> None:
    warm_up("emulation")
    kernels = plane_forms, render_tile_rows, expose
    before = [len(kernel.compiled.signatures) for kernel in kernels]  # type: ignore[attr-defined]  # numba's
    robot = EmulatedRobot(lab, 1)
    for _ in range(3):
        robot.step(VelocityCommand(0.15, 0.2))
    assert [len(kernel.compiled.signatures) for kernel in kernels] == before  # type: ignore[attr-defined]  # as above


def test_frames_come_at_the_wanted_rate_and_are_8_bit(empty_room: World) -> None:
    robot = EmulatedRobot(empty_room, 0, SimulationConfig(frame_rate_hz=10.0))
    stamps = [robot.step(STOP).frame.stamp_ns for _ in range(3)]
    assert stamps == [100_000_000, 200_000_000, 300_000_000]
    image = robot.step(STOP).frame.image
    assert image.shape == (480, 640)
    assert image.dtype == np.uint8


def test_what_the_stack_is_given_is_slightly_wrong(empty_room: World) -> None:
    for seed in range(5):
        robot = EmulatedRobot(empty_room, seed)
        given, true = robot.camera_given, robot.camera_true
        assert 0 < abs(given.fx / true.fx - 1) <= 0.003
        assert 0 < abs(given.cx - true.cx) <= 1.0
        assert given.distortion == true.distortion
        angle = robot.T_base_cam_given.rotation_angle_to(robot.T_base_cam_true)
        assert 0 < angle <= math.radians(0.5)
        rise = robot.T_base_cam_true.translation[2] - robot.T_base_cam_given.translation[2]
        assert 0 < abs(rise) <= 0.005


def test_the_true_camera_is_the_true_mount_on_the_true_base(empty_room: World) -> None:
    robot = EmulatedRobot(empty_room, 1)
    for _ in range(5):
        robot.step(VelocityCommand(0.2, 0.3))
    truth = robot.truth
    expected = SE3.from_se2(truth.T_world_base) @ robot.T_base_cam_true
    assert truth.T_world_cam.rotation_angle_to(expected) < 0.005  # the rattle
    assert np.linalg.norm(truth.T_world_cam.translation - expected.translation) < 1e-9


def test_driving_into_a_wall_is_a_collision(empty_room: World) -> None:
    robot = EmulatedRobot(empty_room, 1)
    for _ in range(260):
        robot.body.set_wheel_speeds(0.3, 0.3)
        robot.body.advance(66_000_000)
    assert robot.body.collisions == 1
    assert robot.body.T_world_base.x == pytest.approx(6.0 - 0.18, abs=0.01)


def test_a_rate_that_leaves_no_time_to_read_out_is_refused(empty_room: World) -> None:
    slow = CameraSettings(exposure_ns=33_000_000)
    with pytest.raises(ConfigError, match="59"):
        EmulatedRobot(empty_room, 0, SimulationConfig(frame_rate_hz=20.0, camera=slow))


def test_commands_that_are_no_numbers_are_refused(empty_room: World) -> None:
    with pytest.raises(InputError, match="finite"):
        EmulatedRobot(empty_room, 0).step(VelocityCommand(math.nan, 0.0))


def test_wheel_odometry_takes_distance_from_ticks_and_heading_from_gyro() -> None:
    odometry = WheelOdometry(tick_m=0.001, wheel_base_m=0.25)
    odometry.update(1_000_000_000, (900, 1100), math.pi / 2)
    arc = 2.0 / math.pi
    assert odometry.latest.T_odom_base.x == pytest.approx(arc)
    assert odometry.latest.T_odom_base.y == pytest.approx(arc)
    assert odometry.latest.v == pytest.approx(1.0)
    assert odometry.latest.omega == pytest.approx(math.pi / 2)
    assert odometry.latest.wheel_turn == pytest.approx(0.2 / 0.25)
    odometry.update(1_000_000_000, (5000, 5000), 0.0)  # no time has passed: nothing to account for
    assert odometry.latest.T_odom_base.theta == pytest.approx(math.pi / 2)
    assert odometry.latest.T_odom_base != SE2()

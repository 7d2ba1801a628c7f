"""A run is gone on with where nothing of its map is in tracked_features: a second map begins, and both become one."""

import numpy as np

from vsx_ros.config import Config
from vsx_ros.robot import VelocityCommand
from vsx_ros.sim.generate import generate_world
from vsx_ros.sim.robot import EmulatedRobot
from vsx_ros.slam.slam import SequentialSlam
from vsx_ros.slam.state import TrackingResult

RATE_HZ = 15


def drive(robot: EmulatedRobot, slam: SequentialSlam | None, v: float, omega: float, seconds: float) -> TrackingResult:
    """The result of the last frame."""
    result = None
    for _ in range(round(seconds * RATE_HZ)):
        frame, odometry = robot.step(VelocityCommand(v, omega))
        result = slam.track(frame, odometry) if slam is not None else None
    return result


def test_a_session_begun_out_of_sight_of_its_map_is_joined_with_it() -> None:
    robot = EmulatedRobot(generate_world("lab", 3), 3)
    camera, mount, config = robot.camera_given, robot.T_base_cam_given, Config().slam
    start = robot.truth.T_world_cam
    before = SequentialSlam(camera, mount, config, 0)
    drive(robot, before, 0.2, 0.0, 6.0)
    drive(robot, before, 0.15, 0.4, 4.0)
    drive(robot, None, 0.0, 0.6, 5.0)
    slam = SequentialSlam(camera, mount, config, 0, before.slam_map())
    alone = drive(robot, slam, 0.2, 0.0, 5.0)
    assert alone.T_world_cam is None
    assert alone.map_id == 1
    drive(robot, slam, 0.12, 0.4, 8.0)
    joined = drive(robot, slam, 0.2, 0.0, 7.0)
    assert [event.kind for event in slam.drain_events() if event.kind in ("second map", "merged")] == [
        "second map",
        "merged",
    ]
    assert joined.state.tracked
    assert joined.map_id == 0
    truth = mount @ start.inverse() @ robot.truth.T_world_cam
    assert np.linalg.norm(joined.T_world_cam.translation - truth.translation) < 0.05
    old, new = before.snapshot(), slam.snapshot()
    assert np.isin(old.keyframe_stamps_ns, new.keyframe_stamps_ns).mean() > 0.8
    assert np.isin(old.rays.ids, new.rays.ids).all(), "culled keyframes keep their rays"
    moved = [
        np.linalg.norm(T.translation - new.rays.T_world_cams[k].translation)
        for k, T in enumerate(old.rays.T_world_cams)
    ]
    assert max(moved) < 0.02
    assert (new.keyframe_stamps_ns > old.keyframe_stamps_ns.max()).any()

"""Driven ground is free, until something is put there."""

import numpy as np
import pytest

from vsx_ros.config import Config, GroundMapConfig, RobotConfig
from vsx_ros.dense.mapped_ground import MappedGround
from vsx_ros.geometry.mount import mount_pose
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3
from vsx_ros.occupancy import anchored_poses
from vsx_ros.occupancy.anchored_poses import NEAREST, AnchoredPoses
from vsx_ros.occupancy.driven_ground import DriveHistory
from vsx_ros.occupancy.grid import FREE, OCCUPIED, OccupancyGrid
from vsx_ros.occupancy.ground_map import GroundMap
from vsx_ros.slam.snapshot import MapSnapshot

MOUNT = mount_pose(-0.09, 0.0, 0.31, 0.0)
EARLY, LATE = 6, 30  # keyframes
TRAIL = [*(SE2(0.05 * i, 0.0, 0.0) for i in range(60)), *(SE2(3.0 - 0.05 * i, 0.0, np.pi) for i in range(60))]


def scene(post_at_first: bool) -> tuple[list[SE3], np.ndarray, np.ndarray, np.ndarray]:
    """A wall at 4 m, and at 2 m a post 20 cm wide, which only the early keyframes see, or only the late ones."""
    rng = np.random.default_rng(0)
    wall = np.column_stack([np.full(300, 4.0), rng.uniform(-1.5, 1.5, 300), rng.uniform(0.0, 1.0, 300)])
    post = np.column_stack([rng.uniform(1.98, 2.02, 40), rng.uniform(-0.1, 0.1, 40), rng.uniform(0.08, 0.5, 40)])
    sides = [0.02 * (i % 3) for i in range(EARLY)] + [0.05 * (i % 5) - 0.1 for i in range(LATE)]
    ahead = [*range(EARLY), *range(LATE)]
    poses = [SE3.from_se2(SE2(0.05 * i, side, 0.0)) @ MOUNT for i, side in zip(ahead, sides)]
    keyframe, point = [], []
    for k, T in enumerate(poses):
        x, y = T.translation[:2]
        hidden = np.abs(y + (wall[:, 1] - y) * (2.0 - x) / (4.0 - x)) < 0.12
        stands = (k < EARLY) == post_at_first
        seen = np.flatnonzero(~(hidden & stands))
        seen = np.concatenate([seen, np.arange(300, 340)]) if stands else seen
        keyframe.append(np.full(len(seen), k))
        point.append(seen)
    return poses, np.vstack([wall, post]), np.concatenate(keyframe), np.concatenate(point)


def occupied_at_the_post(grid: OccupancyGrid) -> int:
    low, high = grid.cells(np.array([[1.85, -0.15], [2.15, 0.15]]))
    return int((grid.data[low[0] : high[0], low[1] : high[1]] == OCCUPIED).sum())


def test_a_post_that_was_put_on_driven_ground_is_an_obstacle():
    built = GroundMap(GroundMapConfig(), RobotConfig()).build
    passed = np.full(len(TRAIL), EARLY - 1)
    assert occupied_at_the_post(built(*scene(False), DriveHistory(TRAIL, passed=passed))) >= 4
    assert occupied_at_the_post(built(*scene(False), DriveHistory(TRAIL, passed=passed + LATE))) == 0
    assert occupied_at_the_post(built(*scene(False), DriveHistory(TRAIL))) == 0


def test_a_post_seen_only_before_the_pass_is_gone():
    poses, points, keyframe, point = scene(True)
    once = keyframe < EARLY + 1  # the others look through where it was
    grid = GroundMap(GroundMapConfig(), RobotConfig()).build(
        poses, points, keyframe[once], point[once], DriveHistory(TRAIL, passed=np.full(len(TRAIL), EARLY - 1))
    )
    assert grid.value_at(2.0, 0.0) == FREE
    assert occupied_at_the_post(grid) == 0


def test_a_wall_at_the_edge_of_the_way_does_not_grow_into_it():
    """It is seen before and after the pass; its points scatter over the ground that the body has covered."""
    rng, poses = np.random.default_rng(1), [SE3.from_se2(SE2(0.1 * i, 0.0, 0.3)) @ MOUNT for i in range(20)]
    wall = np.column_stack([rng.uniform(1.0, 4.0, 600), np.full(600, 0.19), rng.uniform(0.08, 0.8, 600)])
    wall[:, 1] += rng.normal(0.0, 0.03, 600)
    keyframe, point = np.repeat(np.arange(20), 600), np.tile(np.arange(600), 20)
    trail = [SE2(0.05 * i, 0.0, 0.0) for i in range(80)]
    driven = DriveHistory(trail, passed=np.full(80, 19))
    grid = GroundMap(GroundMapConfig(), RobotConfig()).build(poses, wall, keyframe, point, driven)
    assert all(grid.value_at(pose.x, 0.15) == FREE for pose in trail)


def snapshot_of(scene_: tuple[list[SE3], np.ndarray, np.ndarray, np.ndarray], n: int) -> MapSnapshot:
    """Of the first n keyframes; their ids are 10, 12, ..."""
    poses, points, keyframe, point = scene_
    known = keyframe < n
    return MapSnapshot(
        version=n, keyframe_ids=10 + 2 * np.arange(n), keyframe_stamps_ns=np.arange(n), T_world_cams=tuple(poses[:n]),
        images=(), point_ids=np.arange(len(points)), points_world=points,
        obs_keyframe=keyframe[known].astype(np.int32), obs_point=point[known].astype(np.int32),
        obs_uv=np.zeros((known.sum(), 2)), obs_level=np.zeros(known.sum(), np.int8),
    )  # fmt: skip


def test_the_ground_of_a_run_knows_when_it_was_driven_also_after_an_interruption():
    ground, seen = MappedGround(Config()), scene(False)
    ground.start = SE2(-5.0, 0.0, 0.0)
    for pose in TRAIL:
        ground.moved(pose, 1)
    assert occupied_at_the_post(ground.grid(snapshot_of(seen, EARLY))) == 0
    assert occupied_at_the_post(ground.grid(snapshot_of(seen, EARLY + LATE))) >= 4
    resumed = MappedGround(Config())
    resumed.restore(ground.state())
    assert occupied_at_the_post(resumed.grid(snapshot_of(seen, EARLY + LATE))) >= 4
    for pose in TRAIL:
        resumed.moved(pose, 2)
    assert occupied_at_the_post(resumed.grid(snapshot_of(seen, EARLY + LATE))) == 0, "driven over once more"


def test_a_session_of_an_older_version_counts_as_driven_now():
    ground, seen = MappedGround(Config()), scene(False)
    ground.start = SE2(-5.0, 0.0, 0.0)
    for pose in TRAIL:
        ground.moved(pose, 1)
    ground.grid(snapshot_of(seen, EARLY))
    state = ground.state()
    ground.restore({**state, "trail": state["trail"][:, :7]})
    assert occupied_at_the_post(ground.grid(snapshot_of(seen, EARLY + LATE))) == 0


def test_where_the_base_stands_still_is_driven_now():
    trail = AnchoredPoses(0.05)
    cameras = [SE3.from_se2(SE2(0.1 * k, 0.0, 0.0)) @ MOUNT for k in range(3)]
    for x in (0.0, 1.0):
        trail.add(SE2(x, 0.0, 0.0))
    trail.poses(np.array([3]), cameras[:1])
    trail.add(SE2(1.01, 0.0, 0.5))
    trail.poses(np.array([3, 4, 8]), cameras)
    assert trail.newest.tolist() == [3, 8]
    assert trail.state()[:, :3] == pytest.approx(np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]))


ELSEWHERE = [SE2(5.0 + 0.2 * k, 0.0, 0.0) for k in range(150)]


def drive(trail: AnchoredPoses, poses: list[SE2], *keyframe_ids: int) -> None:
    """Add these poses; the map has these keyframes then, or is not asked if there are none."""
    for pose in poses:
        trail.add(pose)
    cameras = [SE3.from_se2(SE2(0.1 * k, 0.0, 0.0)) @ MOUNT for k in range(len(keyframe_ids))]
    trail.poses(np.array(keyframe_ids, np.int64), cameras)


def newest_at_the_origin(trail: AnchoredPoses) -> int:
    near = [pose.distance_to(SE2()) < 0.1 for pose in trail.last_poses()]
    return int(trail.newest[near].max())


def test_a_long_trail_knows_when_the_base_was_last_at_a_place(monkeypatch):
    monkeypatch.setattr(anchored_poses, "_WHOLE", 100)
    trail = AnchoredPoses(0.05)
    drive(trail, [SE2()], 10)
    drive(trail, ELSEWHERE, 10, 20)
    assert newest_at_the_origin(trail) == 10
    drive(trail, [SE2(0.01, 0.0, 0.0)], 10, 20, 500)
    drive(trail, ELSEWHERE, 10, 20, 500, 600)
    assert newest_at_the_origin(trail) == 500
    drive(trail, [SE2(0.07, 0.0, 0.0)], 10, 20, 500, 600, 700)
    drive(trail, ELSEWHERE, 10, 20, 500, 600, 700, 800)
    assert newest_at_the_origin(trail) == 700
    assert len(trail) < 300


def test_in_a_long_trail_a_pass_that_no_map_was_asked_for_yet_is_the_newest(monkeypatch):
    monkeypatch.setattr(anchored_poses, "_WHOLE", 100)
    trail = AnchoredPoses(0.05)
    drive(trail, [SE2(), *ELSEWHERE], 10)
    drive(trail, [SE2(0.01, 0.0, 0.0), *ELSEWHERE])
    assert newest_at_the_origin(trail) == NEAREST
    drive(trail, [], 10, 600)
    assert newest_at_the_origin(trail) == 600

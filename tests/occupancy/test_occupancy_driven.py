"""Poses move with the keyframes they were made beside."""

import sys
import threading

import numpy as np
import pytest

from vsx_ros.config import Config
from vsx_ros.dense.mapped_ground import MappedGround
from vsx_ros.geometry.mount import mount_pose
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3
from vsx_ros.occupancy import anchored_poses
from vsx_ros.occupancy.anchored_poses import AnchoredPoses
from vsx_ros.occupancy.grid import OCCUPIED
from vsx_ros.slam.snapshot import MapSnapshot

MOUNT = mount_pose(-0.09, 0.0, 0.31, 0.1)
SECOND_NS = 1_000_000_000


def cameras(*poses):
    return [SE3.from_se2(pose) @ MOUNT for pose in poses]


def snapshot_at(*poses) -> MapSnapshot:
    """Keyframes 3, 7, ... at these poses of the base, without points."""
    none = np.zeros(0, np.int64)
    return MapSnapshot(
        version=1, keyframe_ids=np.array([3, 7])[: len(poses)], keyframe_stamps_ns=np.array([1, 2])[: len(poses)],
        T_world_cams=tuple(cameras(*poses)), images=(), point_ids=none, points_world=np.zeros((0, 3)),
        obs_keyframe=none, obs_point=none, obs_uv=np.zeros((0, 2)), obs_level=none,
    )  # fmt: skip


def rows(poses):
    return np.array([pose.as_array() for pose in poses])


FIRST, SECOND = SE2(0.0, 0.0, 0.0), SE2(2.0, 0.0, 0.5)


@pytest.fixture
def driven():
    anchored = AnchoredPoses(0.05)
    for x in (0.0, 0.1, 0.12, 1.9, 2.0):
        anchored.add(SE2(x, 0.1, 0.2))
    assert len(anchored) == 4
    anchored.poses(np.array([3, 7]), cameras(FIRST, SECOND))
    return anchored


def test_without_keyframes_they_stay():
    anchored = AnchoredPoses(0.05)
    anchored.add(SE2(1.0, 2.0, 3.0))
    assert anchored.poses(np.zeros(0, int), []) == [SE2(1.0, 2.0, 3.0)]


def test_each_moves_with_its_keyframe(driven):
    correction = SE2(0.3, -0.2, 0.4)
    before = driven.poses(np.array([3, 7]), cameras(FIRST, SECOND))
    after = driven.poses(np.array([3, 7]), cameras(FIRST, correction @ SECOND))
    assert rows(after[:2]) == pytest.approx(rows(before[:2]), abs=1e-12)
    assert rows(after[2:]) == pytest.approx(rows([correction @ pose for pose in before[2:]]), abs=1e-9)


def test_when_its_keyframe_is_gone_it_stays_and_follows_the_nearest(driven):
    before = driven.poses(np.array([3, 7]), cameras(FIRST, SECOND))
    assert rows(driven.poses(np.array([3]), cameras(FIRST))) == pytest.approx(rows(before), abs=1e-12)
    correction = SE2(0.0, 1.0, 0.0)
    moved = driven.poses(np.array([3]), cameras(correction @ FIRST))
    assert rows(moved) == pytest.approx(rows([correction @ pose for pose in before]), abs=1e-9)


def test_when_its_keyframe_goes_while_a_loop_is_closed_it_moves_with_the_others():
    anchored, correction = AnchoredPoses(0.05), SE2(0.3, -0.2, 0.4)
    anchored.add(SE2(2.0, 0.1, 0.2))
    third = SE2(2.3, 0.0, 0.5)
    before = anchored.poses(np.array([3, 7, 8]), cameras(FIRST, SECOND, third))
    after = anchored.poses(np.array([3, 8]), cameras(FIRST, correction @ third))
    assert rows(after) == pytest.approx(rows([correction @ pose for pose in before]), abs=1e-9)


def test_what_was_driven_in_a_second_copy_of_a_place_moves_with_that_copy():
    """The wheels drifted by 20 cm around a loop: the first pass of this place is nearer than the second."""
    first, second, closed = SE2(2.0, 0.0, 0.0), SE2(2.05, -0.2, 0.0), SE2(2.05, 0.0, 0.0)
    ground = MappedGround(Config())
    here, there = SE2(2.1, -0.05, 0.0), SE2(2.1, 0.15, 0.0)
    ground.moved(here, 1, 7)
    ground.bumped(here)
    ground.grid(snapshot_at(first, second))
    after = snapshot_at(first, closed)
    assert rows(ground.trail(after)) == pytest.approx(rows([there]), abs=1e-9)
    assert rows(ground._bumps.poses(after.keyframe_ids, after.T_world_cams)) == pytest.approx(rows([there]), abs=1e-9)


def test_what_was_driven_just_before_a_loop_is_closed_moves_with_the_map():
    ground, correction = MappedGround(Config()), SE2(0.3, -0.2, 0.4)
    before, after = snapshot_at(FIRST, SECOND), snapshot_at(FIRST, correction @ SECOND)
    ground.moved(SE2(1.8, 0.0, 0.5), 1)
    ground.grid(before)
    ground.moved(SE2(1.9, 0.0, 0.5), 2)  # since then no map was built
    ground.bumped(SE2(2.0, 0.0, 0.5))
    ground.corrected()
    there = correction @ SE2(2.1, 0.0, 0.5)
    ground.moved(there, 3)
    wanted = [correction @ SE2(1.8, 0.0, 0.5), correction @ SE2(1.9, 0.0, 0.5), there]
    assert rows(ground.trail(after)) == pytest.approx(rows(wanted), abs=1e-9)
    assert rows(ground._bumps.poses(after.keyframe_ids, after.T_world_cams)) == pytest.approx(
        rows([correction @ SE2(2.0, 0.0, 0.5)]), abs=1e-9
    )


def test_what_it_pushed_against_ahead_and_behind_are_two():
    bumps = AnchoredPoses(0.1, 0.5)
    for heading in (0.2, 0.2 + np.pi, 0.2 + np.pi - 0.4, 0.2 + 3.0 * np.pi, 0.2 - np.pi):
        bumps.add(SE2(1.0, 2.0, heading))
    assert rows(bumps.poses(np.zeros(0, int), []))[:, 2] == pytest.approx([0.2, 0.2 + np.pi])
    trail = AnchoredPoses(0.05)
    for heading in (0.0, 2.0, -2.0):
        trail.add(SE2(1.0, 2.0, heading))
    assert len(trail) == 1


def test_a_bump_behind_is_not_lost_after_one_ahead_at_the_same_place():
    ground = MappedGround(Config())
    for heading in (0.0, 0.0, np.pi, np.pi):
        ground.bumped(SE2(0.5, 0.0, heading))
    assert ground.counts[1] == 2


@pytest.mark.parametrize("heading", [0.0, np.pi])
def test_what_wheels_pushed_against_is_forgotten_once_the_base_drives_on_that_way(heading):
    ground = MappedGround(Config())
    push = SE2(0.5, 0.0, heading)
    ground.pushed(push, 0)
    ground.bumped(push)
    around = SE2(3.0, 0.05, -1.57)
    for back in (SE2(0.0, 0.0, 0.3), SE2(-0.3, 0.0, 0.0), SE2(0.2, 0.3, 0.0), SE2(0.05, 0.0, 0.0), around):
        ground.moved(push @ back, SECOND_NS)
        assert ground.counts[1:] == (1, 1), "back, beside it, no farther than it pushed, or beyond it by another way"
    ground.moved(push @ SE2(0.12, 0.0, 0.0), SECOND_NS)
    assert ground.counts[1:] == (1, 0), "what the bumper felt stays"


def test_what_wheels_pushed_against_may_be_tried_again_later_and_later():
    ground = MappedGround(Config())
    now_s, alone_s = 0, []
    for _ in range(3):
        for k in range(5):
            ground.pushed(SE2(0.5 + 0.01 * k, 0.0, 0.1), now_s * SECOND_NS)
        begin_s = now_s
        while ground.counts[2]:
            now_s += 1
            ground.moved(SE2(0.2, 0.0, 0.0), now_s * SECOND_NS)
        alone_s.append(now_s - begin_s)
        ground.pushed(SE2(0.54, 0.0, 0.1), now_s * SECOND_NS)
        assert not ground.counts[2], "the watch has not judged again"
    assert alone_s == [20, 40, 80]
    ground.pushed(SE2(0.5, 0.0, 2.0), now_s * SECOND_NS)
    assert ground.counts[2] == 1, "another way"


def test_the_dock_moves_with_its_keyframe_survives_a_session_and_is_touched_without_harm():
    """The newest contact counts; a bump beside it is no obstacle, one elsewhere is."""
    ground, correction = MappedGround(Config()), SE2(0.3, -0.2, 0.4)
    before = snapshot_at(FIRST, SECOND)
    assert ground.dock(before) is None
    ground.docked(SE2(0.2, 0.0, 1.0))
    ground.docked(SE2(2.0, 0.5, 1.5))
    ground.bumped(SE2(2.02, 0.55, 1.5))
    here = ground.dock(before)
    ground.grid(before)
    assert (here.x, here.y, here.theta) == pytest.approx((2.0, 0.5, 1.5))
    after = snapshot_at(FIRST, correction @ SECOND)
    moved, wanted = ground.dock(after), correction @ here
    assert rows([moved]) == pytest.approx(rows([wanted]))
    again = MappedGround(Config())
    again.restore(ground.state())
    assert rows([again.dock(after)]) == pytest.approx(rows([wanted]))
    old = {name: array for name, array in ground.state().items() if name != "dock"}
    again.restore(old)
    assert again.dock(after) is None
    assert np.count_nonzero(ground.grid(after).data == OCCUPIED) == 0
    assert np.count_nonzero(again.grid(after).data == OCCUPIED) > 0


def test_a_trail_driven_again_and_again_does_not_grow_and_frees_as_much(monkeypatch):
    monkeypatch.setattr(anchored_poses, "_WHOLE", 100)
    trail, angles = AnchoredPoses(0.05), 0.1 * np.arange(1300)
    way = [SE2(np.cos(a), np.sin(a), a) for a in angles]  # 63 poses a lap
    sizes = []
    for pose in way:
        trail.add(pose)
        sizes.append(len(trail))
    kept = rows(trail.last_poses())
    assert max(sizes) == sizes[-1] < 170
    assert trail.added == len(way)
    assert (kept[-100:] == rows(way[-100:])).all()
    away = np.linalg.norm(rows(way)[:, None, :2] - kept[None, :, :2], axis=2).min(axis=1)
    assert away.max() < 0.1


@pytest.mark.parametrize("step_m", [0.052, 0.07, 0.11])
def test_a_way_driven_once_long_ago_is_still_free(monkeypatch, step_m):
    """The next pose was reason enough to forget one, and the one after it to forget the next: all were forgotten."""
    monkeypatch.setattr(anchored_poses, "_WHOLE", 100)
    trail, way = AnchoredPoses(0.05), step_m * np.arange(400)
    for x in way:
        trail.add(SE2(x, 0.0, 0.0))
    kept = rows(trail.last_poses())[:, 0]
    assert np.abs(way[:, None] - kept).min(axis=1).max() < 0.1
    assert np.diff(kept[:-100]).min() > 0.1
    assert len(kept) < 100 + 301 * max(1.0, step_m / 0.1)


def test_who_asks_for_the_dock_does_not_disturb_who_builds_the_map():
    """Both once took the news over; the trail lost poses, and then its columns had different lengths."""
    ground, snapshot, steps, asked = MappedGround(Config()), snapshot_at(FIRST), 4000, threading.Event()

    def ask():
        while not asked.is_set():
            ground.dock(snapshot)

    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-5)
    asking = threading.Thread(target=ask)
    asking.start()
    try:
        for k in range(steps):
            ground.moved(SE2(0.06 * k, 0.0, 0.0), k)
            if k % 20 == 0:
                assert ground.counts[0] <= k + 1
    finally:
        asked.set()
        asking.join()
        sys.setswitchinterval(before)
    assert len(ground.trail(snapshot)) == steps
    assert len(ground.state()["trail"]) == steps

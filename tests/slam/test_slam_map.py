"""Laws of the map: culled keyframes, resumed maps; and sessions that go on in a map made before."""

import msgspec
import numpy as np
import pytest

from vsx_ros.config import Config
from vsx_ros.errors import CalibrationError
from vsx_ros.evaluation.trajectory import trajectory_error
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3
from vsx_ros.io.slam_map_arrays import arrays_of, check
from vsx_ros.io.slam_map_file import load_slam_map, save_slam_map
from vsx_ros.kernels.vision.patches import PATCH
from vsx_ros.robot import VelocityCommand
from vsx_ros.sim.generate import generate_world
from vsx_ros.sim.robot import EmulatedRobot
from vsx_ros.sim.world import Start
from vsx_ros.slam.anchor import Anchor
from vsx_ros.slam.keyframe import FrameData, KeyFrame, Observations, unit_of
from vsx_ros.slam.local_map import nearest_keyframes
from vsx_ros.slam.map import Map
from vsx_ros.slam.slam import SequentialSlam, ThreadedSlam
from vsx_ros.slam.snapshot import SlamMap, snapshot
from vsx_ros.slam.state import TrackingState
from vsx_ros.slam.templates import NewTemplates
from vsx_ros.vision.pyramid import Pyramid

CONFIG = Config().slam
TRACKED = (TrackingState.GOOD, TrackingState.DUBIOUS)


def seeing(rows):
    n = len(rows)
    return Observations(np.array(rows), np.zeros((n, 2)), np.zeros((n, 2)), np.zeros(n, np.int64))


def made_map(sees, n_points=12):
    """Keyframes in a row, 0.1 m apart, that see the given points; all points made in keyframe 1."""
    world = Map()
    for k in range(len(sees)):
        data = FrameData.without_image(k, SE2(0.1 * k, 0.0, 0.0))
        world.add_keyframe(data, SE3(np.eye(3), [0.1 * k, 0.0, 0.0]), Observations.none())
    templates = NewTemplates(
        np.zeros((n_points, 4)), np.zeros((n_points, 2)), np.zeros((n_points, PATCH, PATCH), np.uint8)
    )
    world.add_points(np.tile([0.0, 0.0, 2.0], (n_points, 1)), templates, 1)
    for k, rows in enumerate(sees):
        world.observe(k, seeing(rows))
    return world


def test_the_depth_of_a_keyframe_is_that_of_what_lies_before_it():
    world = made_map([range(12)])
    world.points[:7, 2] = -1.0
    world.update_depth(0)
    assert world.keyframes[0].median_depth == 2.0
    world.points[:, 2] = -1.0
    world.update_depth(0)
    assert world.keyframes[0].median_depth == 2.0


def test_a_culled_keyframe_keeps_its_index_and_leaves_every_list():
    world = made_map([range(12), range(12), range(6), range(12)])
    world.cull_keyframe(1)
    view = world.view()
    assert [k.alive for k in view.keyframes] == [True, False, True, True]
    assert [k.id for k in view.keyframes] == [0, 1, 2, 3]
    assert view.living.tolist() == world.living == [0, 2, 3]
    culled = view.keyframes[1]
    assert culled.observations.rows.tolist() == list(range(12)), "what it saw stays known"
    assert world.observers(np.arange(12)) == [0, 2, 3]
    assert culled.data.pyramid.pixels.nbytes + culled.data.corners.positions.nbytes + culled.data.small.nbytes == 0
    assert (culled.data.stamp_ns, culled.data.T_odom_base) == (1, SE2(0.1, 0.0, 0.0))
    assert sorted(nearest_keyframes(view, SE3.identity()).tolist()) == [0, 2, 3]
    assert world.alive.all(), "points live on without the keyframe they were made in"
    assert (world.source == 1).all()


def test_points_that_one_keyframe_alone_still_sees_stay_and_so_do_the_rays_of_the_culled_one():
    world = made_map([range(12), range(12), range(6)])
    before = snapshot(world.view())
    world.cull_keyframe(1)
    assert world.alive.all()
    after = snapshot(world.view())
    assert after.keyframe_ids.tolist() == [0, 2]
    assert len(after.images) == len(after.T_world_cams) == 2
    assert after.point_ids.tolist() == before.point_ids.tolist() == list(range(12))
    assert np.bincount(after.obs_keyframe).tolist() == [12, 6]
    for old, new in zip(before.rays, after.rays, strict=True):
        if isinstance(old, np.ndarray):
            assert old.tolist() == new.tolist()
    moved = [T.translation.tolist() for T in after.rays.T_world_cams]
    assert moved == [T.translation.tolist() for T in before.T_world_cams]


def test_a_culled_keyframe_moves_with_the_one_that_shares_most_and_with_its_heir():
    world = made_map([[0, 1], range(12), range(12), range(8)])
    world.cull_keyframe(1)
    assert world.keyframes[1].anchor.keyframe == 2
    move = SE3.exp(np.array([0.3, -0.1, 0.2, 0.1, 0.5, -0.2]))
    before = [k.T_world_cam for k in world.keyframes]
    world.move_keyframe(2, move @ before[2])
    assert np.allclose(world.keyframes[1].T_world_cam.matrix(), (move @ before[1]).matrix(), atol=1e-12)
    world.cull_keyframe(2)
    assert [world.keyframes[k].anchor.keyframe for k in (1, 2)] == [3, 3]
    held = world.keyframes[1].T_world_cam.matrix()
    assert np.allclose(held, (move @ before[1]).matrix(), atol=1e-12), "an heir alone moves nothing"
    world.move_keyframe(3, move @ before[3])
    assert np.allclose(world.keyframes[1].T_world_cam.matrix(), (move @ move @ before[1]).matrix(), atol=1e-12)


def test_a_frame_follows_its_keyframe_moved_resized_and_culled_and_then_the_heir():
    world = made_map([range(12), range(12), range(12), range(8)])
    T = SE3.exp(np.array([0.02, 0.01, 0.03, 0.0, 0.1, 0.0]))
    frame = Anchor(1, T, world.keyframes[1].scale)
    move = SE3.exp(np.array([0.3, -0.1, 0.2, 0.1, 0.5, -0.2]))
    world.resize_keyframe(1, move @ world.keyframes[1].T_world_cam, 2.0)
    there = move @ SE3(np.eye(3), [0.1, 0.0, 0.0]) @ T.scaled(2.0)
    assert np.allclose(frame.pose(world.keyframes).matrix(), there.matrix(), atol=1e-12)
    world.cull_keyframe(1)
    assert np.allclose(frame.pose(world.keyframes).matrix(), there.matrix(), atol=1e-12), "an heir alone moves nothing"
    heir = world.keyframes[1].anchor.keyframe
    before = world.keyframes[heir].T_world_cam
    world.resize_keyframe(heir, move @ before, 0.5)
    there = move @ before @ (before.inverse() @ there).scaled(0.5)
    assert np.allclose(frame.pose(world.keyframes).matrix(), there.matrix(), atol=1e-12)


def test_what_carries_a_resized_keyframe_is_the_same_after_the_map_was_saved():
    world = made_map([range(12), range(12), range(12)])
    world.cull_keyframe(1)
    heir = world.keyframes[1].anchor.keyframe
    world.resize_keyframe(heir, world.keyframes[heir].T_world_cam, 3.0)
    T = world.keyframes[heir].T_world_cam.inverse() @ world.keyframes[1].T_world_cam
    assert np.allclose(arrays_of(world.view())["anchor_translation"][1], T.translation, atol=1e-12)


def test_a_metre_of_a_map_without_odometry_grows_with_it():
    def metre(depth, *odometry):
        data = [FrameData.without_image(k, T) for k, T in enumerate(odometry)]
        keyframes = [KeyFrame(k, d, SE3.identity(), Observations.none(), depth) for k, d in enumerate(data)]
        return unit_of(keyframes, len(keyframes) - 1)

    assert metre(2.5, None, None) == (1.0, "units of the map")
    assert metre(0.4, None, None).metre == pytest.approx(0.16)
    assert metre(0.8, None, None).metre == pytest.approx(0.32)
    assert metre(0.8, SE2(), SE2()) == (1.0, "m")
    assert metre(0.8, SE2(), None).word == metre(0.8, None, SE2()).word == "units of the map"


def test_the_first_keyframe_and_culled_ones_cannot_be_culled():
    world = made_map([range(12)] * 4)
    with pytest.raises(AssertionError, match="keyframe 0 holds the world"):
        world.cull_keyframe(0)
    world.cull_keyframe(2)
    with pytest.raises(AssertionError, match="keyframe 2 is culled already"):
        world.cull_keyframe(2)


def test_predecessors_are_living_and_of_the_same_epoch():
    world = made_map([range(12)] * 3)
    resumed = Map.resumed(world.view())
    for _ in range(3):
        resumed.add_keyframe(FrameData.without_image(9, None), SE3.identity(), seeing(range(12)))
    assert [k.odom_segment for k in resumed.keyframes] == [0, 0, 0, 1, 1, 1]
    resumed.cull_keyframe(1)
    resumed.cull_keyframe(4)
    assert [resumed.predecessor(k) for k in (0, 2, 3, 5)] == [None, 0, None, 3]


def test_a_resumed_map_leaves_the_view_it_came_from_alone():
    world = made_map([range(12)] * 4)
    world.cull_keyframe(2)
    view = world.view()
    resumed = Map.resumed(view)
    resumed.points[:] = 7.0
    resumed.remove_points(np.array([3]))
    resumed.move_keyframe(1, SE3(np.eye(3), [5.0, 0.0, 0.0]))
    templates = NewTemplates(np.ones((2, 4)), np.ones((2, 2)), np.ones((2, PATCH, PATCH), np.uint8))
    resumed.add_points(np.ones((2, 3)), templates, 1)
    resumed.templates.add(np.array([0]), NewTemplates(*(a[:1] for a in templates)), 1)
    assert view.points[:, 2].tolist() == [2.0] * 12
    assert view.alive.all()
    assert view.templates.of_point[0].tolist() == [0, -1, -1, -1, -1]
    assert view.templates.patches.max() == 0
    parent = view.keyframes[2].anchor.keyframe
    resumed.move_keyframe(parent, SE3(np.eye(3), [0.0, 9.0, 0.0]))
    assert resumed.keyframes[2].T_world_cam.translation[1] == 9.0, "what is carried stays carried"
    assert view.keyframes[2].T_world_cam.translation[1] == 0.0


def test_culling_every_second_keyframe_keeps_tracking_as_good(arc_drive):
    slam = SequentialSlam(arc_drive.camera, arc_drive.T_base_cam, CONFIG, 1)
    results, pairs, culled = [], [], 0
    for frame, odometry, truth in arc_drive.frames:
        result = slam.track(frame, odometry)
        results.append(result)
        if result.T_world_cam is not None:
            pairs.append((result.T_world_cam, truth))
        world = slam._mapper.map
        if result.keyframe_added and len(world.keyframes) > 4 and len(world.keyframes) % 2 == 0:
            world.cull_keyframe(len(world.keyframes) - 3)
            culled += 1
    assert culled >= 4
    started = next(k for k, r in enumerate(results) if r.state is not TrackingState.NOT_INITIALISED)
    assert all(r.state in TRACKED for r in results[started:])
    assert trajectory_error(pairs, "se3").ate_rmse_m < 0.01
    snapshot = slam.snapshot()
    assert len(snapshot.images) == len(snapshot.T_world_cams) == len(slam._view.living)
    assert slam.statistics().keyframes == len(slam._view.living)


@pytest.fixture(scope="module")
def made_before(arc_drive):
    slam = SequentialSlam(arc_drive.camera, arc_drive.T_base_cam, CONFIG, 1)
    for frame, odometry, _ in arc_drive.frames:
        slam.track(frame, odometry)
    return slam.slam_map()


@pytest.fixture(scope="module")
def second_drive(arc_drive):
    """The same robot in the same lab, set down elsewhere, the first five images dark: (frame, odometry, truth)."""
    first = arc_drive.frames[0][2] @ arc_drive.T_base_cam.inverse()
    start = first.to_se2() @ SE2(0.3, 0.08, 0.1)
    world = generate_world("lab", 12)
    world = msgspec.structs.replace(world, start=Start(x=start.x, y=start.y, theta_rad=start.theta))
    robot = EmulatedRobot(world, 12)
    frames = []
    for v, omega, seconds in [(0.0, 0.0, 0.5), (0.2, 0.0, 1.5), (0.14, 0.35, 5.0)]:
        for _ in range(round(seconds * 15)):
            seen = robot.step(VelocityCommand(v, omega))
            dark = seen.frame._replace(image=np.zeros_like(seen.frame.image))
            frames.append((dark if len(frames) < 5 else seen.frame, seen.odometry, robot.truth.T_world_cam))
    return frames


def continued(slam, drive):
    results = [slam.track(frame, odometry) for frame, odometry, _ in drive]
    pairs = [(r.T_world_cam, truth) for r, (_, _, truth) in zip(results, drive) if r.state in TRACKED]
    return results, pairs


def world_error(arc_drive, pairs):
    """Greatest distance [m] from the truth in the loaded map's world, where the first drive began at the origin."""
    T_world_lab = arc_drive.T_base_cam @ arc_drive.frames[0][2].inverse()
    return max(np.linalg.norm(a.translation - (T_world_lab @ b).translation) for a, b in pairs)


def test_a_second_session_is_lost_until_recognised_and_goes_on_in_the_same_world(arc_drive, made_before, second_drive):
    slam = SequentialSlam(arc_drive.camera, arc_drive.T_base_cam, CONFIG, 1, made_before)
    results, pairs = continued(slam, second_drive)
    assert all(r.state is TrackingState.LOST for r in results[:5])
    assert all(r.T_world_cam is None for r in results[:5])
    assert "not yet recognised in the loaded map" in results[0].reason
    assert all(r.state in TRACKED for r in results[8:])
    assert [e.kind for e in slam.drain_events()][:2] == ["lost", "relocalised"]
    assert world_error(arc_drive, pairs) < 0.03
    statistics = slam.statistics()
    assert statistics.frames == len(second_drive)
    assert 5 <= statistics.frames_lost <= 8
    assert statistics.relocalizations == 1
    assert 0.3 < statistics.initialized_at_s < 0.6
    assert 0.8 < statistics.u1 <= 1.0
    frames = slam.slam_map().view.keyframes
    old = len(made_before.view.keyframes)
    assert len(frames) > old
    assert {k.odom_segment for k in frames[:old]} == {0}
    assert len({k.odom_segment for k in frames[old:]} - {0}) == 1
    assert slam._mapper.map.predecessor(old) is None


def test_threads_go_on_in_a_map_too(arc_drive, made_before, second_drive):
    slam = ThreadedSlam(arc_drive.camera, arc_drive.T_base_cam, CONFIG, 1, made_before)
    try:
        results, pairs = continued(slam, second_drive)
        assert results[-1].state in TRACKED
        assert world_error(arc_drive, pairs) < 0.05
        assert slam.slam_map().view.version >= made_before.view.version
    finally:
        slam.close()


def test_a_map_of_another_calibration_is_refused_with_both_values(arc_drive, made_before):
    camera, mount = arc_drive.camera, arc_drive.T_base_cam
    other = type(camera)(camera.width, camera.height, 500.25, camera.fy, camera.cx, camera.cy, camera.distortion)
    with pytest.raises(CalibrationError, match=rf"fx {camera.fx:.7g}.*fx 500\.25"):
        SequentialSlam(other, mount, CONFIG, 1, made_before)
    raised = SE3(mount.rotation, mount.translation + [0.0, 0.0, 0.1])
    height = mount.translation[2]
    with pytest.raises(CalibrationError, match=rf"z {height:.4f} m.*z {height + 0.1:.4f} m"):
        ThreadedSlam(camera, raised, CONFIG, 1, made_before)
    with pytest.raises(CalibrationError, match="no metric scale"):
        SequentialSlam(camera, mount, CONFIG, 1, SlamMap(camera, None, made_before.view))


def test_a_map_taken_while_the_mapper_works_does_not_change(arc_drive):
    slam = ThreadedSlam(arc_drive.camera, arc_drive.T_base_cam, CONFIG, 1)
    taken = []
    try:
        for frame, odometry, _ in arc_drive.frames:
            slam.track(frame, odometry)
            slam_map = slam.slam_map()
            if slam_map is not None and (not taken or slam_map.view.version > taken[-1][0].version):
                taken.append((slam_map.view, contents(slam_map.view)))
    finally:
        slam.close()
    assert len(taken) >= 3
    for view, bytes_then in taken:
        assert contents(view) == bytes_then
        check(arrays_of(view), 640, 480)


def contents(view):
    return b"".join(array.tobytes() for array in arrays_of(view).values())


def test_a_session_without_wheels_may_go_on_in_a_metric_map(arc_drive, made_before, second_drive):
    slam = SequentialSlam(arc_drive.camera, None, CONFIG, 1, made_before)
    results, pairs = continued(slam, [(frame, None, truth) for frame, _, truth in second_drive])
    assert sum(r.state in TRACKED for r in results[8:]) > 0.95 * len(results[8:])
    assert world_error(arc_drive, pairs) < 0.05
    assert np.allclose(slam.slam_map().T_base_cam.matrix(), arc_drive.T_base_cam.matrix())


def test_a_place_never_seen_is_not_recognised(arc_drive, made_before):
    rng = np.random.default_rng(0)
    slam = SequentialSlam(arc_drive.camera, arc_drive.T_base_cam, CONFIG, 1, made_before)
    for frame, odometry, _ in arc_drive.frames[:6]:
        noise = rng.integers(0, 256, (60, 80)).astype(np.uint8).repeat(8, axis=0).repeat(8, axis=1)
        result = slam.track(frame._replace(image=noise), odometry)
        assert result.state is TrackingState.LOST
        assert result.T_world_cam is None
    assert slam.statistics().initialized_at_s is None
    assert slam.statistics().u1 is None
    assert slam.statistics().frames_lost == 6


def test_going_on_in_a_saved_map_gives_the_same_bits(arc_drive, made_before, second_drive, tmp_path):
    save_slam_map(made_before, tmp_path / "lab.vsxmap")
    runs = []
    for slam_map in (made_before, load_slam_map(tmp_path / "lab.vsxmap")):
        slam = SequentialSlam(arc_drive.camera, arc_drive.T_base_cam, CONFIG, 1, slam_map)
        results, pairs = continued(slam, second_drive)
        poses = b"".join(pose.matrix().tobytes() for pose, _ in pairs)
        runs.append((poses, [r.found for r in results], slam.snapshot().points_world.tobytes()))
    assert runs[0] == runs[1]


def blocks_of(keyframe):
    """The blocks of memory of a keyframe's arrays."""
    data, observations = keyframe.data, keyframe.observations
    arrays = [*(part for part in data.corners if isinstance(part, np.ndarray)), data.small, data.camera]
    arrays += [data.image.pixels] if isinstance(data.image, Pyramid) else []
    return {id(array.base) for array in arrays}, {id(array.base) for array in observations}


def test_a_keyframe_has_one_block_of_memory_for_its_image_and_one_for_its_observations(arc_drive, tmp_path):
    slam = SequentialSlam(arc_drive.camera, arc_drive.T_base_cam, Config().slam)
    for frame, odometry, _ in arc_drive.frames:
        slam.track(frame, odometry)
    save_slam_map(slam.slam_map(), tmp_path / "map.vsx")
    for view in (slam.slam_map().view, load_slam_map(tmp_path / "map.vsx").view):
        blocks = [blocks_of(view.keyframes[int(k)]) for k in view.living]
        assert len(blocks) >= 3
        assert all(len(of_image) == len(of_observations) == 1 for of_image, of_observations in blocks)
        assert len({block for pair in blocks for part in pair for block in part}) == 2 * len(blocks)

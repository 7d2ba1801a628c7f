"""Places seen twice: closed when they are one, left alone when they only look alike; maps joined in the right size; the
camera found again by whichever keyframe shows it."""

import numpy as np
import pytest

from vsx_ros.config import Config
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3
from vsx_ros.kernels.vision.patches import PATCH
from vsx_ros.slam import loop_correction
from vsx_ros.slam.frontend import FrontEnd
from vsx_ros.slam.initialization import Initializer
from vsx_ros.slam.keyframe import FrameData, Observations
from vsx_ros.slam.local_map import path_lengths
from vsx_ros.slam.loop_closing import LoopDetector
from vsx_ros.slam.loop_correction import LoopClosure, correct_loops, optimize_pose_graph
from vsx_ros.slam.map import Map
from vsx_ros.slam.place_recognition import PlaceRecognizer
from vsx_ros.slam.recovery import Recovery
from vsx_ros.slam.slam import SequentialSlam
from vsx_ros.slam.templates import NewTemplates
from vsx_ros.slam.tracker import Tracker
from vsx_ros.slam.two_view_reconstruction import InitialPair
from vsx_ros.vision.corners import features_of
from vsx_ros.vision.patch_search import Predictions

CONFIG = Config().slam


@pytest.fixture(scope="module")
def arc(arc_drive):
    """A map of the arc, and every fifth frame of it taken apart as the front end does."""
    slam = SequentialSlam(arc_drive.camera, arc_drive.T_base_cam, CONFIG, 1)
    for frame, odometry, _ in arc_drive.frames:
        slam.track(frame, odometry)
    return slam._mapper.map


@pytest.fixture
def places(arc_drive):
    return PlaceRecognizer(arc_drive.camera, Tracker(CONFIG.tracker, np.random.default_rng(0)))


def taken_apart(drive, image, k):
    front = FrontEnd(drive.camera, drive.T_base_cam, CONFIG, 0)
    frame, odometry, _ = drive.frames[k]
    return front._preprocessor.take(frame._replace(image=image), odometry, metric=True)


def best(places, data, view):
    """The surest recognition by any keyframe, None when no keyframe even guesses."""
    features = features_of(data.pyramid, data.corners)
    seen = [places.recognise(data, features, view, int(k)) for k in view.living]
    return max((s for s in seen if s is not None), key=lambda s: len(s.track.rows), default=None)


def test_a_place_of_the_map_is_recognised_where_it_is(arc_drive, arc, places):
    view = arc.view()
    for k in (30, 60, 90):
        seen = best(places, taken_apart(arc_drive, arc_drive.frames[k][0].image, k), view)
        assert seen.is_sure(CONFIG.recognition)
        truth = arc_drive.T_base_cam @ arc_drive.frames[0][2].inverse() @ arc_drive.frames[k][2]
        assert np.linalg.norm(seen.track.T_world_cam.translation - truth.translation) < 0.03


@pytest.mark.parametrize("side", [slice(0, 240), slice(400, 640)])
def test_a_poster_that_hangs_elsewhere_too_is_not_the_place(arc_drive, spin_drive, arc, places, side):
    """A part of a mapped image in the surroundings of another lab."""
    view = arc.view()
    for k in (30, 60, 90):
        image = spin_drive.frames[k][0].image.copy()
        image[100:340, side] = arc_drive.frames[k][0].image[100:340, side]
        seen = best(places, taken_apart(arc_drive, image, k), view)
        assert seen is None or not seen.is_sure(CONFIG.recognition)


def test_another_lab_is_no_place_of_this_map(spin_drive, arc, places):
    view = arc.view()
    for k in range(0, len(spin_drive.frames), 20):
        seen = best(places, taken_apart(spin_drive, spin_drive.frames[k][0].image, k), view)
        assert seen is None or not (seen.is_sure(CONFIG.recognition) or seen.is_certain(CONFIG.recognition))


def test_every_keyframe_gets_its_turn_when_the_likeliest_mislead(arc_drive, arc, monkeypatch):
    """Look-alikes first, the true place last: found as soon as its turn comes."""
    view = arc.view()
    front = FrontEnd(arc_drive.camera, arc_drive.T_base_cam, CONFIG, 0)
    recovery = Recovery(arc_drive.camera, None, CONFIG, front._tracker, front._motion)
    data = taken_apart(arc_drive, arc_drive.frames[15][0].image, 15)
    places = recovery.places
    features = features_of(data.pyramid, data.corners)
    shows = [
        k
        for k in view.living.tolist()
        if (s := places.recognise(data, features, view, k)) and s.is_certain(CONFIG.recognition)
    ]
    assert 0 < len(shows) < len(view.living)
    backwards = np.array([k for k in view.living.tolist() if k not in shows] + shows)
    monkeypatch.setattr(places, "ranked", lambda small, view, among: backwards)
    turns = -(-(len(backwards) - 3) // 2)
    found = [recovery.search(data, view, None, 0) is not None for _ in range(turns)]
    assert any(found)
    assert not found[0]


def ring(n=40, radius=3.0, drift=0.004, map_id=0):
    """Keyframes round a circle, the turn estimated too large at each step: (world, true poses). Each sees 20 points
    of its own and those of the four before it."""
    world, true, T = Map(), [], SE3.identity()
    step, turn = 2.0 * np.pi * radius / n, 2.0 * np.pi / n
    estimate = SE3.identity()
    for k in range(n + 1):
        data = FrameData.without_image(k, SE2())
        world.add_keyframe(data, estimate, Observations.none(), map_id)
        true.append(T)
        T = T @ SE3.exp(np.array([step, 0.0, 0.0, 0.0, 0.0, turn]))
        estimate = estimate @ SE3.exp(np.array([step, 0.0, 0.0, 0.0, 0.0, turn + drift]))
    templates = NewTemplates(np.zeros((20, 4)), np.zeros((20, 2)), np.zeros((20, PATCH, PATCH), np.uint8))
    for k in range(n + 1):
        rows = world.add_points(world.keyframes[k].T_world_cam @ np.tile([0.0, 0.0, 2.0], (20, 1)), templates, k)
        for j in range(k, min(k + 5, n + 1)):
            world.observe(j, Observations(rows, np.zeros((20, 2)), np.zeros((20, 2)), np.zeros(20, np.int64)))
    return world, true


def error_m(world, true):
    apart = [k.T_world_cam.translation - T.translation for k, T in zip(world.keyframes, true)]
    return float(np.sqrt(np.mean(np.sum(np.square(apart), axis=1))))


def test_a_true_loop_is_closed_and_the_error_falls_everywhere():
    world, true = ring()
    before, last = error_m(world, true), len(true) - 1
    seam = np.linalg.norm(world.keyframes[last].T_world_cam.translation)
    assert seam > 0.3
    relative = [k.T_world_cam.inverse() @ world.points[20 * n] for n, k in enumerate(world.keyframes)]
    moved = optimize_pose_graph(world, 0, [LoopClosure(0, last, true[0].inverse() @ true[last], 1.0)], free_scale=False)
    assert abs(moved - seam) < 0.05
    assert np.linalg.norm(world.keyframes[last].T_world_cam.translation) < 0.01
    assert error_m(world, true) < 0.25 * before
    assert np.allclose(world.keyframes[0].T_world_cam.matrix(), np.eye(4), atol=1e-15)
    after = [k.T_world_cam.inverse() @ world.points[20 * n] for n, k in enumerate(world.keyframes)]
    assert np.allclose(after, relative, atol=1e-9), "points go with the keyframe they were made in"


def test_a_point_that_was_fused_is_seen_by_nobody_any_more(monkeypatch):
    """One keyframe sees the point itself and its other copy; another one finds both."""
    here = np.array([[50.0, 50.0]])

    def found(keyframe, view, rows, radius_px):
        rows = rows[~np.isin(rows, keyframe.observations.rows)]
        uv = here.repeat(len(rows), 0)
        return Predictions(rows, np.zeros(len(rows), np.int64), uv, np.zeros((len(rows), 4)), rows), uv

    monkeypatch.setattr(loop_correction, "find_unseen", found)
    monkeypatch.setattr(loop_correction, "observe_at", lambda world, k, *seen: world.observe(k, observing(*seen)))
    world = Map()
    for k, sees in enumerate([[], [0], []]):
        world.add_keyframe(FrameData.without_image(k, None), SE3.identity(), Observations.none())
        if k == 0:
            none = NewTemplates(np.zeros((2, 4)), np.zeros((2, 2)), np.zeros((2, PATCH, PATCH), np.uint8))
            world.add_points(np.tile([0.0, 0.0, 1.0], (2, 1)), none, 0)
        world.observe(k, observing(np.array(sees, int), here.repeat(len(sees), 0), np.zeros(len(sees), int)))
    assert loop_correction.fuse(world, [1, 2], np.array([0, 1])) == 1
    assert [world.keyframes[k].observations.rows.tolist() for k in (1, 2)] == [[1], [1]]
    assert world.alive.tolist() == [False, True]


def observing(rows, uv, level):
    return Observations(rows, uv, uv, level)


def test_a_keyframe_that_was_culled_confirms_no_loop(arc_drive):
    world, true = ring()
    last = len(true) - 1
    finder = LoopDetector(arc_drive.camera, CONFIG, np.random.default_rng(0))
    home = true[last] @ world.keyframes[last].T_world_cam.inverse()
    one, two = (LoopClosure(0, k, home @ world.keyframes[k].T_world_cam, 1.0, 100) for k in (last - 1, last))
    assert finder._agree(world, one, two)
    world.cull_keyframe(last - 1)
    assert not finder._agree(world, one, two)


def test_a_culled_keyframe_is_bent_with_what_carries_it():
    world, true = ring()
    last = len(true) - 1
    world.cull_keyframe(20)
    parent = world.keyframes[20].anchor.keyframe
    held = world.keyframes[parent].T_world_cam.inverse() @ world.keyframes[20].T_world_cam
    optimize_pose_graph(world, 0, [LoopClosure(0, last, true[0].inverse() @ true[last], 1.0)], free_scale=False)
    after = world.keyframes[parent].T_world_cam.inverse() @ world.keyframes[20].T_world_cam
    assert np.allclose(after.matrix(), held.matrix(), atol=1e-12)
    assert error_m(world, true) < 0.05


def test_maps_begun_apart_become_one_of_the_right_size_and_keep_their_indices():
    """The second map is made half as large and in a frame of its own."""
    world, true = ring(n=20, drift=0.0)
    n, offset = len(true), SE3.exp(np.array([5.0, -2.0, 0.3, 0.2, -0.1, 0.7]))
    small = [offset @ SE3(T.rotation, 0.5 * T.translation) for T in true]
    one = NewTemplates(np.zeros((1, 4)), np.zeros((1, 2)), np.zeros((1, PATCH, PATCH), np.uint8))
    for k, T in enumerate(small):
        world.add_keyframe(FrameData.without_image(n + k, None), T, Observations.none(), 1)
    ahead = [(T @ np.array([0.0, 0.0, 1.0]))[None] for T in small]
    rows = np.concatenate([world.add_points(p, one, n + k) for k, p in enumerate(ahead)])
    count = len(world.points)
    closure = LoopClosure(3, n + 3, SE3.identity(), 2.0, 100)
    event = correct_loops(world, [closure], [])
    assert event.kind == "merged"
    assert "map 1 into map 0, 2.000 times as large" in event.reason
    assert [k.id for k in world.keyframes] == list(range(2 * n))
    assert {k.map_id for k in world.keyframes} == {0}
    assert {k.scale for k in world.keyframes[n:]} == {2.0}
    assert error_m(world, true + true) < 1e-9
    assert len(world.points) == count
    expected = [T @ np.array([0.0, 0.0, 2.0]) for T in true]
    assert np.allclose(world.points[rows], expected, atol=1e-9)


def test_a_second_map_is_joined_while_the_camera_is_in_the_first(arc_drive):
    slam = SequentialSlam(arc_drive.camera, arc_drive.T_base_cam, CONFIG, 1)
    for frame, odometry, _ in arc_drive.frames[:60]:
        slam.track(frame, odometry)
    other = FrontEnd(arc_drive.camera, arc_drive.T_base_cam, CONFIG, 0)
    initializer = Initializer(arc_drive.T_base_cam, CONFIG.initialization)
    made = (initializer.add(other._preprocessor.take(*arc_drive.frames[k][:2], metric=True)) for k in range(45, 80))
    pair = next(pair for pair in made if isinstance(pair, InitialPair))
    away = SE3.exp(np.array([3.0, -2.0, 0.0, 0.0, 0.0, 1.0]))
    slam._view = slam._mapper.start(pair._replace(T_world_first=away, odom_segment=9))
    slam._front.use(slam._view)
    assert {keyframe.map_id for keyframe in slam._view.keyframes} == {0, 1}
    before = slam._view.keyframes
    for frame, odometry, _ in arc_drive.frames[60:]:
        result = slam.track(frame, odometry)
    assert [event.kind for event in slam.drain_events() if event.kind == "merged"] == ["merged"]
    assert result.map_id == 0
    after = slam._view.keyframes
    assert {keyframe.map_id for keyframe in after} == {0}
    first = before[0].T_world_cam.matrix() - after[0].T_world_cam.matrix()
    assert np.abs(first).max() < 0.01, "the first map stays"
    truth = {frame.stamp_ns: T for frame, _, T in arc_drive.frames}
    for k in (k for k, keyframe in enumerate(before) if keyframe.map_id):
        estimated = after[0].T_world_cam.inverse() @ after[k].T_world_cam
        true = truth[after[0].data.stamp_ns].inverse() @ truth[after[k].data.stamp_ns]
        assert estimated.is_near(true, 0.02, 0.01)


def test_exchanged_parts_are_joined_in_the_same_way():
    closure = LoopClosure(0, 1, SE3.exp(np.array([0.4, -0.2, 1.0, 0.1, 0.3, -0.2])), 2.0, 50)
    point, other = np.array([0.3, 0.1, 2.0]), closure.exchanged()
    there = closure.T_older_newer @ (closure.factor * point)
    assert other.T_older_newer @ (other.factor * there) == pytest.approx(point)
    assert other.exchanged().T_older_newer.matrix() == pytest.approx(closure.T_older_newer.matrix())


def test_what_the_map_cannot_have_drifted_is_not_believed(arc_drive):
    world, true = ring(drift=0.0)
    finder = LoopDetector(arc_drive.camera, CONFIG, np.random.default_rng(0))
    last = len(true) - 1
    way = 2.0 * np.pi * 3.0
    for off, possible in ((0.15 + 0.03 * way - 0.02, True), (0.15 + 0.03 * way + 0.02, False)):
        shifted = SE3(np.eye(3), [off, 0.0, 0.0]) @ world.keyframes[last].T_world_cam
        closure = LoopClosure(0, last, world.keyframes[0].T_world_cam.inverse() @ shifted, 1.0, 100)
        assert finder._is_plausible(world, closure) is possible


def test_the_way_from_one_map_to_another_and_back_closes_no_loop(arc_drive):
    """Lost after 8 units; a second map begins in its own frame; then the camera is found where it was lost."""
    world, none = Map(), np.zeros(0, np.int64)
    template = NewTemplates(np.zeros((50, 4)), np.zeros((50, 2)), np.zeros((50, PATCH, PATCH), np.uint8))
    points = world.add_points(np.tile([8.0, 0.0, 1.0], (50, 1)), template, 0)
    ahead = [(x, points if x > 7.0 else none, 0) for x in np.linspace(0.0, 8.0, 30)]
    for x, rows, map_id in [*ahead, (0.0, none, 1), (0.1, none, 1), (0.2, none, 1), (8.05, points, 0)]:
        seen, number = np.full((len(rows), 2), 200.0), len(world.keyframes)
        observed = observing(rows, seen, np.zeros(len(rows), np.int64))
        world.add_keyframe(FrameData.without_image(number, None), SE3(np.eye(3), [x, 0.0, 0.0]), observed, map_id)
    finder = LoopDetector(arc_drive.camera, CONFIG, np.random.default_rng(0))
    assert not len(finder._long_ago(world, world.live_view(), number))
    assert not finder.tracked_loop
    way = path_lengths(world.live_view())
    assert way[number] == pytest.approx(8.05)
    assert way[number - 1] == pytest.approx(0.2)

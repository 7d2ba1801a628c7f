"""Which of several two-view motions starts the map."""

import numpy as np
import pytest
from textured_planes import CAMERA, SCENE, WALL, frame, moved, picture

from vsx_ros.config import Config
from vsx_ros.geometry.epipolar import two_view_motions
from vsx_ros.geometry.mount import mount_pose
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3
from vsx_ros.geometry.two_view_certainty import certainty, pure_rotation
from vsx_ros.robot import Frame
from vsx_ros.slam.initialization import Initializer
from vsx_ros.slam.slam import SequentialSlam
from vsx_ros.slam.state import TrackingState
from vsx_ros.slam.two_view_reconstruction import InitialMap, InitialPair, MotionHypothesis, TwoViewReconstruction

CONFIG = Config().slam.initialization
MOUNT = mount_pose(0.0, 0.0, 0.3, 0.0, 0.0)
SIDEWAYS, AHEAD = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])


def hypothesis(direction, support, usable):
    return MotionHypothesis(SE3(np.eye(3), direction), support, np.zeros((200, 3)), np.arange(200) < usable)


TWO_VIEWS = TwoViewReconstruction(CAMERA, CONFIG)


def test_parallax_does_not_make_up_for_a_poor_explanation():
    true, wrong = hypothesis(SIDEWAYS, 0.9, 70), hypothesis(AHEAD, 0.6, 200)
    assert TWO_VIEWS._choose([wrong, true], None) is true
    reason = TWO_VIEWS._choose([wrong, hypothesis(SIDEWAYS, 0.9, 20)], None)
    assert "too little parallax: 20 points" in reason


def test_motions_that_explain_the_matches_equally_well_are_refused():
    one, other = hypothesis(SIDEWAYS, 0.90, 150), hypothesis(AHEAD, 0.89, 150)
    assert "two motions" in TWO_VIEWS._choose([one, other], None)
    near = hypothesis(np.array([0.995, 0.1, 0.0]) / np.hypot(0.995, 0.1), 0.89, 150)
    assert TWO_VIEWS._choose([near, one], None) is one


def test_refinement_tells_the_true_motion_from_the_mirrored_one():
    rng = np.random.default_rng(4)
    points = np.column_stack([rng.uniform(-1, 1, 300), rng.uniform(-0.8, 0.8, 300), rng.uniform(2, 5, 300)])
    true = SE3.exp(np.array([0.2, 0.0, 0.02, 0.0, 0.05, 0.0]))
    moved = true @ points
    rays_a, rays_b = points[:, :2] / points[:, 2:], moved[:, :2] / moved[:, 2:]
    rays_b = rays_b + rng.normal(0, 0.2 / 525.0, rays_b.shape)
    size = np.linalg.norm(true.translation)
    maps = [
        TWO_VIEWS._refine(SE3(true.rotation, sign * true.translation / size), rays_a, rays_b, 1 / 525.0, 0.004)
        for sign in (1.0, -1.0)
    ]
    assert maps[0].support > 0.8
    assert maps[1].support < 0.3
    assert TWO_VIEWS._choose(maps, None).T_b_a.translation == pytest.approx(true.translation / size, abs=0.03)


def outcome(initializer, planes, poses, bases=None):
    """What the last of the frames gives, or the first that starts a map."""
    for k, T in enumerate(poses):
        got = initializer.add(frame(k, picture(T, planes), None if bases is None else bases[k]))
        got = got if isinstance(got, str) else TWO_VIEWS.reconstruct(got)
        if isinstance(got, InitialMap):
            break
    return got


@pytest.mark.parametrize("planes", [WALL, SCENE])
def test_a_wall_and_a_scene_start_with_the_true_motion(planes):
    steps = np.arange(0.0, 0.36, 0.05)
    got = outcome(Initializer(None, CONFIG), planes, [moved(x=x) for x in steps])
    assert isinstance(got, InitialMap)
    T = got.poses[0].inverse() @ got.poses[1]
    size = np.linalg.norm(T.translation)
    assert np.degrees(np.arccos(T.translation[0] / size)) < 3.0
    assert np.degrees(T.rotation_angle_to(SE3.identity())) < 1.0
    points = got.matches.points_world * (steps[got.pair.second.stamp_ns] / size)
    off = [np.abs(points @ np.array(n) - d) / np.linalg.norm(n) for n, d, _ in planes]
    assert np.median(np.min(off, axis=0)) < 0.05


def test_a_wall_starts_with_the_wheels_scale():
    ways = np.arange(0.0, 0.5, 0.05)
    got = outcome(Initializer(MOUNT, CONFIG), WALL, [moved(z=z) for z in ways], [SE2(float(z), 0.0, 0.0) for z in ways])
    assert isinstance(got, InitialMap)
    driven = np.linalg.norm(got.poses[1].translation - got.poses[0].translation)
    assert driven == pytest.approx(ways[got.pair.second.stamp_ns], abs=1e-9)


def test_a_bend_as_the_planner_drives_it_starts_with_the_true_motion():
    bases = [SE2.exp(float(way), 2.0 * float(way)) for way in np.arange(0.0, 0.23, 0.02)]
    cameras = [MOUNT.inverse() @ SE3.from_se2(base) @ MOUNT for base in bases]
    got = outcome(Initializer(MOUNT, CONFIG), SCENE, cameras, bases)
    assert isinstance(got, InitialMap)
    T, true = got.poses[0].inverse() @ got.poses[1], cameras[got.pair.second.stamp_ns]
    assert np.linalg.norm(T.translation - true.translation) < 0.01
    assert np.degrees(T.rotation_angle_to(true)) < 0.3


def test_a_hiccup_of_the_wheels_starts_no_map_without_scale():
    ways = np.arange(0.0, 0.6, 0.05)
    odometry = [SE2(float(z), 0.0, 0.0) for z in ways]
    hiccups = [None if k in (0, 3) else base for k, base in enumerate(odometry)]
    got = outcome(Initializer(MOUNT, CONFIG), WALL, [moved(z=z) for z in ways], hiccups)
    assert isinstance(got, InitialMap)
    driven = np.linalg.norm(got.poses[1].translation - got.poses[0].translation)
    assert driven == pytest.approx(ways[got.pair.second.stamp_ns] - ways[1], abs=1e-9)


def test_wheels_that_begin_after_the_camera_are_waited_for():
    ways = np.arange(0.0, 1.0, 0.05)
    late = [None if k < 10 else SE2(float(z), 0.0, 0.0) for k, z in enumerate(ways)]
    got = outcome(Initializer(MOUNT, CONFIG), SCENE, [moved(x=z) for z in ways[:10]], late)
    assert got == "odometry is silent: waiting for it"
    got = outcome(Initializer(MOUNT, CONFIG), WALL, [moved(z=z) for z in ways], late)
    assert isinstance(got, InitialMap)
    driven = np.linalg.norm(got.poses[1].translation - got.poses[0].translation)
    assert driven == pytest.approx(ways[got.pair.second.stamp_ns] - ways[10], abs=1e-9)


def _silent_for_good(initializer):
    return [
        initializer.add(frame(k * 300_000_000, picture(moved(x=0.05 * k), SCENE), SE2() if k == 0 else None))
        for k in range(11)
    ]


def test_a_map_that_needs_scale_waits_for_wheels_that_fall_silent():
    said = _silent_for_good(Initializer(MOUNT, CONFIG, needs_scale=True))
    assert set(said[1:]) == {"odometry is silent: waiting for it"}


def test_a_second_map_does_without_wheels_that_fall_silent_for_good():
    said = _silent_for_good(Initializer(MOUNT, CONFIG))
    assert ["waiting for it" in str(word) for word in said[1:4]] == [True] * 3
    assert "starting again without it" in said[4]
    assert isinstance(said[-1], InitialPair)
    assert said[-1].odometry is None


def test_standing_and_turning_and_darkness_are_refused_by_name():
    assert "stands still" in outcome(Initializer(None, CONFIG), SCENE, [moved()] * 2)
    turning = outcome(Initializer(None, CONFIG), SCENE, [moved(yaw=a) for a in (0.0, 0.03, 0.06, 0.09)])
    assert "turns in place" in turning
    assert "sees too little" in outcome(Initializer(None, CONFIG), [], [moved()] * 2)


def test_the_wheels_refuse_by_name():
    ways, turns = (0.0, 0.05, 0.1), np.linspace(0.0, 0.54, 17).tolist()
    bases = [SE2(0.0, 0.0, a) for a in turns]
    turning = outcome(Initializer(MOUNT, CONFIG), SCENE, [moved(yaw=-a) for a in turns], bases)
    assert isinstance(turning, str)
    assert "turns: 31 deg" in turning
    standing = outcome(Initializer(MOUNT, CONFIG), SCENE, [moved()] * 2, [SE2()] * 2)
    assert "stands still" in standing
    ahead = [SE2(2.0 * x, 0.0, 0.0) for x in ways]
    disagreeing = outcome(Initializer(MOUNT, CONFIG), SCENE, [moved(x=x) for x in ways], ahead)
    assert "odometry disagrees" in disagreeing


def pairs_of(motion, depths=(1.5, 4.0), noise_px=0.2, seed=0):
    """Rays (400, 2) of two views of a room's depths, T_b_a the motion, and a twentieth of them wrong."""
    rng = np.random.default_rng(seed)
    rays_a = rng.uniform((-0.6, -0.45), (0.6, 0.45), (400, 2))
    points = np.column_stack([rays_a, np.ones(400)]) * rng.uniform(*depths, 400)[:, None]
    there = SE3.exp(np.array(motion)) @ points
    rays_b = there[:, :2] / there[:, 2:] + rng.normal(0.0, noise_px / 525.0, (400, 2))
    rays_b[:20] += rng.uniform(-0.05, 0.05, (20, 2))
    return rays_a, rays_b


def verdict(rays_a, rays_b):
    """The best motion, and why it is none to start with (empty: it is one)."""
    best = TWO_VIEWS._choose(
        [TWO_VIEWS._refine(T, rays_a, rays_b, 1 / 525.0, 0.004) for T in two_view_motions(rays_a, rays_b, 1 / 525.0)],
        None,
    )
    return (None, best) if isinstance(best, str) else (best, TWO_VIEWS._doubt(best, rays_a, rays_b))


@pytest.mark.parametrize("seed", range(12))
def test_a_rotation_and_a_tiny_baseline_never_start(seed):
    turn = np.random.default_rng(seed).normal(0.0, 0.03, 3)
    tiny = np.random.default_rng(seed).normal(0.0, 1.0, 3)
    tiny *= 0.005 * 2.5 / np.linalg.norm(tiny)  # 0.5 % of the median depth
    assert verdict(*pairs_of([0.0, 0.0, 0.0, *turn], seed=seed))[1]
    assert verdict(*pairs_of([*tiny, *turn], seed=seed))[1]


@pytest.mark.parametrize("seed", range(12))
def test_a_good_baseline_starts_in_its_direction(seed):
    rng = np.random.default_rng(seed)
    turn, way = rng.normal(0.0, 0.03, 3), rng.normal(0.0, 1.0, 3)
    way *= 0.25 / np.linalg.norm(way)
    best, doubt = verdict(*pairs_of([*way, *turn], seed=seed))
    assert doubt == ""
    true = SE3.exp(np.array([*way, *turn])).translation
    assert np.degrees(np.arccos(best.T_b_a.translation @ true / np.linalg.norm(true))) < 2.0


def test_predicted_deviations_are_those_of_repeated_noise():
    motion = [0.12, 0.02, 0.03, 0.01, -0.03, 0.02]
    true = SE3.exp(np.array(motion)).translation
    true = true / np.linalg.norm(true)
    off, told, across, level = [], [], np.linalg.svd(true[:, None])[0][:, 1:], []
    for seed in range(40):
        rays_a, rays_b = pairs_of(motion, noise_px=0.5, seed=seed)
        best, _ = verdict(rays_a, rays_b)
        found = certainty(best.T_b_a, rays_a[best.good], rays_b[best.good], 0.1 / 525.0)
        off.append(best.T_b_a.translation @ across)
        told.append(found.direction_rad)
        level.append(found.noise * 525.0)
    worst = np.sqrt(np.linalg.eigvalsh(np.cov(np.array(off).T))[-1])
    assert 0.3 < np.median(level) < 0.42  # the noise is of one image, told is what each of two would have
    assert 0.6 < worst / np.median(told) < 1.6


def test_what_a_rotation_leaves_is_the_noise():
    rays_a, rays_b = pairs_of([0.0, 0.0, 0.0, 0.05, -0.1, 0.02], noise_px=0.3)
    R, left = pure_rotation(rays_a, rays_b)
    assert SE3(R, np.zeros(3)).rotation_angle_to(SE3.exp(np.array([0.0, 0.0, 0.0, 0.05, -0.1, 0.02]))) < 1e-3
    assert 0.2 < 525.0 * np.median(left) < 0.5


def test_a_start_whose_depths_turn_out_wrong_is_begun_again(arc_drive):
    slam, events, states = SequentialSlam(arc_drive.camera, None, Config().slam), [], []
    for image, _, _ in arc_drive.frames:
        result = slam.track(image)
        states.append(result.state)
        watch = slam._mapper._watch
        if watch is not None and not events:
            watch._began = watch._began + np.log(2.0)  # as if all had begun twice as far away
        events += [event for event in slam.drain_events() if event.kind in ("initialised", "restarted")]
    assert [event.kind for event in events[:3]] == ["initialised", "restarted", "initialised"]
    assert "0.5" in events[1].reason
    assert states[-1] is TrackingState.GOOD
    assert slam.snapshot().keyframe_ids[0] == 0


def test_a_young_map_that_loses_the_camera_is_begun_again():
    """After a change to another scene, which is the mirrored one, the map is useless; a new one begins there."""
    slam, states, events = SequentialSlam(CAMERA, None, Config().slam), [], []
    for k in range(26):
        image = picture(moved(x=0.03 * k), WALL)
        seen = image if k < 14 else np.ascontiguousarray(image[:, ::-1])
        states.append(slam.track(Frame(k * 100_000_000, seen)).state)
        events += [event for event in slam.drain_events() if event.kind in ("initialised", "restarted", "second map")]
    assert states[13] is TrackingState.GOOD
    assert [event.kind for event in events] == ["initialised", "restarted", "initialised"]
    assert "lost with" in events[1].reason
    assert 14 + 4 <= events[1].stamp_ns // 100_000_000 <= 14 + 9
    assert TrackingState.NOT_INITIALISED in states[16:]
    assert states[-1] is TrackingState.GOOD

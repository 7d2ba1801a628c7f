"""Which keyframes leave the map, and that the work for a keyframe does not grow with the map."""

import dataclasses

import cv2
import numpy as np
import pytest

from vsx_ros.config import Config
from vsx_ros.config.maps import CullingConfig
from vsx_ros.dense.mapped_ground import MappedGround
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3
from vsx_ros.kernels.vision.patches import PATCH
from vsx_ros.slam.keyframe import FrameData, Observations
from vsx_ros.slam.local_map import LocalMap
from vsx_ros.slam.map import Map
from vsx_ros.slam.map_points import TIED_POINTS, cull_redundant, is_redundant, leave_behind
from vsx_ros.slam.mapper import Mapper
from vsx_ros.slam.slam import SequentialSlam
from vsx_ros.slam.snapshot import snapshot
from vsx_ros.slam.templates import NewTemplates
from vsx_ros.vision.corners import dense_corners
from vsx_ros.vision.pyramid import CompressedPyramid, build_pyramid, picture_file

CAMERA = PinholeCamera(640, 480, 525.0, 525.0, 319.5, 239.5)
RULE = CullingConfig(seen_ratio=0.9, viewers=3, keep_newest=2)


def made_map(sees, step_m=0.1, levels=None, places=None):
    """Keyframes that see the given points, 0.1 m apart unless ``places`` (K, 3) says where."""
    world, n_points = Map(), 1 + max(max(rows) for rows in sees)
    for k in range(len(sees)):
        centre = np.array([step_m * k, 0.0, 0.0]) if places is None else places[k]
        world.add_keyframe(
            FrameData.without_image(k, SE2(step_m * k, 0.0, 0.0)), SE3(np.eye(3), centre), Observations.none()
        )
    templates = NewTemplates(
        np.zeros((n_points, 4)), np.zeros((n_points, 2)), np.zeros((n_points, PATCH, PATCH), np.uint8)
    )
    world.add_points(np.tile([0.0, 0.0, 2.0], (n_points, 1)), templates, 0)
    for k, rows in enumerate(sees):
        n, level = len(rows), 0 if levels is None else levels[k]
        world.observe(k, Observations(np.array(rows), np.zeros((n, 2)), np.zeros((n, 2)), np.full(n, level)))
    for k in range(len(sees)):
        world.update_depth(k)
    return world


def corridor(n_keyframes, made=25, seen=200):
    """Each keyframe sees 25 new points and those of the seven before it."""
    return made_map([list(range(made * k, made * k + seen)) for k in range(n_keyframes)])


def test_a_keyframe_is_redundant_when_enough_others_see_nearly_all_its_points():
    all_of_them, most, fewer = range(100), range(91), range(89)
    assert is_redundant(made_map([all_of_them, most, most, most]), 0, RULE)
    assert not is_redundant(made_map([all_of_them, most, most, fewer]), 0, RULE)
    assert not is_redundant(made_map([all_of_them, most, most]), 0, RULE)


def test_coarser_views_do_not_replace_a_fine_one():
    sees = [range(100)] * 4
    assert not is_redundant(made_map(sees, levels=[0, 0, 0, 1]), 0, RULE)
    assert is_redundant(made_map(sees, levels=[1, 0, 0, 1]), 0, RULE)


def test_keyframes_with_few_points_stay():
    assert not is_redundant(made_map([range(39)] * 5), 2, RULE)
    assert is_redundant(made_map([range(41)] * 5), 2, RULE)


def test_the_first_two_and_the_newest_stay_and_so_many_viewers_are_left():
    world = made_map([range(100)] * 12)
    culled = cull_redundant(world, list(range(12)), RULE)
    assert culled == list(range(2, 10))
    assert world.living == [0, 1, 10, 11]
    assert world.alive.all()
    assert [k.id for k in world.keyframes] == list(range(12))
    assert cull_redundant(world, world.living, RULE) == []


NOISE = 3.0  # grey levels


def noisy_picture():
    """Blurred patches of grey, seen by a camera with noise."""
    rng = np.random.default_rng(0)
    scene = cv2.resize(rng.integers(40, 216, (12, 16)).astype(np.float32), (128, 96), interpolation=cv2.INTER_CUBIC)
    return np.clip(scene + NOISE * rng.normal(size=scene.shape), 0, 255).astype(np.uint8)


def rms(a, b):
    return float(np.sqrt(np.mean((a.astype(float) - b) ** 2)))


def test_what_the_camera_left_behind_is_thinned_and_nothing_of_it_is_forgotten():
    rule, made, seen, n = CullingConfig(), 25, 200, 120
    sees = [range(made * k, made * k + seen) for k in range(n)]
    world, culled = made_map([range(made * n + seen)]), []
    world.forget(0, np.ones(made * n + seen, np.bool_))
    image = noisy_picture()
    corners = dense_corners(build_pyramid(image), 1300)
    frame = FrameData.without_image(0, SE2())._replace(image=build_pyramid(image), corners=corners)
    world.keyframes[0] = dataclasses.replace(world.keyframes[0], data=frame)
    for k, rows in enumerate(sees, 1):
        data = frame._replace(stamp_ns=k, T_odom_base=SE2(0.1 * k, 0.0, 0.0))
        world.add_keyframe(data, SE3(np.eye(3), [0.1 * k, 0.0, 0.0]), Observations.none())
        world.observe(k, Observations(np.array(rows), np.zeros((seen, 2)), np.zeros((seen, 2)), np.zeros(seen, int)))
        culled += leave_behind(world, rule)
    assert set(range(n - rule.behind + 1, n + 1)) <= set(world.living)
    left = n - rule.behind - len(culled)
    assert left < 0.4 * (n - rule.behind)
    assert all(len(world.keyframes[k].observations.rows) == seen for k in culled)
    stay = [world.keyframes[k].data for k in world.living[1:]]
    assert all(isinstance(data.image, CompressedPyramid) for data in stay[: -rule.behind])
    assert all((data.pyramid.table == build_pyramid(image).table).all() for data in stay)
    assert max(rms(data.pyramid.level(0), image) for data in stay) < NOISE, "off by less than the camera's noise"
    assert all((data.corners.positions == corners.positions).all() for data in stay)
    assert all((data.corners.row_table == corners.row_table).all() for data in stay)
    assert len(stay[0].image.content) < image.size / 3
    assert world.alive.all()
    viewers = world.seen(np.arange(len(world.points)))[seen : made * (n - rule.behind)]
    assert np.mean(viewers >= rule.viewers_behind) > 0.9
    living = world.living[1:]
    shared = [np.isin(world.keyframes[a].observations.rows, sees[b - 1]).sum() for a, b in zip(living, living[1:])]
    assert min(shared) >= TIED_POINTS


def test_what_was_driven_beside_a_culled_keyframe_stays_with_its_pass_of_the_place():
    first, second = range(12), range(12, 24)
    world, ground = made_map([first, first, first, second, second]), MappedGround(Config())
    for k, place in enumerate([(0.0, 0.0), (0.3, 0.0), (0.6, 0.0), (0.35, 0.1), (0.65, 0.1)]):
        world.move_keyframe(k, SE3(np.eye(3), [*place, 0.0]))
    ground.moved(SE2(0.3, 0.06, 0.0), 1, beside=1)
    driven = ground.trail(snapshot(world.view()))
    world.cull_keyframe(1)
    assert ground.trail(snapshot(world.view())) == driven
    for k in (3, 4):  # a loop is closed: only the second pass moves
        world.move_keyframe(k, SE3(np.eye(3), world.keyframes[k].T_world_cam.translation - [0.0, 0.1, 0.0]))
    assert ground.trail(snapshot(world.view())) == driven


def test_none_is_passed_over_where_another_map_begins_with_two_keyframes():
    picture = build_pyramid(noisy_picture())
    frame = FrameData.without_image(0, SE2())._replace(image=picture, corners=dense_corners(picture, 500))
    world, rule = Map(), CullingConfig(behind=5)
    for added in (2, *[1] * 10, 2, *[1] * 10):
        for _ in range(added):
            world.add_keyframe(frame, SE3.identity(), Observations.none())
        leave_behind(world, rule, added)
    behind = [isinstance(world.keyframes[k].data.image, CompressedPyramid) for k in world.living]
    assert behind == [True] * (len(behind) - 5) + [False] * 5


def test_a_picture_from_a_file_becomes_as_small_as_any_other():
    picture = build_pyramid(noisy_picture())
    frame = FrameData.without_image(0, SE2())._replace(image=picture, corners=dense_corners(picture, 500))
    read = frame._replace(image=CompressedPyramid(picture_file(picture))).compressed()
    small = frame.compressed()
    assert read.image.content == small.image.content
    assert read.small.tobytes() == small.small.tobytes()
    assert small.compressed() is small


def test_a_keyframe_that_ties_its_neighbours_together_stays():
    left, right = list(range(60)), list(range(60, 120))
    sees = [left, left, left, left, left + right, right, right, right, right]
    world = made_map(sees)
    assert is_redundant(world, 4, RULE)
    assert cull_redundant(world, [4], RULE) == []
    world = made_map([*sees[:4], left + right, *sees[4:]])
    assert cull_redundant(world, [4], RULE) == [4], "the one after it ties them as well"


def test_who_sees_a_point_is_found_among_the_keyframes_of_its_place_alone():
    asked = []
    for n in (30, 300):
        world = corridor(n)
        rows = world.keyframes[20].observations.rows
        observers = world.observers(rows)
        assert set(observers) >= {k for k in range(n) if np.isin(world.keyframes[k].observations.rows, rows).any()}
        whole = [np.count_nonzero(np.isin(k.observations.rows, rows)) for k in world.keyframes]
        assert world.covisible(rows).tolist() == whole
        asked.append(sum(len(world.keyframes[k].observations.rows) for k in observers))
    assert asked[0] == asked[1], "observations touched in a map ten times as large"


def test_the_neighbourhood_that_is_adjusted_does_not_grow_with_the_map():
    sizes = []
    for n in (30, 300):
        mapper = Mapper(CAMERA, None, Config().slam, corridor(n))
        neighbours = mapper.neighbours(n - 1, 8)
        seen = np.unique(np.concatenate([mapper.map.keyframes[k].observations.rows for k in (n - 1, *neighbours)]))
        sizes.append((len(neighbours), len(seen), sum(n - k for k in neighbours)))
    assert sizes[0] == sizes[1]


@pytest.mark.parametrize("n", [8, 40, 400])
def test_the_whole_map_is_adjusted_when_it_has_grown_by_a_tenth(n):
    mapper = Mapper(CAMERA, None, Config().slam, corridor(n))
    due = max(8, round(0.1 * n))
    for added in range(due):
        assert not mapper.refinement_due, added
        mapper._since_global += 1
    assert mapper.refinement_due


def test_strangers_nearby_are_not_tracked_until_a_loop_ties_them():
    """A ring of 40 m at a depth of 2 m; the last keyframes stand beside the first."""
    angles = np.linspace(0.0, 2.0 * np.pi, 200)
    places = np.column_stack([6.4 * np.cos(angles), 6.4 * np.sin(angles), np.zeros(200)])
    sees = [list(range(25 * k, 25 * k + 200)) for k in range(200)]
    local = LocalMap(made_map(sees, places=places).view(), 199)
    assert min(local.keyframes) > 100
    assert local.linked.living.min() > 100
    sees[199] = [*sees[199], *range(20)]
    local = LocalMap(made_map(sees, places=places).view(), 199)
    assert 0 in local.keyframes
    assert {0, 1, 2, 198, 199} <= set(local.linked.living.tolist())
    assert 100 not in local.linked.living


def test_culling_takes_no_known_ground(arc_drive):
    slam = SequentialSlam(arc_drive.camera, arc_drive.T_base_cam, Config().slam)
    for frame, odometry, _ in arc_drive.frames:
        slam.track(frame, odometry)
    world = Map.resumed(slam.slam_map().view)
    before = MappedGround(Config()).grid(snapshot(world.view()))
    for k in world.living[2:-2:2]:
        world.cull_keyframe(k)
    after = MappedGround(Config()).grid(snapshot(world.view()))
    assert before.known_area_m2 > 1.0
    assert np.array_equal(before.data, after.data)

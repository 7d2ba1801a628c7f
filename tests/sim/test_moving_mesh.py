"""People and chairs in a world of triangles: what is drawn of them, where they walk, and that the truth has none."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from gazebo_files import FLOOR, ROOM, WALLS, box_model, walls_of_room, write_world
from sim_views import PERFECT

from vsx_ros.arrays import FloatArray, IntArray
from vsx_ros.config import MountConfig
from vsx_ros.errors import ConfigError
from vsx_ros.geometry.se2 import SE2
from vsx_ros.robot import STOP
from vsx_ros.runs.world import open_world
from vsx_ros.sim.camera import EmulatedCamera
from vsx_ros.sim.chairs import Chair
from vsx_ros.sim.gazebo_world import load_gazebo
from vsx_ros.sim.lit_surfaces import lighting_of, moving_surfaces, still_surfaces
from vsx_ros.sim.mesh_world import MeshWorld
from vsx_ros.sim.movers import movers_of
from vsx_ros.sim.moving import PERSON_RADIUS_M, Mover, Moving, Robot
from vsx_ros.sim.moving_mesh import MovingMesh
from vsx_ros.sim.optics import scene_of
from vsx_ros.sim.people import Person
from vsx_ros.sim.renderer import Picture
from vsx_ros.sim.robot import EmulatedRobot
from vsx_ros.sim.truth import gap_to_walls, ground_truth_grid
from vsx_ros.sim.world import Start
from vsx_ros.sim.world_file import with_hard_things

FAR = Robot(SE2(-50.0, 0.0, 0.0), 0.18)
START = Start(x=-1.5, y=0.0, theta_rad=0.0)


def hall(folder: Path, *parts: str) -> MeshWorld:
    folder.mkdir(exist_ok=True)
    return load_gazebo(write_world(folder, FLOOR, WALLS, *parts), [], START)


def seen(world: MeshWorld, movers: list[Mover], *stamps_ns: int) -> Picture:
    """The last of the pictures from the world's start at the stamps (0), while all movers go to the left at 1 m/s."""
    camera = EmulatedCamera(scene_of(world, movers), MountConfig(), PERFECT, np.random.default_rng(0))
    start, states = world.start, np.array(Moving(movers).state)

    def poses_at(stamps: IntArray) -> FloatArray:
        rows = np.repeat([[start.x, start.y, start.theta_rad, 0.0, *states]], len(stamps), axis=0)
        if len(states):
            rows[:, 5] += stamps * 1e-9
        return rows

    return [camera.picture(stamp_ns, poses_at, want_depth=True) for stamp_ns in stamps_ns or (0,)][-1]


def chair(x: float, y: float, heading: float) -> Chair:
    return Chair(0, np.array([(x, y, heading)]), np.random.default_rng(1))


def test_a_mover_looks_like_the_same_solids_that_stand_there(tmp_path: Path) -> None:
    place, boxes = SE2(0.5, 0.2, 0.7), []
    for k, solid in enumerate(chair(0.0, 0.0, 0.0).parts[0]):
        low, high = solid.footprint.min(axis=0), solid.footprint.max(axis=0)
        x, y = (place @ (0.5 * (low + high))[None])[0].tolist()
        pose = f"{x} {y} {0.5 * (solid.z_min + solid.z_max)} 0 0 {place.theta}"
        boxes.append(box_model(f"b{k}", pose, f"{high[0] - low[0]} {high[1] - low[1]} {solid.z_max - solid.z_min}"))
    as_boxes = seen(hall(tmp_path / "a", *boxes), [])
    as_mover = seen(hall(tmp_path / "b"), [chair(place.x, place.y, place.theta)])
    assert (as_boxes.depth < 2.0).sum() > 3000
    off = np.abs(as_mover.depth - as_boxes.depth)
    assert (off < 1e-3).mean() > 0.9995  # a pixel at an edge may fall to either side


def test_a_person_is_drawn_with_texture_and_nothing_else_changes(tmp_path: Path) -> None:
    world = hall(tmp_path)
    somebody = Person(0, np.array([(1.5, 0.0), (1.5, 1.0)]), np.random.default_rng(1))
    still, picture = seen(world, []), seen(world, [somebody])
    hit = picture.ident >= len(world.parts.seen.corners)
    assert float(np.median(picture.depth[hit])) == pytest.approx(3.0, abs=0.15)
    assert np.ptp(np.nonzero(hit)[1]) * 3.0 / 517 == pytest.approx(0.55, abs=0.2)
    assert picture.radiance[hit].std() > 0.03
    assert np.array_equal(still.depth[~hit], picture.depth[~hit])
    beside = cv2.dilate(hit.astype(np.uint8), np.ones((3, 3), np.uint8)) == 0
    assert np.abs(still.radiance - picture.radiance)[beside].max() < 0.01
    assert np.array_equal(seen(world, [somebody]).radiance, picture.radiance)


def test_a_person_on_the_way_is_drawn_elsewhere_in_the_next_image(tmp_path: Path) -> None:
    world = hall(tmp_path)
    somebody = Person(0, np.array([(1.5, 0.0), (1.5, 1.0)]), np.random.default_rng(1))
    images = seen(world, [somebody]), seen(world, [somebody], 0, 500_000_000), seen(world, [somebody], 500_000_000)
    hits = [image.ident >= len(world.parts.seen.corners) for image in images]
    before, after, alone = (float(np.nonzero(hit)[1].mean()) for hit in hits)
    assert before - after == pytest.approx(517 * 0.5 / 3.0, abs=6.0)
    assert after == alone
    assert np.array_equal(images[1].radiance, images[2].radiance)


def test_people_and_chairs_keep_out_of_the_solids(tmp_path: Path) -> None:
    table = box_model("table", "1 1 0.7 0 0 0", "1.2 0.8 0.06")  # no robot touches it, but a person does
    path = write_world(tmp_path, FLOOR, walls_of_room(8.0, 6.0), table)
    world = with_hard_things(
        load_gazebo(path, [], Start(x=-3.0, y=-2.0, theta_rad=0.0)), {"people": 3, "chairs": 2}, "t"
    )
    movers = movers_of(world, 5)
    crowd = [mover for mover in movers if mover.is_person]
    assert (len(crowd), len(movers)) == (3, 5)
    assert [mover.state.tolist() for mover in movers] == [mover.state.tolist() for mover in movers_of(world, 5)]
    walls = world.obstacle_segments(0.0, 1.8)
    moving, places = Moving(movers), []
    for _ in range(600):
        moving.step(0.05, FAR)
        places.append([mover.state[:2] for mover in crowd])
    track = np.array(places)
    assert (np.ptp(track, axis=0).max(axis=1) > 1.0).all()
    assert gap_to_walls(walls, track[::5].reshape(-1, 2)).min() > PERSON_RADIUS_M - 0.02


def test_where_no_robot_fits_with_its_clearance_there_are_no_chairs_and_people(tmp_path: Path) -> None:
    narrow = load_gazebo(write_world(tmp_path, FLOOR, walls_of_room(4.0, 0.5)), [], Start(x=0.0, y=0.0, theta_rad=0.0))
    assert movers_of(with_hard_things(narrow, {"people": 2, "chairs": 2}, "t"), 1) == []


def test_a_robot_meets_people_in_a_gazebo_world_and_the_truth_has_none() -> None:
    plain, world = (open_world(str(ROOM), 1, hard=words) for words in ([], ["people=1"]))
    robot = EmulatedRobot(world, 1)
    images = [robot.step(STOP).frame.image for _ in range(3)]
    assert len(images[0])
    assert robot.body.poses_at(np.array([0])).shape == (1, 4 + 4)
    truths = [ground_truth_grid(one, 0.05, 0.0, 0.45).data for one in (plain, world)]
    assert np.array_equal(*truths)


def test_doors_need_a_generated_building() -> None:
    with pytest.raises(ConfigError, match="doors goes with generated buildings"):
        open_world(str(ROOM), 1, hard=["doors"])


def test_a_path_tracer_gets_the_world_without_people_and_people_where_they_are(tmp_path: Path) -> None:
    world, somebody = hall(tmp_path), Person(0, np.array([(1.5, 0.0), (1.5, 1.0)]), np.random.default_rng(1))
    alone, scene = scene_of(world), scene_of(world, [somebody])
    assert isinstance(scene, MovingMesh)
    for before, after in zip(still_surfaces(alone), still_surfaces(scene), strict=True):
        assert np.array_equal(before.corners, after.corners)
    assert lighting_of(scene).ambient == lighting_of(alone).ambient
    places = np.concatenate([s.corners for s in moving_surfaces(scene, somebody.state[None, None])])
    assert np.abs(places[:, :2] - [1.5, 0.0]).max() < 0.5
    assert places[:, 2].min() == pytest.approx(0.0, abs=0.05)
    assert places[:, 2].max() == pytest.approx(1.72, abs=0.01)

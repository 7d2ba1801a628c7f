"""People, doors and chairs: where they go, what they look like, and how they meet the robot."""

import math

import numpy as np
import pytest
from msgspec.structs import replace
from sim_views import PERFECT

from vsx_ros.arrays import FloatArray, IntArray
from vsx_ros.config import MountConfig
from vsx_ros.geometry.se2 import SE2
from vsx_ros.robot import STOP, VelocityCommand
from vsx_ros.sim.body import Body, BodySettings, Contacts
from vsx_ros.sim.camera import EmulatedCamera
from vsx_ros.sim.chairs import SIDE_M, Chair
from vsx_ros.sim.doors import CLOSED_S, OPEN_RAD, OPEN_S, Door, doors, gaps
from vsx_ros.sim.generate import generate_world
from vsx_ros.sim.movers import movers_of
from vsx_ros.sim.moving import NO_BORDERS, PERSON_RADIUS_M, Mover, Moving, Robot
from vsx_ros.sim.optics import scene_of
from vsx_ros.sim.people import STOPS_BEFORE_M, Person, people
from vsx_ros.sim.renderer import Picture
from vsx_ros.sim.robot import EmulatedRobot
from vsx_ros.sim.scene import compile_scene
from vsx_ros.sim.truth import gap_to_walls
from vsx_ros.sim.world import Box, World
from vsx_ros.sim.world_file import with_hard_things

NOBODY = np.zeros((0, 3))
FAR = Robot(SE2(-50.0, 0.0, 0.0), 0.18)
PERFECT_BODY = BodySettings(wheel_scale_error=0.0, slip=0.0, gyro_scale_error=0.0, gyro_bias_rad_s=0.0)


def person(number: int = 0, *places: tuple[float, float]) -> Person:
    """Somebody who walks between the places; an even number stops before the robot."""
    return Person(number, np.array(places or [(4.0, 2.0), (1.0, 2.0)]), np.random.default_rng(1))


def chair(*place: float) -> Chair:
    return Chair(0, np.array([place or (3.0, 2.0, 0.3)]), np.random.default_rng(1))


def seen(world: World, movers: list[Mover]) -> Picture:
    """The picture and its depth from the world's start, with the movers as they are."""
    camera = EmulatedCamera(scene_of(world, movers), MountConfig(), PERFECT, np.random.default_rng(0))
    start, states = world.start, Moving(movers).state

    def poses_at(stamps: IntArray) -> FloatArray:
        return np.repeat(np.array([[start.x, start.y, start.theta_rad, 0.0, *states]]), len(stamps), axis=0)

    return camera.picture(0, poses_at, want_depth=True)


def body_among(movers: list[Mover], start: SE2, walls: FloatArray | None = None) -> Body:
    far = np.array([[50.0, -5.0, 50.0, 5.0]])
    return Body(far if walls is None else walls, start, 0.18, PERFECT_BODY, np.random.default_rng(3), Moving(movers))


def test_a_mover_looks_like_the_same_solids_that_stand_there(empty_room: World) -> None:
    place = SE2(3.0, 2.2, 0.7)
    boxes = []
    for solid in chair().parts[0]:
        low, high = solid.footprint.min(axis=0), solid.footprint.max(axis=0)
        x, y = (place @ (0.5 * (low + high))[None])[0].tolist()
        size = {"length": high[0] - low[0], "width": high[1] - low[1], "height": solid.z_max - solid.z_min}
        boxes.append(Box(x=x, y=y, yaw_rad=place.theta, base_z=solid.z_min, material="red", **size))
    as_boxes = seen(replace(empty_room, boxes=boxes), [])
    as_mover = seen(empty_room, [chair(place.x, place.y, place.theta)])
    assert (as_boxes.depth < 2.0).sum() > 3000
    assert np.abs(as_mover.depth - as_boxes.depth).max() < 1e-3


def test_a_person_is_as_high_and_as_wide_as_a_person(empty_room: World) -> None:
    still, first = seen(empty_room, []), len(compile_scene(empty_room).P)
    picture = seen(empty_room, [person(0, (4.5, 2.0), (1.0, 2.0))])
    hit = picture.ident >= first
    rows, columns = np.nonzero(hit)
    assert float(np.median(picture.depth[hit])) == pytest.approx(3.0, abs=0.1)
    assert np.ptp(columns) * 3.0 / 517 == pytest.approx(0.55, abs=0.2)
    assert np.array_equal(still.depth[~hit], picture.depth[~hit])
    assert picture.radiance[hit].std() > 0.05  # textured


def test_people_walk_at_their_pace_and_keep_out_of_the_walls() -> None:
    world = generate_world("lab", 3)
    walls = world.obstacle_segments(0.0, 1.8)
    crowd = people(world, 4, np.random.default_rng(2))
    assert len(crowd) == 4
    for somebody in crowd:
        track = []
        for _ in range(600):
            somebody.step(0.05, FAR, NOBODY, NO_BORDERS)
            track.append(somebody.state)
        ways = np.diff(np.array(track)[:, 3])
        assert 0.3 * 0.05 - 1e-9 < np.median(ways) < 1.2 * 0.05 + 1e-9
        assert np.hypot(*np.diff(np.array(track)[:, :2], axis=0).T) == pytest.approx(ways, abs=1e-9)
        assert gap_to_walls(walls, np.array(track)[::10, :2]).min() > PERSON_RADIUS_M - 0.02
        assert np.ptp(np.array(track)[:, 0]) > 1.0


def test_one_who_stops_keeps_off_the_robot_and_turns_round() -> None:
    somebody, robot = person(0), Robot(SE2(2.0, 2.0, 0.0), 0.18)
    gaps_m = []
    for _ in range(2000):
        somebody.step(0.02, robot, NOBODY, NO_BORDERS)
        gaps_m.append(robot.gap_m(*somebody.state[:2].tolist()) - PERSON_RADIUS_M)
        assert not somebody.pushes
    assert min(gaps_m) == pytest.approx(STOPS_BEFORE_M, abs=0.03)
    assert max(gaps_m) > 1.0


def test_one_who_does_not_stop_walks_into_a_standing_robot_once_a_visit() -> None:
    somebody = person(1)
    body = body_among([somebody], SE2(2.0, 2.0, 0.0))
    while not body.contacts.by_people:
        body.advance(100_000_000)
        assert body.time_ns < 10_000_000_000
    assert body.contacts == Contacts(by_people=1)
    assert body.collisions == 0
    assert any(body.bumper)
    assert body.T_world_base == SE2(2.0, 2.0, 0.0)
    body.advance(4_000_000_000)
    assert body.contacts.by_people == 1  # has turned round
    assert not any(body.bumper)


def test_a_robot_that_has_just_come_to_rest_is_not_to_blame() -> None:
    body = body_among([person(1)], SE2(1.9, 2.0, 0.0))
    body.set_wheel_speeds(0.2, 0.2)
    body.advance(500_000_000)
    body.set_wheel_speeds(0.0, 0.0)
    while body.contacts == Contacts():
        body.advance(100_000_000)
    assert body.contacts == Contacts(by_people=1)


@pytest.mark.parametrize(("heading", "cause"), [(0.0, "into_people"), (math.pi, "by_people")])
def test_the_robot_s_own_motion_into_a_person_counts_if_its_camera_could_see(heading: float, cause: str) -> None:
    class Statue(Person):
        def step(self, dt_s: float, robot: Robot, people: FloatArray, things: FloatArray) -> None:
            pass

    standing = Statue(0, np.array([(3.0, 2.0), (1.0, 2.0)]), np.random.default_rng(1))
    body = body_among([standing], SE2(2.0, 2.0, heading))
    speed = 0.2 if heading == 0.0 else -0.2
    body.set_wheel_speeds(speed, speed)
    body.advance(5_000_000_000)
    assert body.contacts._asdict() == {"things": 0, "into_people": 0, "by_people": 0, cause: 1}
    assert body.T_world_base.x == pytest.approx(3.0 - 0.18 - PERSON_RADIUS_M, abs=0.03)


def test_chairs_and_doors_are_things() -> None:
    body = body_among([chair(3.0, 2.0, 0.0)], SE2(2.0, 2.0, 0.0))
    body.set_wheel_speeds(0.2, 0.2)
    body.advance(5_000_000_000)
    assert body.contacts.things == body.collisions == 1
    assert body.T_world_base.x == pytest.approx(3.0 - 0.21 - 0.18, abs=0.01)


def test_a_door_opens_and_closes_in_its_times() -> None:
    door = Door(0, SE2(), 1.2, 1, np.random.default_rng(4))
    angles = []
    for _ in range(6000):
        door.step(0.05, FAR, NOBODY, NO_BORDERS)
        angles.append(float(door.state[0]))
    changes = np.flatnonzero(np.diff((np.array(angles) > 0.5 * OPEN_RAD).astype(int)))
    lasts_s = np.diff(changes) * 0.05
    assert len(changes) >= 4
    assert lasts_s.min() > CLOSED_S[0]
    assert lasts_s.max() < OPEN_S[1] + 2.0 * OPEN_RAD + 0.1


def test_a_door_waits_for_who_stands_in_its_way() -> None:
    door = Door(0, SE2(), 1.2, 1, np.random.default_rng(4))
    robot = Robot(SE2(0.6, 0.3, 0.0), 0.18)
    for _ in range(3000):
        door.step(0.05, robot, NOBODY, NO_BORDERS)
        leaf = door.borders(door.state)
        assert gap_to_walls(leaf, np.array([[0.6, 0.3]]))[0] > 0.18
    assert door.state[0] > 0.3


def test_doors_hang_in_the_gaps_of_the_walls_and_swing_free() -> None:
    hung = 0
    for seed in range(20, 26):
        world = generate_world("lab", seed)
        walls = np.array([[*wall.points[0], *wall.points[-1]] for wall in world.walls])
        places = [0.5 * (a + b) for a, b in gaps(world)]
        for place in places:
            assert 0.4 < gap_to_walls(walls, place[None])[0] < 0.9
        for door in doors(world, 5, np.random.default_rng(seed)):
            hung += 1
            middle = door.borders(np.array([0.0]))[:, :2].mean(axis=0)
            assert min(float(np.hypot(*(middle - place))) for place in places) < 0.02
            assert gap_to_walls(world.obstacle_segments(0.0, 1.0), door.borders(door.state)[:, :2]).min() > 0.0
    assert hung >= 4


def swept(door: Door) -> FloatArray:
    """Borders of the leaf at all angles."""
    return np.concatenate([door.borders(np.array([angle])) for angle in np.linspace(0.0, OPEN_RAD, 60)])


@pytest.mark.parametrize(("name", "seed"), [("lab", 313), ("lab", 340), ("office", 335)])
def test_nobody_and_nothing_stands_where_a_door_swings(name: str, seed: int) -> None:
    world = with_hard_things(generate_world(name, seed), {"doors": 3, "chairs": 5, "people": 5}, "test")
    movers = movers_of(world, seed)
    leaves = [swept(mover) for mover in movers if isinstance(mover, Door)]
    assert leaves
    for leaf in leaves:
        assert gap_to_walls(leaf, np.array([[world.start.x, world.start.y]]))[0] > 0.18 + 0.1
        for mover in movers:
            if isinstance(mover, Chair):
                assert gap_to_walls(leaf, mover.places[:, :2]).min() > 0.5 * SIDE_M * 2.0**0.5
            elif isinstance(mover, Person):
                assert gap_to_walls(leaf, mover.state[None, :2])[0] > PERSON_RADIUS_M


@pytest.mark.parametrize("turn", [1, -1])
def test_a_door_knows_the_ground_that_its_leaf_sweeps(turn: int, rng: np.random.Generator) -> None:
    door = Door(0, SE2(1.0, 2.0, 0.7), 1.2, turn, rng)
    leaf = swept(door)
    for x, y in rng.uniform((-1.0, 0.0), (3.0, 4.0), (200, 2)).tolist():
        gap_m = float(gap_to_walls(leaf, np.array([[x, y]]))[0])
        assert door.gap_m(x, y) == pytest.approx(gap_m, abs=0.03)


def test_a_chair_moves_while_nobody_looks() -> None:
    places = np.array([[3.0, 2.0, 0.0], [1.0, 1.0, 1.0], [4.0, 3.0, 2.0]])
    watched, alone = (Chair(0, places, np.random.default_rng(1)) for _ in range(2))
    for _ in range(6000):
        watched.step(0.1, Robot(SE2(2.5, 1.9, 0.0), 0.18), NOBODY, NO_BORDERS)
        alone.step(0.1, FAR._replace(pose=SE2(-50.0, 0.0, math.pi)), NOBODY, NO_BORDERS)
    assert watched.state.tolist() == places[0].tolist()
    assert alone.state.tolist() != places[0].tolist()


def test_same_seed_same_bits_other_seed_others() -> None:
    lab = with_hard_things(generate_world("lab", 20), {"people": 3, "doors": 1, "chairs": 2}, "test")
    runs = []
    for seed in (1, 1, 2):
        robot = EmulatedRobot(lab, seed)
        frames = [robot.step(VelocityCommand(0.1, 0.2)).frame.image for _ in range(4)]
        runs.append((frames, robot.body.poses_at(np.array([200_000_000]))))
    assert all(np.array_equal(a, b) for a, b in zip(runs[0][0], runs[1][0]))
    assert np.array_equal(runs[0][1], runs[1][1])
    assert not np.array_equal(runs[0][1], runs[2][1])


def test_a_world_without_them_has_none_and_one_has_as_many_as_fit(lab: World) -> None:
    assert movers_of(lab, 1) == []
    assert EmulatedRobot(lab, 1).step(STOP).frame.image.shape == (480, 640)
    many = with_hard_things(lab, {"people": 20, "chairs": 5, "doors": 20}, "test")
    kinds = [type(mover).__name__ for mover in movers_of(many, 1)]
    assert 15 <= kinds.count("Person") <= 20
    assert kinds.count("Chair") >= 1
    assert kinds.count("Door") <= len(gaps(lab))

import cv2
import numpy as np
import pytest
from sim_views import still_view

from vsx_ros.errors import ConfigError
from vsx_ros.sim.generate import generate_world
from vsx_ros.sim.truth import free_ahead, free_places, gap_to_walls, is_connected

SEEDS = range(12)


@pytest.mark.parametrize("seed", SEEDS)
def test_labs_are_furnished_connected_and_start_in_the_open(seed: int) -> None:
    world = generate_world("lab", seed)
    assert world.bounds == (0.0, 0.0, 12.0, 8.0)
    assert 4 <= len(world.boxes) <= 12
    assert 1 <= len(world.tables) <= 2
    assert is_connected(world)
    start = world.start
    assert free_ahead(world, start.x, start.y, start.theta_rad) >= 1.2
    assert gap_to_walls(world.obstacle_segments(0.0, 0.6), np.array([[start.x, start.y]]))[0] >= 0.5


@pytest.mark.parametrize("name", ["office", "corridor"])
def test_other_generators_are_connected(name: str) -> None:
    for seed in (0, 1):
        assert is_connected(generate_world(name, seed))


def test_a_building_is_large_and_every_room_has_a_door() -> None:
    world = generate_world("building", 3)
    assert world.bounds == (0.0, 0.0, 40.0, 25.0)
    places = free_places(world)
    assert is_connected(world)
    reachable = len(places) * 0.05**2
    assert 450.0 < reachable < 900.0
    for x, y in ((1.0, 1.0), (38.5, 23.5), (20.0, 12.5)):  # two corner rooms and the crossing
        assert (np.abs(places - [x, y]) < 1.0).all(axis=1).any()
    assert len(world.walls) > 60
    assert len(world.boxes) > 20


def test_furniture_stands_in_no_wall_whichever_way_it_runs() -> None:
    world = generate_world("building", 3)
    for box in world.boxes:
        for wall in world.walls:
            (ax, ay), (bx, by) = wall.points
            reach = 0.5 * np.hypot(box.length, box.width)
            across = abs(box.y - ay) if ay == by else abs(box.x - ax)
            along = min(ax, bx) < box.x < max(ax, bx) if ay == by else min(ay, by) < box.y < max(ay, by)
            assert across >= reach or not along


def test_same_seed_same_world_and_other_seed_another() -> None:
    assert generate_world("lab", 5) == generate_world("lab", 5)
    assert generate_world("lab", 5) != generate_world("lab", 6)
    assert generate_world("lab", 5) != generate_world("office", 5)


def test_unknown_name_and_negative_seed_are_refused() -> None:
    with pytest.raises(ConfigError, match="castle"):
        generate_world("castle", 0)
    with pytest.raises(ConfigError, match="-1"):
        generate_world("lab", -1)


@pytest.mark.parametrize("seed", [0, 4, 7])
def test_ordinary_views_hold_corners_and_plain_surfaces(seed: int) -> None:
    """A camera that looks where the robot could drive sees corners nearly everywhere, yet half the picture is plain."""
    world = generate_world("lab", seed)
    view = still_view(world)
    fast = cv2.FastFeatureDetector_create(20)
    start = world.start_pose
    assert len(fast.detect(view(start.x, start.y, start.theta))) >= 150
    places = free_places(world)
    rng = np.random.default_rng(1)
    counts, plain = [], []
    while len(counts) < 30:
        (x, y), theta = places[int(rng.integers(len(places)))].tolist(), float(rng.uniform(-np.pi, np.pi))
        if free_ahead(world, x, y, theta) < 0.8:
            continue
        image = view(x, y, theta)
        counts.append(len(fast.detect(image)))
        plain.append((image.reshape(60, 8, 80, 8).std(axis=(1, 3)) < 4.0).mean())
    assert np.mean(np.array(counts) >= 150) >= 0.93
    assert 350 <= np.median(counts) <= 1500
    assert 0.25 <= np.mean(plain) <= 0.75

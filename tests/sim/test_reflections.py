"""Mirrors, glossy floors, glass and windows: what they show, and that they are as solid as they were."""

import math

import numpy as np
import pytest
from msgspec.structs import replace
from sim_views import PERFECT, camera_in, plain_room, standing

from vsx_ros.config import MountConfig
from vsx_ros.robot import STOP
from vsx_ros.sim.camera import EmulatedCamera
from vsx_ros.sim.generate import generate_world
from vsx_ros.sim.optics import scene_of
from vsx_ros.sim.reflectors import GLASS_SHARE, MIRROR_SHARE
from vsx_ros.sim.renderer import Picture
from vsx_ros.sim.robot import EmulatedRobot
from vsx_ros.sim.world import Box, Material, Poster, Wall, World
from vsx_ros.sim.world_file import with_hard_things

BLACK = Material(kind="plain", brightness=0.0)


def seen(world: World, x: float = 1.5, y: float = 2.0, theta: float = 0.0) -> Picture:
    camera = EmulatedCamera(scene_of(world), MountConfig(), PERFECT, np.random.default_rng(0))
    return camera.picture(0, standing(x, y, theta), want_depth=True)


def pixel(world: World, point: tuple[float, float, float]) -> tuple[int, int]:
    """Row and column of a point for the camera of ``seen`` at its usual place."""
    camera = camera_in(world)
    R, t = camera.poses_cam(standing(1.5, 2.0, 0.0)(np.array([0])))
    u, v = camera.camera_true.project((np.array([point]) - t) @ R[0])[0]
    return round(float(v)), round(float(u))


def mirrored_room() -> World:
    """A mirror on the east wall, 4.5 m before the camera; a black box behind the robot, left of it."""
    mirror = Poster(x=6.0, y=2.0, z=0.8, yaw_rad=math.pi, width=2.4, height=1.5, material="mirror")
    box = Box(x=0.6, y=2.8, length=0.4, width=0.4, height=0.8, material="black")
    materials = plain_room().materials | {"mirror": Material(kind="mirror"), "black": BLACK}
    return plain_room(posters=[mirror], boxes=[box], materials=materials)


def test_a_mirror_shows_what_is_behind_the_robot_where_it_belongs() -> None:
    world = mirrored_room()
    picture = seen(world).radiance
    wall, box = picture[pixel(world, (12.0, 1.6, 0.4))], picture[pixel(world, (11.4, 2.8, 0.4))]
    assert wall == pytest.approx(0.8, abs=0.12)
    mirror = world.materials["mirror"].brightness
    assert box == pytest.approx((1.0 - MIRROR_SHARE) * mirror, abs=0.02)
    beside = picture[pixel(world, (11.4, 2.4, 0.4))]
    assert beside > 0.5
    outside = pixel(world, (6.0, 3.4, 0.4))  # of the mirror, on the wall
    assert picture[outside] == seen(replace(world, posters=[])).radiance[outside]


def test_a_glossy_floor_mirrors_the_more_the_flatter_one_looks() -> None:
    room = plain_room(materials=plain_room().materials | {"dark": BLACK})  # the floor
    glossy = with_hard_things(room, {"glossy-floor": 0.1}, "test")
    assert isinstance(glossy, World)
    assert seen(room).radiance[400, 320] == 0.0
    picture = seen(glossy)
    shares = []
    for distance_m in (1.0, 2.0, 4.0):
        row, column = pixel(glossy, (1.5 + distance_m, 2.0, 0.0))
        assert picture.ident[row, column] == 0
        slope = math.atan2(0.31, distance_m + 0.09)
        expected = 0.1 + 0.9 * (1.0 - math.sin(slope)) ** 5
        shares.append(float(picture.radiance[row, column]) / 0.8)  # of a white wall
        assert shares[-1] == pytest.approx(expected, rel=0.35)
    assert shares[0] < shares[1] < shares[2]


def test_glass_is_solid_and_seen_through() -> None:
    wall = Wall(points=[(3.5, 0.5), (3.5, 3.5)], thickness=0.1, height=2.5, material="glass")
    box = Box(x=5.0, y=2.0, length=0.4, width=0.8, height=0.8, material="red")
    materials = plain_room().materials | {"glass": Material(kind="glass")}
    without = plain_room(boxes=[box], materials=materials)
    world = replace(without, walls=[wall])
    clear, through = seen(without), seen(world)
    middle = slice(100, 380), slice(150, 480)
    assert np.array_equal(clear.depth[middle], through.depth[middle])
    change = through.radiance[middle] - clear.radiance[middle]
    assert 0.005 < np.abs(change).mean() < GLASS_SHARE
    assert len(world.obstacle_segments(0.0, 0.4)) > len(without.obstacle_segments(0.0, 0.4))


def test_windows_are_too_bright_for_the_sensor_and_darken_the_room() -> None:
    world = generate_world("lab", 3)
    bright = with_hard_things(world, {"windows": 20}, "test")
    window = next(poster for poster in bright.posters if poster.material == "outside")  # type: ignore[attr-defined]  # of a lab
    place = window.x + 2.0 * math.cos(window.yaw_rad), window.y + 2.0 * math.sin(window.yaw_rad)
    kind, dazzled = (seen(w, *place, window.yaw_rad + math.pi).radiance for w in (world, bright))
    assert dazzled.max() > 4.0 > 1.5 > kind.max()


def test_everything_that_shines_at_once_with_people_and_the_same_bits_again() -> None:
    things = {"glossy-floor": 0.2, "glass-walls": 1.0, "mirrors": 4, "windows": 2, "people": 2}
    world = with_hard_things(generate_world("lab", 3), things, "test")
    images = [EmulatedRobot(world, 3).step(STOP).frame.image for _ in range(2)]
    assert np.array_equal(*images)


def test_a_world_that_does_not_shine_is_drawn_as_it_was(lab: World) -> None:
    drawn = scene_of(lab)
    assert (drawn.changing, drawn.movers, drawn.reflectors) == (None, None, [])

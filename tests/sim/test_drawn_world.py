"""Light that changes, things that move and surfaces that reflect, all in one world."""

import math
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from msgspec.structs import replace
from sim_views import PERFECT, plain_room, standing

from vsx_ros.config import MountConfig
from vsx_ros.robot import STOP
from vsx_ros.runs.world import save_world
from vsx_ros.sim.camera import EmulatedCamera
from vsx_ros.sim.generate import generate_world
from vsx_ros.sim.lighting import LIGHTS, Lighting, light_named
from vsx_ros.sim.optics import scene_of
from vsx_ros.sim.people import Person
from vsx_ros.sim.renderer import Picture
from vsx_ros.sim.robot import EmulatedRobot
from vsx_ros.sim.scene import quads
from vsx_ros.sim.world import Light, Material, Poster, World
from vsx_ros.sim.world_file import load_world, with_hard_things

SWITCHED_EACH_SECOND = Lighting(circuits=2, switches_per_min=60.0)


def room(kind: str, lighting: Lighting | None) -> World:
    """Two lamps behind the robot; on the wall before it a mirror or a view of the outside."""
    poster = Poster(x=6.0, y=2.0, z=0.8, yaw_rad=math.pi, width=2.4, height=1.5, material=kind)
    lamps = [Light(x=x, y=2.0, z=2.3, strength=1.5) for x in (1.0, 2.0)]
    materials = plain_room().materials | {kind: Material(kind=kind)}
    return plain_room(posters=[poster], lights=lamps, ambient=0.1, materials=materials, lighting=lighting)


def views(world: World) -> Callable[[float], Picture]:
    """Pictures by time [s]: somebody stands right of the middle, the robot does not move."""
    somebody = Person(0, np.array([(3.5, 1.2), (5.0, 1.2)]), np.random.default_rng(1))
    camera = EmulatedCamera(scene_of(world, [somebody]), MountConfig(), PERFECT, np.random.default_rng(0))
    base = standing(1.5, 2.0, 0.0)

    def at(time_s: float) -> Picture:
        return camera.picture(
            round(1e9 * time_s),
            lambda stamps: np.column_stack([base(stamps), np.repeat(somebody.state[None], len(stamps), axis=0)]),
            want_depth=True,
        )

    return at


def test_a_switched_lamp_leaves_people_and_what_a_mirror_shows_darker() -> None:
    world = room("mirror", SWITCHED_EACH_SECOND)
    view, poster = views(world), len(quads(world)) - 1
    both, one, again = view(0.0), view(1.5), view(0.0)
    assert np.array_equal(both.radiance, again.radiance)
    assert np.array_equal(both.ident, one.ident)
    person, mirror = both.ident > poster, both.ident == poster
    assert person.sum() > 1000
    assert mirror.sum() > 1000
    for where in (person, mirror, both.ident < poster):
        assert one.radiance[where].mean() < 0.9 * both.radiance[where].mean()


def test_with_all_lamps_on_it_is_the_steady_light_on_everything() -> None:
    changing, steady = (views(room("mirror", lighting))(0.0) for lighting in (Lighting(circuits=2), None))
    assert np.array_equal(changing.ident, steady.ident)
    assert changing.radiance == pytest.approx(steady.radiance, abs=0.01)


def test_the_outside_is_as_bright_in_any_light() -> None:
    night, steady = (views(room("outside", lighting))(0.0) for lighting in (LIGHTS["night"], None))
    outside = steady.ident == len(quads(room("outside", None))) - 1
    inside_its_border = cv2.erode(outside.astype(np.uint8), np.ones((5, 5))) > 0
    assert inside_its_border.sum() > 1000
    assert np.array_equal(night.radiance[inside_its_border], steady.radiance[inside_its_border])
    assert night.radiance[~outside].mean() < 0.8 * steady.radiance[~outside].mean()


@pytest.mark.parametrize("light", ["switched", "sun"])
def test_a_lab_with_all_of_it_gives_the_same_bits_again(light: str, tmp_path: Path) -> None:
    things = {"glossy-floor": 0.2, "glass-walls": 1.0, "mirrors": 4, "windows": 2, "people": 2, "chairs": 1}
    lab = with_hard_things(generate_world("lab", 3), things, "test")
    lit = replace(lab, lighting=light_named(light, 3))
    save_world(lit, tmp_path / "world.yaml")
    images = []
    for world in (lit, load_world(tmp_path / "world.yaml"), lab):
        robot = EmulatedRobot(world, 3)
        images.append(np.stack([robot.step(STOP).frame.image for _ in range(2)]))
    assert np.array_equal(images[0], images[1])
    assert not np.array_equal(images[0], images[2])

"""Small worlds whose geometry is known by heart."""

import numpy as np
import pytest

from vsx_ros.sim.generate import generate_world
from vsx_ros.sim.scene import Scene, compile_scene
from vsx_ros.sim.world import Box, Light, Material, Origin, Outline, Start, World


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(0)


def plain_room(**changes: object) -> World:
    """6 m x 4 m, 2.5 m high, white walls, start in the middle of the west half looking east."""
    fields: dict[str, object] = {
        "generator": Origin(name="plain", seed=0),
        "start": Start(x=1.5, y=2.0, theta_rad=0.0),
        "ceiling_height": 2.5,
        "floor": "dark",
        "ceiling": "white",
        "ambient": 1.0,
        "materials": {
            "white": Material(kind="plain", brightness=0.8),
            "dark": Material(kind="plain", brightness=0.2),
            "red": Material(kind="plain", brightness=0.6, tint=(1.0, 0.25, 0.5)),
        },
        "outlines": [Outline(points=[(0, 0), (6, 0), (6, 4), (0, 4)], height=2.5, material="white")],
    }
    return World(**{**fields, **changes})  # type: ignore[arg-type]  # fields by name


@pytest.fixture
def empty_room() -> World:
    return plain_room()


@pytest.fixture
def room_with_box() -> World:
    box = Box(x=3.5, y=2.0, length=1.0, width=0.8, height=0.5, material="red")
    lamp = Light(x=2.0, y=2.0, z=2.4, strength=1.0)
    return plain_room(boxes=[box], lights=[lamp])


@pytest.fixture(scope="session")
def lab() -> World:
    return generate_world("lab", 0)


@pytest.fixture(scope="session")
def lab_scene(lab: World) -> Scene:
    return compile_scene(lab)

"""Small worlds whose geometry is known by heart."""

import numpy as np
import pytest
from sim_views import plain_room

from vsx_ros.sim.generate import generate_world
from vsx_ros.sim.scene import Scene, compile_scene
from vsx_ros.sim.world import Box, Light, World


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(0)


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

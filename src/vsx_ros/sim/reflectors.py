"""Which surfaces of a generated world reflect: glossy floors, mirrors and glass."""

from typing import NamedTuple

import numpy as np

from vsx_ros.arrays import FloatArray, IntArray
from vsx_ros.sim.scene import Quad, quads
from vsx_ros.sim.world import World

MIRROR_SHARE, GLASS_SHARE = 0.9, 0.08  # of light from straight ahead; a pane has two surfaces


class Reflector(NamedTuple):
    """A surface: normal @ point = offset [m], the normal towards the viewer. share: of light from straight ahead that
    it reflects. clear: what is behind it is seen. quads: its numbers in the scene."""

    normal: FloatArray
    offset: float
    share: float
    clear: bool
    quads: IntArray


def reflectors_of(world: World) -> list[Reflector]:
    """The reflecting surfaces of a world."""
    found = []
    for number, quad in enumerate(quads(world)):
        kind = world.materials[quad.material].kind
        share = {"mirror": MIRROR_SHARE, "glass": GLASS_SHARE}.get(kind, 0.0)
        if number == 0:  # the floor
            share = world.hard.get("glossy-floor", 0.0)
        if share:
            found.append(_reflector(quad, number, share, clear=kind == "glass"))
    return found


def _reflector(quad: Quad, number: int, share: float, *, clear: bool) -> Reflector:
    normal = np.cross(quad.edge_v, quad.edge_u)
    normal = normal / np.linalg.norm(normal)
    return Reflector(normal, float(normal @ quad.corner), share, clear=clear, quads=np.array([number]))

"""A generated world as the ray caster draws it: what stands still, in the light of a moment, what moves, and what
reflects."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from msgspec.structs import replace

from vsx_ros.arrays import FloatArray, IntArray
from vsx_ros.kernels.sim.raycast_cull import Scene, plane_forms
from vsx_ros.sim.changing_light import ChangingLight, node_spacing_m
from vsx_ros.sim.light_map import Lights
from vsx_ros.sim.moving import Mover
from vsx_ros.sim.moving_quads import DrawnMovers, Moved
from vsx_ros.sim.reflectors import Reflector, reflectors_of
from vsx_ros.sim.scene import compile_scene, glows, quads, steady_lights
from vsx_ros.sim.world import World


class Seen(NamedTuple):
    """A scene from some poses: forms and pool of ``plane_forms``."""

    scene: Scene
    forms: FloatArray
    pool: IntArray


class DrawnWorld(NamedTuple):
    """scene: the quads of the world, then those of its movers, in the light of a moment; lights: this light; changing:
    None if all lamps burn steadily; reflectors: the surfaces that need a second look; glowing: quads that are bright
    whatever the lamps do."""

    scene: Scene
    lights: Lights = Lights()  # noqa: B008 (immutable)
    changing: ChangingLight | None = None
    movers: DrawnMovers | None = None
    reflectors: Sequence[Reflector] = ()
    glowing: IntArray = np.zeros(0, np.int64)

    def at(self, stamp_ns: int) -> "DrawnWorld":
        """The same world in the light of that moment."""
        if self.changing is None:
            return self
        scene, lights = self.changing.at(stamp_ns)
        return self._replace(scene=scene, lights=lights)

    def moved(self, states: FloatArray | None) -> Moved | None:
        """Where the movers are for their states (S, B, K), and how they are lit."""
        if self.movers is None:
            return None
        assert states is not None
        return self.movers.at(states, self.lights)

    def seen(self, R: FloatArray, t: FloatArray, moved: Moved | None) -> Seen:
        """The quads from poses T_world_cam R (S, B, 3, 3), t (S, B, 3) [m]."""
        if self.movers is None or moved is None:
            return Seen(self.scene, *plane_forms(self.scene, R, t))
        return Seen(self.movers.lit(self.scene, moved), *self.movers.forms(self.scene, (R, t), moved))


def draw(world: World, movers: Sequence[Mover] = ()) -> DrawnWorld:
    """Takes about a second, two if the light changes. Raises ConfigError for a world that is too large to be drawn."""
    drawn = DrawnMovers(movers) if movers else None
    moving, materials = ([], {}) if drawn is None else (drawn.quads, drawn.materials)
    scene = compile_scene(replace(world, materials=world.materials | materials), moving, node_spacing_m(world))
    changing = None if world.lighting is None else ChangingLight(world, world.lighting, scene)
    reflectors = reflectors_of(world)
    glowing = np.array([k for k, quad in enumerate(quads(world)) if glows(quad, world)], np.int64)
    return DrawnWorld(
        scene, steady_lights(world), changing=changing, movers=drawn, reflectors=reflectors, glowing=glowing
    )

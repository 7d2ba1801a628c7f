"""The front door to both kinds of emulated worlds: what is drawn of a world, and the optics that draw it."""

from collections.abc import Sequence
from typing import Protocol

from vsx_ros.arrays import FloatArray
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.sim.drawn_world import DrawnWorld, draw
from vsx_ros.sim.emulated_world import EmulatedWorld
from vsx_ros.sim.lit_surfaces import AnyScene
from vsx_ros.sim.mesh_renderer import MeshRenderer
from vsx_ros.sim.mesh_scene import compile_mesh
from vsx_ros.sim.mesh_world import MeshWorld
from vsx_ros.sim.mitsuba_renderer import MitsubaRenderer
from vsx_ros.sim.moving import Mover
from vsx_ros.sim.moving_mesh import MeshMovers, MovingMesh
from vsx_ros.sim.reflections import ShinyRenderer
from vsx_ros.sim.renderer import Picture, Renderer
from vsx_ros.sim.world import World


class Optics(Protocol):
    """Draws a scene: ``Renderer`` for quads, ``MeshRenderer`` for triangles, ``MitsubaRenderer`` for both. Their
    docstrings say more."""

    @property
    def border_rows(self) -> FloatArray: ...  # noqa: D102 (see Renderer)

    def sub_frames(self, R: FloatArray, t: FloatArray) -> int: ...  # noqa: D102 (see Renderer)

    def enlighten(self, stamp_ns: int) -> None: ...  # noqa: D102 (see Renderer)

    def render(  # noqa: D102 (see Renderer)
        self, R: FloatArray, t: FloatArray, bayer: bool = False, want_depth: bool = False,
        states: FloatArray | None = None,
    ) -> Picture: ...  # fmt: skip


def scene_of(world: EmulatedWorld, movers: Sequence[Mover] = ()) -> AnyScene:
    """Everything that an image may show of a world, in which these move. Raises ConfigError for a world that is too
    large to be drawn."""
    if isinstance(world, MeshWorld):
        if not movers:
            return compile_mesh(world)
        moving = MeshMovers(movers)
        return MovingMesh(compile_mesh(world, moving.seen), moving)
    assert isinstance(world, World)
    return draw(world, movers)


def optics_of(scene: AnyScene, camera: PinholeCamera, threads: int, samples: int, paths: int = 0) -> Optics:
    """The optics for a scene. samples: rays a pixel, in a scene of triangles. paths: a pixel, by Mitsuba instead.
    Raises ConfigError when Mitsuba is asked for and does not work."""
    if not isinstance(scene, DrawnWorld):
        still, movers = (scene.scene, scene.movers) if isinstance(scene, MovingMesh) else (scene, None)
        mesh = MeshRenderer(still, camera, threads, 1 if paths else samples, movers)
        return MitsubaRenderer(scene, camera, mesh, paths) if paths else mesh
    flat = (ShinyRenderer if scene.reflectors else Renderer)(scene, camera, threads)
    return MitsubaRenderer(scene, camera, flat, paths) if paths else flat

"""The front door to both kinds of emulated worlds: what is drawn of a world, and the optics that draw it."""

from typing import Protocol, TypeAlias

from vsx_ros.arrays import FloatArray
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.kernels.sim.mesh_scene import MeshScene
from vsx_ros.kernels.sim.raycast_cull import Scene
from vsx_ros.sim.emulated_world import EmulatedWorld
from vsx_ros.sim.mesh_renderer import MeshRenderer
from vsx_ros.sim.mesh_scene import compile_mesh
from vsx_ros.sim.mesh_world import MeshWorld
from vsx_ros.sim.moving_quads import Moved, MovingScene
from vsx_ros.sim.reflections import ShinyRenderer, ShinyScene, reflectors_of
from vsx_ros.sim.renderer import Picture, Renderer
from vsx_ros.sim.scene import compile_scene
from vsx_ros.sim.world import World

AnyScene: TypeAlias = Scene | MovingScene | ShinyScene | MeshScene


class Optics(Protocol):
    """Draws a scene: ``Renderer`` for quads, ``MeshRenderer`` for triangles. Their docstrings say more."""

    @property
    def border_rows(self) -> FloatArray: ...  # noqa: D102

    def sub_frames(self, R: FloatArray, t: FloatArray) -> int: ...  # noqa: D102

    def render(  # noqa: D102
        self, R: FloatArray, t: FloatArray, bayer: bool = False, want_depth: bool = False, moved: Moved | None = None
    ) -> Picture: ...


def scene_of(world: EmulatedWorld) -> AnyScene:
    """Everything of a world that an image may show. Raises ConfigError for a world that is too large to be drawn."""
    if isinstance(world, MeshWorld):
        return compile_mesh(world)
    assert isinstance(world, World)
    return polished(compile_scene(world), world)


def polished(scene: Scene | MovingScene, world: World) -> AnyScene:
    """The scene, with its reflections if it has some."""
    reflectors = reflectors_of(world)
    return ShinyScene(scene, reflectors) if reflectors else scene


def optics_of(scene: AnyScene, camera: PinholeCamera, threads: int, samples: int) -> Optics:
    """The optics for a scene. samples: rays a pixel, in a scene of triangles."""
    if isinstance(scene, MeshScene):
        return MeshRenderer(scene, camera, threads, samples)
    if isinstance(scene, ShinyScene):
        return ShinyRenderer(scene, camera, threads)
    return Renderer(scene, camera, threads)

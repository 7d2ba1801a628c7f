"""The emulated camera's optics by path tracing with Mitsuba 3: light that bounces, lamps with a size, gloss and glass.

The same lens, shutter and motion blur as ``Renderer``, of which each ray has its own share. No denoiser: the sensor's
noise comes after it."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import Float32Array, FloatArray
from vsx_ros.errors import ConfigError
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.kernels.sim.mesh_scene import MeshScene
from vsx_ros.kernels.sim.raycast_shade import TILE
from vsx_ros.sim.drawn_world import DrawnWorld
from vsx_ros.sim.lit_surfaces import AnyScene, lighting_of, moving_surfaces, still_surfaces
from vsx_ros.sim.mesh_renderer import MeshRenderer
from vsx_ros.sim.mitsuba_pinhole import Pinhole
from vsx_ros.sim.mitsuba_scene import MitsubaScenes
from vsx_ros.sim.mitsuba_variant import is_fast, mitsuba
from vsx_ros.sim.renderer import Picture, Renderer, ray_tables
from vsx_ros.sim.scene import GREY

MOST_RAYS = 1 << 22  # at once, for memory
_STEP = 0.7548776662, 0.5698402910  # of a low-discrepancy sequence inside the pixel


class MitsubaRenderer:
    """Images of a scene: the same methods as ``Renderer``. samples: paths a pixel. seen_by: draws depth and ident. The
    noise of the paths follows from the stamp given to ``enlighten``."""

    def __init__(self, scene: AnyScene, camera: PinholeCamera, seen_by: Renderer | MeshRenderer, samples: int) -> None:
        """Raises ConfigError when Mitsuba is missing or does not work, or cannot draw this light or lens."""
        self.camera, self._scene, self._seen_by, self._samples = camera, scene, seen_by, samples
        if isinstance(scene, DrawnWorld) and scene.at(0).lights.sun > 0.0:
            raise ConfigError("the eye mitsuba draws no patches of sunlight; choose another light of the world")
        self._mi = mitsuba()
        self._scenes = MitsubaScenes(self._mi, still_surfaces(scene))
        self._lit: tuple[Any, Any] = None, None
        self._seed = 0
        self._rx, self._ry = ray_tables(camera)
        self._pinhole = None if is_fast(self._mi) else Pinhole(self._mi, camera, self._rx, self._ry)
        self.enlighten(0)

    @property
    def border_rows(self) -> FloatArray:
        """(B,) image rows at which ``render`` takes poses; the last may lie below the image."""
        return self._seen_by.border_rows

    def sub_frames(self, R: FloatArray, t: FloatArray) -> int:
        """As of the other renderer; at most as many as samples."""
        return min(self._seen_by.sub_frames(R, t), self._samples)

    def enlighten(self, stamp_ns: int) -> None:
        """Draw the next images in the light of this moment, and with its noise."""
        self._seed = stamp_ns // 1000 % 2**31
        self._seen_by.enlighten(stamp_ns)
        self._scene = self._scene.at(stamp_ns) if isinstance(self._scene, DrawnWorld) else self._scene

    def render(
        self, R: FloatArray, t: FloatArray, bayer: bool = False, want_depth: bool = False,
        states: FloatArray | None = None,
    ) -> Picture:  # fmt: skip
        """As ``Renderer.render``. Movers stand where they are at the middle of the image."""
        scene, ambient = self._scene_with(states), lighting_of(self._scene).ambient
        radiance = np.pi * self._colours(scene, R, t, ambient / np.pi)
        colour = _mosaic(radiance) if bayer else radiance @ GREY
        empty = np.zeros((0, 0), np.float32), np.zeros((0, 0), np.int32)
        depth, ident = self._seen_by.render(R, t, bayer, True, states)[1:] if want_depth else empty
        return Picture(np.ascontiguousarray(colour, np.float32), depth, ident)

    def _scene_with(self, states: FloatArray | None) -> Any:
        """Mitsuba's scene of this moment; the same one while nothing moves and the light stays."""
        scene = self._scene
        if isinstance(scene, MeshScene) or scene.movers is None:
            light = scene if isinstance(scene, MeshScene) else scene.lights
            if self._lit[0] is not light:
                self._lit = light, self._scenes.lit(lighting_of(scene))
            return self._lit[1]
        return self._scenes.lit(lighting_of(scene), moving_surfaces(scene, scene.moved(states)))

    def _colours(self, scene: Any, R: FloatArray, t: FloatArray, ambient: float) -> FloatArray:
        """(H, W, 3) radiance, with the ambient one on what is seen."""
        if self._pinhole is not None:
            return self._pinhole.colours(scene, R, t, (self._samples, self._seed, ambient))
        height, width = self.camera.height, self.camera.width
        total, at_once = np.zeros((height, width, 3)), max(1, MOST_RAYS // (height * width))
        for first in range(0, self._samples, at_once):
            some = range(first, min(first + at_once, self._samples))
            rays = [self._rays(R, t, k) for k in some]
            origins, directions = (np.concatenate(parts, axis=1) for parts in zip(*rays))
            colours = self._traced(scene, origins, directions, self._seed + first, ambient)
            total += colours.reshape(3, len(some), height, width).sum(axis=1).transpose(1, 2, 0)
        return total / self._samples

    def _rays(self, R: FloatArray, t: FloatArray, sample: int) -> tuple[Float32Array, Float32Array]:
        """(3, H W) origins and directions of the sample of each pixel, from the pose of its row and moment."""
        height, width, sub_frame = self.camera.height, self.camera.width, sample * len(R) // self._samples
        jx, jy = ((sample * step + 0.5) % 1.0 - 0.5 for step in _STEP)
        x, y = (
            rays[1 : height + 1, 1 : width + 1]
            + jx * (rays[1 : height + 1, 2 : width + 2] - rays[1 : height + 1, 1 : width + 1])
            + jy * (rays[2 : height + 2, 1 : width + 1] - rays[1 : height + 1, 1 : width + 1])
            for rays in (self._rx, self._ry)
        )
        above, share = np.divmod(np.arange(height) / TILE, 1.0)
        b = above.astype(int)
        turns = (R[sub_frame, b] + share[:, None, None] * (R[sub_frame, b + 1] - R[sub_frame, b])).astype(np.float32)
        places = (t[sub_frame, b] + share[:, None] * (t[sub_frame, b + 1] - t[sub_frame, b])).astype(np.float32)
        directions = np.stack([turns[:, i, 0, None] * x + turns[:, i, 1, None] * y + turns[:, i, 2, None]
                               for i in range(3)])  # fmt: skip
        directions /= np.linalg.norm(directions, axis=0)
        return np.repeat(places.T, width, axis=1), np.ascontiguousarray(directions.reshape(3, -1), np.float32)

    def _traced(
        self, scene: Any, origins: Float32Array, directions: Float32Array, seed: int, ambient: float
    ) -> NDArray[np.float32]:
        """(3, N) radiance along the rays (3, N)."""
        mi = self._mi
        sampler = mi.load_dict({"type": "independent"})
        sampler.seed(seed, origins.shape[1])
        rays = mi.RayDifferential3f(mi.Ray3f(mi.Point3f(origins), mi.Vector3f(directions)))
        light, _, reflectance = scene.integrator().sample(scene, sampler, rays)
        light = mi.Color3f(light) + ambient * mi.Color3f(*reflectance[-3:]) if ambient > 0.0 else light
        return np.asarray(light, np.float32).reshape(3, -1)


def _mosaic(radiance: FloatArray) -> FloatArray:
    """(H, W) of the colours (H, W, 3) that the GRBG mosaic lets through."""
    seen = radiance[..., 1].copy()
    seen[0::2, 1::2], seen[1::2, 0::2] = radiance[0::2, 1::2, 0], radiance[1::2, 0::2, 2]
    return seen

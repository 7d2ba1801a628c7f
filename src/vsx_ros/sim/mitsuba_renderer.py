"""The emulated camera's optics by path tracing with Mitsuba 3: light that bounces, lamps with a size, gloss and glass.

The same lens, shutter and motion blur as ``Renderer``, of which each ray has its own share. No denoiser: the sensor's
noise comes after it."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import Float32Array, FloatArray, IntArray
from vsx_ros.errors import ConfigError
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.kernels.sim.mesh_scene import MeshScene
from vsx_ros.kernels.sim.raycast_shade import TILE
from vsx_ros.sim.drawn_world import DrawnWorld
from vsx_ros.sim.lit_surfaces import AnyScene, lighting_of, moving_surfaces, still_surfaces
from vsx_ros.sim.mesh_renderer import MeshRenderer
from vsx_ros.sim.mitsuba_lamps import favour
from vsx_ros.sim.mitsuba_pinhole import Pinhole
from vsx_ros.sim.mitsuba_scene import MitsubaScenes
from vsx_ros.sim.mitsuba_variant import is_fast, mitsuba
from vsx_ros.sim.renderer import Picture, Renderer, ray_tables
from vsx_ros.sim.scene import GREY

MOST_RAYS = 1 << 22  # at once, for memory
_PILOT_STEP = 16  # pixels between the rays that find out which lamps matter
_STEP = 0.7548776662, 0.5698402910  # of a low-discrepancy sequence inside the pixel


class MitsubaRenderer:
    """Images of a scene: the same methods as ``Renderer``. samples: paths a pixel, at least. seen_by: draws depth and
    ident. The noise of the paths follows from the stamp given to ``enlighten``."""

    def __init__(self, scene: AnyScene, camera: PinholeCamera, seen_by: Renderer | MeshRenderer, samples: int) -> None:
        """Raises ConfigError when Mitsuba is missing or does not work, or cannot draw this light or lens."""
        self.camera, self._scene, self._seen_by = camera, scene, seen_by
        if isinstance(scene, DrawnWorld) and scene.at(0).lights.sun > 0.0:
            raise ConfigError("the eye mitsuba draws no patches of sunlight; choose another light of the world")
        self._mi = mitsuba()
        self._sampler = self._mi.load_dict({"type": "multijitter", "sample_count": samples})
        self._samples = int(self._sampler.sample_count())  # perhaps a few more
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
        if isinstance(scene, MeshScene) or isinstance(scene, DrawnWorld) and scene.movers is None:
            light = scene if isinstance(scene, MeshScene) else scene.lights
            if self._lit[0] is not light:
                self._lit = light, self._scenes.lit(lighting_of(scene))
            return self._lit[1]
        return self._scenes.lit(lighting_of(scene), moving_surfaces(scene, states))

    def _colours(self, scene: Any, R: FloatArray, t: FloatArray, ambient: float) -> FloatArray:
        """(H, W, 3) radiance, with the ambient one on what is seen."""
        if self._pinhole is not None:
            return self._pinhole.colours(scene, R, t, (self._samples, self._seed, ambient))
        height, width = self.camera.height, self.camera.width
        few = self._rays(R[:1], t[:1], np.arange(0, height, _PILOT_STEP))
        favour(
            self._mi, scene, lighting_of(self._scene).lamps, *(part[:, :: _PILOT_STEP * self._samples] for part in few)
        )
        colours, at_once = np.zeros((height, width, 3)), max(1, MOST_RAYS // (width * self._samples))
        for first in range(0, height, at_once):
            rows = np.arange(first, min(first + at_once, height))
            paths = self._traced(scene, *self._rays(R, t, rows), self._seed + first, ambient)
            colours[rows] = paths.reshape(3, len(rows), width, self._samples).mean(axis=3).transpose(1, 2, 0)
        return colours

    def _rays(self, R: FloatArray, t: FloatArray, rows: IntArray) -> tuple[Float32Array, Float32Array]:
        """(3, N) origins and directions of all samples of the pixels of some rows, sample by sample of each pixel, from
        the pose of the row and the sample's moment."""
        samples, width = np.arange(self._samples), self.camera.width
        jx, jy = (((samples * step + 0.5) % 1.0 - 0.5).astype(np.float32) for step in _STEP)
        x, y = (
            rays[rows + 1, 1 : width + 1, None]
            + jx * (rays[rows + 1, 2 : width + 2] - rays[rows + 1, 1 : width + 1])[..., None]
            + jy * (rays[rows + 2, 1 : width + 1] - rays[rows + 1, 1 : width + 1])[..., None]
            for rays in (self._rx, self._ry)
        )
        sub_frames, above = samples * len(R) // self._samples, rows // TILE
        share = (rows / TILE - above)[:, None]
        b, s = above[:, None], sub_frames[None]
        turns = (R[s, b] + share[..., None, None] * (R[s, b + 1] - R[s, b])).astype(np.float32)[:, None]
        places = (t[s, b] + share[..., None] * (t[s, b + 1] - t[s, b])).astype(np.float32)[:, None]
        lines = [turns[..., i, 0] * x + turns[..., i, 1] * y + turns[..., i, 2] for i in range(3)]
        directions = np.stack(lines).reshape(3, -1)
        directions /= np.linalg.norm(directions, axis=0)
        origins = np.broadcast_to(places, (*x.shape, 3)).reshape(-1, 3).T
        return np.ascontiguousarray(origins), directions

    def _traced(
        self, scene: Any, origins: Float32Array, directions: Float32Array, seed: int, ambient: float
    ) -> NDArray[np.float32]:
        """(3, N) radiance along the rays (3, N). The samples of a pixel share out lamps and directions among them."""
        mi, sampler = self._mi, self._sampler
        sampler.set_samples_per_wavefront(self._samples)
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

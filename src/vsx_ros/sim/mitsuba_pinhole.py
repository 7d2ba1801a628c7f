"""The lens for the variant of Mitsuba that takes no rays from outside: an ideal pinhole, bent by the lens."""

import math
from typing import Any

import cv2
import numpy as np

from vsx_ros.arrays import Float32Array, FloatArray
from vsx_ros.errors import ConfigError
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.kernels.sim.raycast_shade import TILE

MOST_TIMES = 3.0  # as wide or high as the image that the pinhole's picture may be
_MARGIN_PX = 2


class Pinhole:
    """rx, ry: rays of ``ray_tables``."""

    def __init__(self, mi: Any, camera: PinholeCamera, rx: Float32Array, ry: Float32Array) -> None:
        """Raises ConfigError for a lens that sees too much."""
        inner = slice(1, camera.height + 1), slice(1, camera.width + 1)
        self._mi, self._focal = mi, max(camera.fx, camera.fy)
        x, y = self._focal * rx[inner], self._focal * ry[inner]
        half = [math.ceil(float(np.abs(part).max())) + _MARGIN_PX for part in (x, y)]
        if 2 * half[0] > MOST_TIMES * camera.width or 2 * half[1] > MOST_TIMES * camera.height:
            raise ConfigError("this lens is too wide for Mitsuba without libLLVM; install libllvm19, or choose another")
        self._size = 2 * half[0], 2 * half[1]
        self._x, self._y = x + np.float32(half[0] - 0.5), y + np.float32(half[1] - 0.5)

    def colours(self, scene: Any, R: FloatArray, t: FloatArray, how: tuple[int, int, float]) -> FloatArray:
        """(H, W, 3) radiance from poses (S, B, 3, 3), (S, B, 3), the sub-frames and bands of rows each from their own.
        how: samples, seed, ambient radiance."""
        samples, seed, ambient = how
        total, passes = np.zeros((*self._x.shape, 3)), len(R)
        rests = not (np.ptp(R, axis=(0, 1)).any() or np.ptp(t, axis=(0, 1)).any())
        tall = self._x.shape[0] if rests else TILE
        for s in range(passes):
            for k, first in enumerate(range(0, self._x.shape[0], tall)):
                rows = slice(first, min(first + tall, self._x.shape[0]))
                pose = _middle(R[s], t[s], first // TILE)
                share = (s + 1) * samples // passes - s * samples // passes
                drawn = self._band(scene, rows, pose, (share, seed + 64 * s + k, ambient))
                total[rows] += share * drawn
        return total / samples

    def _band(
        self, scene: Any, rows: slice, pose: tuple[FloatArray, FloatArray], how: tuple[int, int, float]
    ) -> Float32Array:
        """(rows, W, 3) radiance of these rows from T_world_cam."""
        samples, seed, ambient = how
        top = max(math.floor(float(self._y[rows].min())) - 1, 0)
        high = min(math.ceil(float(self._y[rows].max())) + 2, self._size[1]) - top
        sensor = self._sensor(pose, top, high)
        drawn = np.asarray(self._mi.render(scene, sensor=sensor, spp=samples, seed=seed), np.float32)
        seen = drawn[..., :3] + ambient * drawn[..., -3:]
        y = self._y[rows] - np.float32(top)
        return np.asarray(cv2.remap(seen, self._x[rows], y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE))

    def _sensor(self, pose: tuple[FloatArray, FloatArray], top: int, high: int) -> Any:
        """A pinhole with these rows of the picture. Mitsuba's cameras look along z with x to the left and y up."""
        R, t = pose
        T = np.eye(4)
        T[:3] = np.column_stack([-R[:, 0], -R[:, 1], R[:, 2], t])
        width, height = self._size
        film = {
            "type": "hdrfilm", "width": width, "height": height, "rfilter": {"type": "box"},
            "crop_offset_x": 0, "crop_offset_y": top, "crop_width": width, "crop_height": high,
        }  # fmt: skip
        fov = 2.0 * math.degrees(math.atan(0.5 * width / self._focal))
        return self._mi.load_dict({
            "type": "perspective", "to_world": self._mi.ScalarTransform4f(T), "fov": fov, "fov_axis": "x",
            "near_clip": 0.01, "far_clip": 1e4, "film": film, "sampler": {"type": "multijitter"},
        })  # fmt: skip


def _middle(R: FloatArray, t: FloatArray, b: int) -> tuple[FloatArray, FloatArray]:
    """The pose between those at the borders b and b + 1."""
    U, _, Vt = np.linalg.svd(R[b] + R[b + 1])
    return U @ Vt, 0.5 * (t[b] + t[b + 1])

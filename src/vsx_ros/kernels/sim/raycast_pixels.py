"""Pixel lists in scratch memory, filled from the rays of a tile and added to the picture after shading, and the sensor
that turns the picture into bytes (vignetting, gain, photon and read noise, response curve)."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import Float32Array, FloatArray, IntArray
from vsx_ros.kernels import kernel
from vsx_ros.kernels.sim.raycast_cull import Scene
from vsx_ros.kernels.sim.raycast_shade import DXX, DXY, DYX, DYY, ROW, RX, RY, SUM, WEIGHT, Scratch, X, Y


class View(NamedTuple):
    """What is drawn: forms (S, B, Q, 9) of ``plane_forms``; rx, ry: rays, pixel (y, x) at [y + 1, x + 1], padded to
    whole tiles and two more; bayer: each pixel sees one colour of the GRBG mosaic, otherwise all see grey."""

    scene: Scene
    forms: FloatArray
    rx: Float32Array
    ry: Float32Array
    bayer: bool


@kernel
def enter(scratch: Scratch, i: int, view: View, y: int, x: int, ratio: np.float32, weight: np.float32) -> None:
    """Append pixel (y, x) to the shading list at place i."""
    f, g, rx, ry = scratch.f, scratch.g, view.rx, view.ry
    f[RX + i] = rx[y + 1, x + 1]
    f[RY + i] = ry[y + 1, x + 1]
    f[DXX + i] = rx[y + 1, x + 2] - rx[y + 1, x + 1]
    f[DXY + i] = ry[y + 1, x + 2] - ry[y + 1, x + 1]
    f[DYX + i] = rx[y + 2, x + 1] - rx[y + 1, x + 1]
    f[DYY + i] = ry[y + 2, x + 1] - ry[y + 1, x + 1]
    f[ROW + i] = ratio
    f[WEIGHT + i] = weight
    g[Y + i], g[X + i] = np.int32(y), np.int32(x)


@kernel
def tint_index(y: int, x: int, bayer: bool) -> int:
    """Which reflectance a pixel sees: 3 grey, or by the GRBG mosaic (even rows green, red; odd rows blue, green)."""
    if not bayer:
        return 3
    if (y & 1) == (x & 1):
        return 1
    return 0 if (y & 1) == 0 else 2


@kernel
def spread(scratch: Scratch, n: int, tint: Float32Array, bayer: bool, share: np.float32, picture: Float32Array) -> None:
    """Add SUM, tinted and weighted, to the listed pixels of the picture (H, W)."""
    f, g = scratch.f, scratch.g
    for i in range(n):
        y, x = g[Y + i], g[X + i]
        picture[y, x] += share * f[WEIGHT + i] * tint[tint_index(y, x, bayer)] * f[SUM + i]


@kernel
def expose(
    radiance: Float32Array, vignette: Float32Array, gain: np.float32, shot: np.float32, read_variance: np.float32,
    noise: Float32Array, starts: IntArray, response: NDArray[np.uint8], image: NDArray[np.uint8],
) -> None:  # fmt: skip
    """Fill image (H, W) uint8 from radiance (H, W) float32 (1 = full scale at gain 1). noise: (L,) float32 standard
    normal draws; row y reads it from starts[y] on, L >= starts.max() + W. response: (4096,) uint8 output for signals
    0..1. shot, read_variance: noise variance per signal and at rest."""
    height, width = radiance.shape
    last = np.float32(response.shape[0] - 1)
    zero, half = np.float32(0.0), np.float32(0.5)
    signal = np.empty(width, dtype=np.int32)
    for y in range(height):
        start = starts[y]
        for x in range(width):
            light = radiance[y, x] * vignette[y, x] * gain
            noisy = light + np.sqrt(light * shot + read_variance) * noise[start + x]
            signal[x] = np.int32(min(max(noisy * last, zero), last) + half)
        for x in range(width):
            image[y, x] = response[signal[x]]

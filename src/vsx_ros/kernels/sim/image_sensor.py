"""From radiance to bytes: vignetting, gain, photon and read noise, response curve."""

import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import Float32Array, IntArray
from vsx_ros.kernels import kernel


@kernel
def expose(
    radiance: Float32Array, vignette: Float32Array, gain: np.float32, shot: np.float32, read_variance: np.float32,
    noise: Float32Array, starts: IntArray, response: NDArray[np.uint8], image: NDArray[np.uint8],
) -> None:  # fmt: skip
    """Fill image (H, W) uint8 from radiance (H, W) float32 (1 = full scale at gain 1).

    noise: (L,) float32 standard normal draws; row y reads it from starts[y] on, L >= starts.max() + W.
    response: (4096,) uint8 output for signals 0..1. shot, read_variance: noise variance per signal and at rest.
    """
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

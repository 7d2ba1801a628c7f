"""The emulated image sensor: noise, vignetting, response curve and automatic exposure."""

import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import GrayImage
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.kernels.sim.image_sensor import expose
from vsx_ros.sim.settings import CameraSettings

NOISE_DRAWS = 1 << 18
GAIN_MIN, GAIN_MAX = 0.3, 6.0


class Sensor:
    """Turns radiance into 8-bit pictures; remembers the gain its automatic exposure has reached."""

    def __init__(self, camera: PinholeCamera, settings: CameraSettings, rng: np.random.Generator) -> None:
        self._settings = settings
        self._rng = rng
        v, u = np.mgrid[0 : camera.height, 0 : camera.width]
        r2 = ((u - camera.cx) / camera.fx) ** 2 + ((v - camera.cy) / camera.fy) ** 2
        self._vignette = (1.0 / (1.0 + settings.vignetting * r2)).astype(np.float32)
        self._noise = rng.standard_normal(NOISE_DRAWS).astype(np.float32)
        signal = np.linspace(0.0, 1.0, 4096) ** settings.response_exponent
        self._response = np.rint(255.0 * signal).astype(np.uint8)
        self.gain = 1.0
        self._metered = False

    def develop(self, radiance: NDArray[np.float32]) -> GrayImage:
        """(H, W) uint8 of (H, W) radiance. The first picture meets the target at once, later ones approach it."""
        settings = self._settings
        ratio = settings.target_signal / max(float(radiance[4::8, 4::8].mean()), 1e-4)
        ramp = settings.exposure_ramp if self._metered else 1.0
        self.gain = float(np.clip(self.gain * (ratio / self.gain) ** ramp, GAIN_MIN, GAIN_MAX))
        self._metered = True
        height, width = radiance.shape
        image = np.empty((height, width), np.uint8)
        starts = self._rng.integers(0, NOISE_DRAWS - width, height)
        expose(
            radiance, self._vignette, np.float32(self.gain), np.float32(settings.shot_noise),
            np.float32(settings.read_noise**2), self._noise, starts, self._response, image,
        )  # fmt: skip
        return image

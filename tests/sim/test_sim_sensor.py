import numpy as np
import pytest

from vsx_ros.kernels.sim.raycast_pixels import expose
from vsx_ros.sim.camera import KINECT, CameraSettings, Sensor

FLAT = np.full((480, 640), 0.3, np.float32)


def test_expose_is_its_formula() -> None:
    rng = np.random.default_rng(1)
    radiance = rng.uniform(0, 1.2, (20, 30)).astype(np.float32)
    vignette = rng.uniform(0.7, 1, (20, 30)).astype(np.float32)
    noise = rng.standard_normal(200).astype(np.float32)
    starts = rng.integers(0, 170, 20)
    response = np.arange(4096, dtype=np.uint16).astype(np.float64) / 4095 * 255
    response = np.rint(response).astype(np.uint8)
    image = np.empty((20, 30), np.uint8)
    expose(radiance, vignette, np.float32(0.9), np.float32(1e-4), np.float32(1e-5), noise, starts, response, image)
    light = radiance * vignette * 0.9
    drawn = np.stack([noise[s : s + 30] for s in starts])
    noisy = np.clip(light + np.sqrt(light * 1e-4 + 1e-5) * drawn, 0, 1)
    assert np.abs(image.astype(float) - 255 * noisy).max() < 1.0


def test_noise_has_its_strength_and_changes_from_frame_to_frame() -> None:
    settings = CameraSettings(vignetting=0.0)
    sensor = Sensor(KINECT, settings, np.random.default_rng(0))
    a, b = sensor.develop(FLAT).astype(float), sensor.develop(FLAT).astype(float)
    slope = 255 * 0.6 * 0.3 ** (0.6 - 1)
    sigma = np.sqrt(settings.shot_noise * 0.3 + settings.read_noise**2) * slope
    assert a.std() == pytest.approx(np.hypot(sigma, 1 / np.sqrt(12)), rel=0.05)
    assert (a - b).std() == pytest.approx(np.sqrt(2) * a.std(), rel=0.05)
    assert a.mean() == pytest.approx(255 * 0.3**0.6, abs=1.0)


def test_same_seed_same_noise() -> None:
    first, again, other = (Sensor(KINECT, CameraSettings(), np.random.default_rng(k)).develop(FLAT) for k in (0, 0, 1))
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)


def test_exposure_meets_the_first_picture_and_approaches_later_ones() -> None:
    sensor = Sensor(KINECT, CameraSettings(exposure_ramp=0.2), np.random.default_rng(0))
    sensor.develop(FLAT)
    assert sensor.gain == pytest.approx(1.0, rel=1e-3)
    gains = []
    for _ in range(25):
        sensor.develop(0.5 * FLAT)
        gains.append(sensor.gain)
    assert gains[0] == pytest.approx(2.0**0.2, rel=1e-3)
    assert np.all(np.diff(gains) > 0)
    assert gains[-1] == pytest.approx(2.0, rel=0.01)


def test_corners_are_darker_than_the_middle() -> None:
    image = Sensor(KINECT, CameraSettings(), np.random.default_rng(0)).develop(FLAT).astype(float)
    assert 0.80 < image[:20, :20].mean() / image[240:270, 300:330].mean() < 0.95

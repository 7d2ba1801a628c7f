"""How far a ray proves the floor free depends on how fine the camera's pixels are."""

import numpy as np
import pytest

from vsx_ros.config import Config, GroundMapConfig
from vsx_ros.dense.mapped_ground import MappedGround
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.geometry.mount import mount_pose
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3
from vsx_ros.occupancy.virtual_scan import KINECT_NOISE_RAD, N_BEARINGS, bearing_noise_rad, virtual_scans
from vsx_ros.session import SlamSession
from vsx_ros.sim.camera import KINECT
from vsx_ros.slam.slam import SequentialSlam

MOUNT = mount_pose(0.0, 0.0, 0.3, 0.0)
BASELINE_M, AWAY_M, NOISE_PX = 0.3, 4.0, 0.6


def camera(fx: float) -> PinholeCamera:
    return PinholeCamera(640, 480, fx, fx, 319.5, 239.5)


def share_too_far(fx: float, noise_rad: float) -> float:
    """Of rays to points 4 m away, found with the noise of such a camera, the share that calls floor beyond the true
    place free."""
    rng, bearings, too_far = np.random.default_rng(0), np.linspace(-0.4, 0.4, 9), list[bool]()
    poses = [SE3.from_se2(SE2(0.0, y, 0.0)) @ MOUNT for y in (0.0, BASELINE_M)]
    keyframe, point = np.repeat(np.arange(2, dtype=np.int32), 9), np.tile(np.arange(9, dtype=np.int32), 2)
    rays = np.column_stack([np.cos(bearings), np.sin(bearings)])
    sigma_m = NOISE_PX / fx * AWAY_M**2 / (BASELINE_M * np.cos(bearings))
    bins = np.rint(bearings * N_BEARINGS / (2.0 * np.pi)).astype(int) % N_BEARINGS
    for _ in range(200):
        found_m = AWAY_M + sigma_m * rng.normal(size=9)
        points = np.column_stack([found_m[:, None] * rays, np.full(9, 0.02)])
        scans = virtual_scans(poses, points, keyframe, point, GroundMapConfig(), noise_rad)
        too_far += (scans.free[0][bins] > AWAY_M).tolist()
    return float(np.mean(too_far))


@pytest.mark.parametrize("fx", [150.0, 250.0, 525.0])
def test_a_ray_hardly_ever_ends_behind_its_point(fx: float) -> None:
    assert share_too_far(fx, bearing_noise_rad(camera(fx))) < 0.015


def test_a_kinect_is_as_before_and_finer_pixels_prove_no_more() -> None:
    assert bearing_noise_rad(KINECT) == bearing_noise_rad(camera(2000.0)) == KINECT_NOISE_RAD


def test_a_session_tells_its_ground_the_camera(monkeypatch: pytest.MonkeyPatch) -> None:
    told = list[PinholeCamera]()
    monkeypatch.setattr(MappedGround, "look_with", lambda _, camera: told.append(camera))
    SlamSession(MOUNT, Config()).begin(SequentialSlam, camera(250.0), 1)
    assert told == [camera(250.0)]

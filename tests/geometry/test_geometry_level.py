"""Which poses can be those of a base on wheels."""

import math

import numpy as np
import pytest

from vsx_ros.errors import InputError
from vsx_ros.geometry.level import LevelWatch, refuse_tilt
from vsx_ros.geometry.se3 import SE3, so3_exp


def pose(x_m: float, z_m: float = 0.0, pitch_deg: float = 0.0, heading: float = 0.0) -> SE3:
    turned = so3_exp(np.array([0.0, 0.0, heading])) @ so3_exp(np.array([0.0, math.radians(pitch_deg), 0.0]))
    return SE3(turned, np.array([x_m, 0.0, z_m]))


def refusal(poses: list[SE3]) -> str:
    watch = LevelWatch()
    for T in poses:
        watch.see(T)
    return watch.refusal


def test_level_drives_and_ramps_are_those_of_wheels() -> None:
    assert refusal([]) == ""
    assert refusal([pose(0.1 * k, 1.5, heading=0.1 * k) for k in range(100)]) == ""
    ramp = [pose(0.1 * k, 0.1 * k * math.tan(math.radians(8.0)), -8.0) for k in range(200)]
    assert refusal(ramp + ramp[::-1]) == ""


def test_few_wrong_poses_or_a_lifted_base_are_no_reason() -> None:
    drive = [pose(0.1 * k) for k in range(100)]
    assert refusal(drive[:50] + [pose(5.0, 9.0, 60.0)] * 5 + drive[50:]) == ""
    assert "7 of 107 poses" in refusal(drive[:50] + [pose(5.0, 9.0, 60.0)] * 7 + drive[50:])


def test_what_is_carried_or_flies_is_told_with_its_tilt_and_height() -> None:
    assert "100 of 100 poses are none of wheels on a floor (up to 69 deg of tilt, 0.0 m" in refusal(
        [pose(0.1 * k, 0.0, 69.0) for k in range(100)]
    )
    rises = [pose(0.0, 0.01 * k) for k in range(100)]
    assert "69 of 100 poses are none of wheels on a floor (up to 0 deg of tilt, 1.0 m up or down)" in refusal(rises)


@pytest.mark.filterwarnings("error")
def test_poses_beyond_all_numbers_are_looked_at_without_a_warning() -> None:
    assert refusal([pose(x) for x in (1e308, -1e308) * 10]) == ""
    assert "19 of 20 poses" in refusal([pose(0.0, z) for z in (1e308, *[-1e308] * 19)])


@pytest.mark.parametrize("tilt_deg", [-180.0, -20.0, 16.0, 90.0])
def test_a_tilted_pose_is_refused_by_its_tilt(tilt_deg: float) -> None:
    for level_deg in (-14.0, 0.0, 14.0):
        refuse_tilt(pose(1.0, 3.0, level_deg, heading=2.0))
    with pytest.raises(InputError, match=f"tilted by {abs(tilt_deg):.0f} deg, as no base on wheels is; name the topic"):
        refuse_tilt(pose(1.0, 0.0, tilt_deg, heading=2.0))

import math

import numpy as np
import pytest

from vsx_ros.errors import InputError
from vsx_ros.geometry.se2 import SE2
from vsx_ros.sim.body import Body, BodySettings, Bumper

PERFECT = BodySettings(wheel_scale_error=0.0, slip=0.0, gyro_scale_error=0.0, gyro_bias_rad_s=0.0)
WALL_AHEAD = np.array([[1.0, -5.0, 1.0, 5.0]])
RADIUS = 0.18


def body(settings: BodySettings = PERFECT, segments: np.ndarray = WALL_AHEAD, start: SE2 | None = None) -> Body:
    return Body(segments, start or SE2(), RADIUS, settings, np.random.default_rng(3))


def seconds(s: float) -> int:
    return round(s * 1e9)


def test_commands_take_effect_after_latency_and_lag() -> None:
    b = body()
    b.set_wheel_speeds(0.2, 0.2)
    b.advance(PERFECT.latency_ns)
    assert b.T_world_base == SE2()
    b.advance(seconds(1.0))
    # A first-order lag ends up one lag behind.
    assert b.T_world_base.x == pytest.approx(0.2 * (1.0 - PERFECT.lag_s), abs=0.001)
    assert b.path_length_m == pytest.approx(b.T_world_base.x)


def test_encoders_and_gyro_tell_the_same_turn() -> None:
    b = body(segments=WALL_AHEAD + [[50, 0, 50, 0]])
    b.set_wheel_speeds(0.1, 0.2)
    b.advance(seconds(3.0))
    left, right = b.encoders()
    turn = (right - left) * PERFECT.tick_m / PERFECT.wheel_base_m
    assert turn == pytest.approx(b.T_world_base.theta, abs=2 * PERFECT.tick_m / PERFECT.wheel_base_m)
    assert b.gyro_angle_rad == pytest.approx(b.T_world_base.theta, abs=PERFECT.gyro_step_rad)
    assert 1.0 < b.T_world_base.theta < 1.4
    assert isinstance(left, int)


def test_wheel_errors_make_the_encoders_lie_a_little() -> None:
    b = body(BodySettings(slip=0.0), WALL_AHEAD + [[50, 0, 50, 0]])
    b.set_wheel_speeds(0.25, 0.25)
    b.advance(seconds(20.0))
    said = 0.5 * sum(b.encoders()) * PERFECT.tick_m
    error = b.path_length_m / said - 1.0
    assert 1e-5 < abs(error) < 0.005


def test_it_stops_at_a_wall_and_counts_one_collision() -> None:
    b = body()
    b.set_wheel_speeds(0.25, 0.25)
    b.advance(seconds(6.0))
    assert b.T_world_base.x == pytest.approx(1.0 - RADIUS, abs=0.002)
    assert b.collisions == 1
    assert b.bumper == Bumper(centre=True)
    assert b.min_clearance_m == 0.0
    rolled = 0.5 * sum(b.encoders()) * PERFECT.tick_m
    assert rolled > 1.3  # the wheels keep slipping
    b.set_wheel_speeds(-0.1, -0.1)
    b.advance(seconds(1.5))
    assert b.bumper == Bumper()
    assert b.collisions == 1
    b.set_wheel_speeds(0.25, 0.25)
    b.advance(seconds(2.0))
    assert b.collisions == 2


@pytest.mark.parametrize(
    ("heading_deg", "expected"),
    [(0, Bumper(centre=True)), (50, Bumper(right=True)), (-50, Bumper(left=True)), (180, Bumper())],
)
def test_bumper_sector_depends_on_where_the_wall_is(heading_deg: float, expected: Bumper) -> None:
    theta = math.radians(heading_deg)
    speed = 0.2 if abs(heading_deg) < 90 else -0.2
    b = body(start=SE2(0.7, 0.0, theta))
    b.set_wheel_speeds(speed, speed)
    b.advance(seconds(3.0))
    assert b.collisions == 1
    assert b.bumper == expected


def test_turning_in_place_at_a_wall_is_no_new_collision() -> None:
    b = body(start=SE2(1.0 - RADIUS - 0.001, 0.0, 1.0))
    b.set_wheel_speeds(-0.05, 0.05)
    b.advance(seconds(3.0))
    assert b.collisions == 0
    assert b.T_world_base.theta > 1.5
    assert b.T_world_base.x == pytest.approx(1.0 - RADIUS - 0.001, abs=1e-9)


def test_history_interpolates_and_refuses_what_it_does_not_know() -> None:
    b = body()
    b.set_wheel_speeds(0.1, 0.1)
    b.advance(seconds(1.0))
    half = b.poses_at(np.array([seconds(0.5)]))
    assert 0.0 < half[0, 0] < b.T_world_base.x
    between = b.poses_at(np.array([seconds(0.8), seconds(0.8) + 2_500_000, seconds(0.805)]))
    assert between[1, 0] == pytest.approx(0.5 * (between[0, 0] + between[2, 0]), abs=1e-12)
    with pytest.raises(InputError, match="advance"):
        b.poses_at(np.array([seconds(1.1)]))
    b.advance(seconds(4.0))
    with pytest.raises(InputError, match="remembers"):
        b.poses_at(np.array([seconds(1.0)]))


def test_speeds_that_are_no_numbers_are_refused() -> None:
    with pytest.raises(InputError, match="finite"):
        body().set_wheel_speeds(math.nan, 0.0)

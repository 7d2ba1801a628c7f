"""By how much a gyro and the wheels differ although both are sound: learned while they agree."""

import math

WAY_RAD_M, TURN_SHARE = 0.25, 0.1
"""Deviations before anything is learned: wheels that differ by 6 % bend a way of a metre by 0.25 rad; wheels, wheel
base and gyro make a turn of another size."""
NOISE_RAD2_S, CHANGE_PER_M, CHANGE_PER_RAD = 2e-4, 8e-4, 2e-4
"""How fast: a second of driving halves the deviations, after another floor they follow within a few metres."""


class TurnMismatch:
    """A Kalman filter of two constants: radians per metre of way and per radian of turn."""

    def __init__(self) -> None:
        self._per_m = self._per_rad = 0.0
        self._P = (WAY_RAD_M**2, 0.0, TURN_SHARE**2)

    def expected(self, way_m: float, turn_rad: float) -> tuple[float, float]:
        """(gyro minus wheels [rad], its deviation) over a way and a turn of the wheels."""
        a, b, c = self._P
        variance = a * way_m**2 + 2.0 * b * way_m * turn_rad + c * turn_rad**2
        return self._per_m * way_m + self._per_rad * turn_rad, math.sqrt(max(0.0, variance))

    def learn(self, way_m: float, turn_rad: float, difference_rad: float, dt_s: float) -> None:
        """Take in what gyro and wheels differed by."""
        a, b, c = self._P
        u, w = a * way_m + b * turn_rad, b * way_m + c * turn_rad
        variance = u * way_m + w * turn_rad + NOISE_RAD2_S * dt_s
        error = difference_rad - self._per_m * way_m - self._per_rad * turn_rad
        self._per_m += u / variance * error
        self._per_rad += w / variance * error
        self._P = (
            min(WAY_RAD_M**2, a - u * u / variance + CHANGE_PER_M * abs(way_m)),
            b - u * w / variance,
            min(TURN_SHARE**2, c - w * w / variance + CHANGE_PER_RAD * abs(turn_rad)),
        )

"""Lens models by their ROS names: coefficients, and largest valid angle off the axis (``kernels.lens``)."""

import math
from functools import lru_cache

import numpy as np
from numpy.polynomial import polynomial

from vsx_ros.arrays import FloatArray

PLUMB_BOB, RATIONAL, EQUIDISTANT = "plumb_bob", "rational_polynomial", "equidistant"
COEFFICIENTS = {PLUMB_BOB: 5, RATIONAL: 8, EQUIDISTANT: 4}
"""plumb_bob: k1 k2 p1 p2 k3. rational_polynomial: the same and k4 k5 k6. equidistant: k1 k2 k3 k4."""

# Share of the angle at which the picture would fold back. Nearer to it one pixel covers some degrees.
FOLD_SHARE = 0.95
# The map is made on the plane z = 1, where a pixel at 75 degrees off the axis is 15 times as long as one in the middle.
MAX_OFF_AXIS_RAD = math.radians(75.0)


@lru_cache(maxsize=32)
def fold_angle(model: str, distortion: tuple[float, ...]) -> float:
    """Angle off the axis [rad] up to which the radius in the picture grows, at most 90 degrees."""
    if model == EQUIDISTANT:
        slope = np.array([1.0, *distortion]) * [1.0, 3.0, 5.0, 7.0, 9.0]  # in powers of the squared angle
        return min(math.sqrt(_first_root(slope)), 0.5 * math.pi)
    k1, k2, _, _, k3, k4, k5, k6 = (*distortion, 0.0, 0.0, 0.0)[:8]
    above, below = np.array([1.0, k1, k2, k3]), np.array([1.0, k4, k5, k6])
    twice_s = [0.0, 2.0]  # s: squared radius on the plane, the polynomials' variable
    grows = polynomial.polyadd(above, polynomial.polymul(twice_s, polynomial.polyder(above)))
    shrinks = polynomial.polymul(twice_s, polynomial.polymul(above, polynomial.polyder(below)))
    slope = polynomial.polysub(polynomial.polymul(grows, below), shrinks)
    return math.atan(math.sqrt(min(_first_root(slope), _first_root(below))))


def _first_root(coefficients: FloatArray) -> float:
    """Smallest positive root of a polynomial that begins with 1, lowest power first; infinite without any."""
    inverse = np.roots(coefficients)  # read with the highest power first: these are 1 / roots
    real = inverse.real[(np.abs(inverse.imag) < 1e-9) & (inverse.real > 1e-9)]
    return float(1.0 / real.max()) if len(real) else math.inf


def usable_angle(model: str, distortion: tuple[float, ...]) -> float:
    """Angle off the axis [rad] up to which pixels are used."""
    return min(FOLD_SHARE * fold_angle(model, distortion), MAX_OFF_AXIS_RAD)


def radius(model: str, distortion: tuple[float, ...], angle: FloatArray) -> FloatArray:
    """Distance from the centre [focal lengths] at angles off the axis (N,) [rad], below 90 degrees, without p1, p2."""
    if model == EQUIDISTANT:
        return np.asarray(angle * polynomial.polyval(angle**2, [1.0, *distortion]))
    k1, k2, _, _, k3, k4, k5, k6 = (*distortion, 0.0, 0.0, 0.0)[:8]
    r = np.tan(angle)
    return np.asarray(r * polynomial.polyval(r**2, [1.0, k1, k2, k3]) / polynomial.polyval(r**2, [1.0, k4, k5, k6]))

"""The noise that neighbouring map points share, estimated from their scatter about the planes."""

import numpy as np

from vsx_ros.arrays import FloatArray
from vsx_ros.config.maps import PlanesConfig
from vsx_ros.dense.plane_merging import Found
from vsx_ros.kernels.dense.plane_choice import beside
from vsx_ros.kernels.dense.plane_fits import in_plane_axes
from vsx_ros.kernels.dense.planes import ObservedPoints, residuals

_STEP, _STEPS = 1.25, 6  # the estimate is one of a few values, so that it does not change with every point
_LOOK_M = 0.08  # in front and behind; points farther off belong to something else
_LEAST_POINTS = 60  # on planes; with fewer the noise is not estimated
_SHARES = np.array([0.5, 0.7, 0.85, 0.95])  # possible shares of a plane's own points among those near it


def common_sigma(found: list[Found], points: ObservedPoints, before: float, config: PlanesConfig, unit: float) -> float:
    """Standard deviation [m] that, with the points' own noise, explains best how points scatter about their planes.

    Near a plane a share of the points is its own, normally distributed; the others are uniform. Returns the noise of
    the likeliest pair of share and noise for all planes together. Never less than the configuration's; ``before`` if
    the planes have too few points."""
    if sum(len(plane.rows) for plane in found) < _LEAST_POINTS:
        return before
    choices = config.floor_sigma_m * _STEP ** np.arange(_STEPS)
    limit = _LOOK_M * unit
    off, variance = (np.concatenate(parts) for parts in zip(*(_about(plane, points, limit) for plane in found)))
    likely = [_log_likelihood(off, variance, sigma * unit, limit) for sigma in choices.tolist()]
    return float(choices[int(np.argmax(likely))])


def _about(plane: Found, points: ObservedPoints, limit: float) -> tuple[FloatArray, FloatArray]:
    """Distances to a plane of the points in front of it and behind, and their own variances along its normal."""
    axes = in_plane_axes(plane.fit.normal)
    own = points.world[plane.rows] @ axes.T
    rows = beside(points.world, axes, own.min(axis=0), own.max(axis=0))
    off, variance = residuals(points, rows, plane.fit.plane)
    near = np.abs(off) < limit
    return off[near], variance[near]


def _log_likelihood(off: FloatArray, variance: FloatArray, sigma: float, limit: float) -> float:
    total = variance + sigma * sigma
    own = np.exp(-0.5 * off * off / total) / np.sqrt(2.0 * np.pi * total)
    other = 0.5 / limit
    return float(max(np.log(share * own + (1.0 - share) * other).sum() for share in _SHARES))

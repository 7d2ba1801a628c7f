"""Statistics over many runs: intervals and tests for values that were measured on the same worlds.

All functions assume independent values; for several runs in one world, give their mean. An interval is None if there
is no run."""

import math
from collections.abc import Hashable, Sequence
from typing import NamedTuple

import numpy as np
from scipy.special import stdtrit

from vsx_ros.arrays import FloatArray

_RESAMPLES = 4000  # of the bootstrap
_FEW = 20  # values; the bootstrap of fewer is too narrow
_Z95 = 1.959963984540054  # two-sided 95 % of the normal distribution


class Interval(NamedTuple):
    """A value with its 95 % confidence interval. A bound is None if it is unknown or not finite."""

    value: float
    low: float | None
    high: float | None


def group_means(groups: Sequence[Hashable], values: Sequence[float]) -> list[float]:
    """The mean of each group's values, in the order in which the groups first appear."""
    members: dict[Hashable, list[float]] = {}
    for group, value in zip(groups, values, strict=True):
        members.setdefault(group, []).append(value)
    return [sum(of_group) / len(of_group) for of_group in members.values()]


def mean_interval(values: Sequence[float]) -> Interval | None:
    """The mean, and below 20 values Student's t interval, which their bootstrap would not reach; else the bootstrap
    percentiles (Efron 1979)."""
    if not 1 < len(values) < _FEW:
        return _bootstrap(np.asarray(values, float)[:, None])
    mean, half = np.mean(values), stdtrit(len(values) - 1, 0.975) * np.std(values, ddof=1) / math.sqrt(len(values))
    return Interval(float(mean), float(mean - half), float(mean + half))


def ratio_interval(above: Sequence[float], below: Sequence[float]) -> Interval | None:
    """The ratio of the means of paired values; pairs are drawn together. Also None if all of ``below`` are zero. A draw
    whose ``below`` are all zero counts as infinite."""
    return _bootstrap(np.column_stack([above, below]))


def _bootstrap(rows: FloatArray) -> Interval | None:
    if not len(rows):
        return None
    drawn = np.random.default_rng(0).integers(0, len(rows), (_RESAMPLES, len(rows)))
    means = np.vstack([rows.mean(axis=0), rows[drawn].mean(axis=1)])
    with np.errstate(divide="ignore", invalid="ignore"):
        values = means[:, 0] if means.shape[1] == 1 else means[:, 0] / means[:, 1]
    if not np.isfinite(values[0]):
        return None
    known = values[~np.isnan(values)]
    ends = np.percentile(known, 2.5, method="lower"), np.percentile(known, 97.5, method="higher")
    low, high = (float(end) if len(rows) > 1 and np.isfinite(end) else None for end in ends)
    return Interval(float(values[0]), low, high)


def share_interval(hits: float, count: int) -> Interval | None:
    """A share of runs and its interval (Wilson 1927); rather wide if hits are a sum of shares between 0 and 1."""
    if count <= 0:
        return None
    p, z2 = hits / count, _Z95**2
    centre = (p + z2 / (2 * count)) / (1 + z2 / count)
    half = _Z95 * math.sqrt(p * (1 - p) / count + z2 / (4 * count**2)) / (1 + z2 / count)
    return Interval(p, max(0.0, centre - half), min(1.0, centre + half))


def sign_test(above: Sequence[float], below: Sequence[float]) -> float:
    """Two-sided probability that chance alone makes the pairs' differences this one-sided (exact sign test; ties are
    left out). For pairs of 0 and 1 it is McNemar's exact test."""
    signs = np.sign(np.asarray(above, float) - np.asarray(below, float))
    n, k = int(np.count_nonzero(signs)), int(np.count_nonzero(signs > 0))
    tail = sum(math.comb(n, i) for i in range(min(k, n - k) + 1)) / 2.0**n
    return min(1.0, 2.0 * tail)

"""Reeds-Shepp words: the shortest curves of bounded curvature for a vehicle that may reverse.

J. A. Reeds, L. A. Shepp, "Optimal paths for a car that goes both forwards and backwards", Pacific J. Math. 145 (1990);
equation numbers are theirs. Lengths are in turning radii; a segment's sign is its driving direction; its turn is +1 for
left, -1 for right, 0 for straight."""

import math
from typing import NamedTuple

import numpy as np

from vsx_ros.arrays import FloatArray, IntArray
from vsx_ros.kernels import kernel

MAX_WORDS = 48  # all words of Reeds and Shepp
SEGMENTS = 5  # of the longest word
_HALF_PI = 0.5 * math.pi
_ZERO, _NEARLY = 1e-10, 1e-8  # rad: rounding of a sum, and of a root
LONGER = 1e300  # than any word


class Words(NamedTuple):
    """One word a row: turns (N, SEGMENTS) +1 left, -1 right, 0 straight; lengths (N, SEGMENTS), negative in reverse."""

    turns: IntArray
    lengths: FloatArray


@kernel
def room_for(count: int) -> Words:
    """``count`` words of length 0."""
    return Words(np.zeros((count, SEGMENTS), np.int64), np.zeros((count, SEGMENTS)))


@kernel
def _wrap(a: float) -> float:
    return a - 2.0 * math.pi * math.floor((a + math.pi) / (2.0 * math.pi))


@kernel
def _first_arc(xi: float, eta: float, sine: float, cosine: float, same: bool) -> float:
    """First arc of a word of four arcs, from sine and cosine of the second arc's angle: (8.7), or (8.8) if the third
    arc turns the ``same`` way."""
    sine_off, cosine_off = (0.0, 1.0) if same else (2.0 * sine * cosine, 2.0 * cosine * cosine - 1.0)
    a, b = sine - sine_off, cosine - cosine_off - 1.0
    side = -1.0 if 2.0 * cosine_off - 4.0 * cosine + 3.0 < 0.0 else 1.0
    ahead = side * (eta * a - xi * b)
    return math.atan2(ahead, side * (xi * a + eta * b)) if ahead >= -_NEARLY else -1.0


@kernel
def _store(
    words: Words, n: int, best: float, reverse: bool, flip: bool, mirror: bool, turns: tuple[int, ...],
    lengths: tuple[float, ...],
) -> tuple[int, float]:  # fmt: skip
    """Append a word after undoing time flip, reflection and reversal of the order. If best is finite, replace the only
    word when the new one is shorter. Returns the number of words and the best length."""
    m = len(turns)
    total = 0.0
    for i in range(m):
        total += abs(lengths[i])
    if not total < best:
        return n, best
    if best < np.inf:
        n, best = 0, total
    words.turns[n], words.lengths[n] = 0, 0.0
    for i in range(m):
        j = m - 1 - i if reverse else i
        words.turns[n, i] = -turns[j] if mirror else turns[j]
        words.lengths[n, i] = -lengths[j] if flip else lengths[j]
    return n + 1, best


@kernel
def _words(x: float, y: float, theta: float, best: float, words: Words) -> int:
    """Words from the origin to (x, y, theta): all of them if best is infinite, else the shortest below best.

    Words that are impossible, or not shorter than the best so far, are rejected before any angle is computed: the first
    arc must not be negative, and all arcs together turn by ``least`` or more."""
    n = 0
    theta = _wrap(theta)
    sine, cosine, least = math.sin(theta), math.cos(theta), abs(theta)
    for variant in range(8):
        flip = variant & 1 == 1
        mirror = variant & 2 == 2
        backwards = variant & 4 == 4
        px, py, pt = x, y, theta
        if backwards:
            px = x * cosine + y * sine
            py = x * sine - y * cosine
        if flip:
            px, pt = -px, -pt
        if mirror:
            py, pt = -py, -pt
        s, c = -sine if flip != mirror else sine, cosine
        xi_l, eta_l = px - s, py - 1.0 + c
        xi_r, eta_r = px + s, py - 1.0 - c
        rho_l, rho_r = math.sqrt(xi_l * xi_l + eta_l * eta_l), math.sqrt(xi_r * xi_r + eta_r * eta_r)
        if not backwards:
            # (8.1): L+ S+ L+
            if eta_l >= -_NEARLY and rho_l + least < best:
                t = math.atan2(eta_l, xi_l)
                v = _wrap(pt - t)
                if t >= -_ZERO and v >= -_ZERO:
                    n, best = _store(words, n, best, False, flip, mirror, (1, 0, 1), (t, rho_l, v))
            # (8.2): L+ S+ R+
            u = math.sqrt(max(rho_r * rho_r - 4.0, 0.0))
            ahead = u * eta_r + 2.0 * xi_r
            if rho_r >= 2.0 and ahead >= -_NEARLY and u + least < best:
                t = math.atan2(ahead, u * xi_r - 2.0 * eta_r)
                v = _wrap(t - pt)
                if t >= -_ZERO and v >= -_ZERO:
                    n, best = _store(words, n, best, False, flip, mirror, (1, 0, -1), (t, u, v))
        # (8.3), (8.4): L+ R- L
        if rho_l <= 4.0 and least < best:
            half = 0.25 * rho_l
            other = math.sqrt(1.0 - half * half)
            ahead = half * xi_l - other * eta_l
            if ahead >= -_NEARLY:
                u = -2.0 * math.asin(half)
                t = math.atan2(ahead, -other * xi_l - half * eta_l)
                v = _wrap(pt - t + u)
                if t >= -_ZERO:
                    n, best = _store(words, n, best, backwards, flip, mirror, (1, -1, 1), (t, u, v))
        # (8.9): L+ R-(pi/2) S- L-
        least_arcs = max(least, _HALF_PI)
        r = math.sqrt(max(rho_l * rho_l - 4.0, 0.0))
        u, ahead = 2.0 - r, r * xi_l - 2.0 * eta_l
        if rho_l >= 2.0 and u <= _ZERO and ahead >= -_NEARLY and least_arcs - u < best:
            t = math.atan2(ahead, -2.0 * xi_l - r * eta_l)
            v = _wrap(pt - _HALF_PI - t)
            if t >= -_ZERO and v <= _ZERO:
                word = (1, -1, 0, 1), (t, -_HALF_PI, u, v)
                n, best = _store(words, n, best, backwards, flip, mirror, word[0], word[1])
        # (8.10): L+ R-(pi/2) S- R-
        u = 2.0 - rho_r
        if u <= _ZERO and xi_r >= -_NEARLY and least_arcs - u < best:
            t = math.atan2(xi_r, -eta_r)
            v = _wrap(t + _HALF_PI - pt)
            if t >= -_ZERO and v <= _ZERO:
                word = (1, -1, 0, -1), (t, -_HALF_PI, u, v)
                n, best = _store(words, n, best, backwards, flip, mirror, word[0], word[1])
        if backwards:
            continue
        # (8.7): L+ R+ L- R-
        rho = 0.25 * (2.0 + rho_r)
        if rho <= 1.0 and least < best:
            t = _first_arc(xi_r, eta_r, math.sqrt(1.0 - rho * rho), rho, False)
            if t >= -_ZERO:
                u = math.acos(rho)
                v = _wrap(t - 2.0 * u - pt)
                if v <= _ZERO:
                    n, best = _store(words, n, best, False, flip, mirror, (1, -1, 1, -1), (t, u, -u, v))
        # (8.8): L+ R- L- R+
        rho = (20.0 - rho_r * rho_r) / 16.0
        if 0.0 <= rho <= 1.0 and least < best:
            t = _first_arc(xi_r, eta_r, -math.sqrt(1.0 - rho * rho), rho, True)
            if t >= -_ZERO:
                u = -math.acos(rho)
                v = _wrap(t - pt)
                if v >= -_ZERO:
                    n, best = _store(words, n, best, False, flip, mirror, (1, -1, 1, -1), (t, u, u, v))
        # (8.11): L+ R-(pi/2) S- L-(pi/2) R+
        u = 4.0 - math.sqrt(max(rho_r * rho_r - 4.0, 0.0))
        ahead = (4.0 - u) * xi_r - 2.0 * eta_r
        if rho_r >= 2.0 and u <= _ZERO and ahead >= -_NEARLY and max(least, math.pi) - u < best:
            t = math.atan2(ahead, -2.0 * xi_r + (u - 4.0) * eta_r)
            v = _wrap(t - pt)
            if t >= -_ZERO and v >= -_ZERO:
                longest = (1, -1, 0, 1, -1), (t, -_HALF_PI, u, -_HALF_PI, v)
                n, best = _store(words, n, best, False, flip, mirror, longest[0], longest[1])
    return n


@kernel
def reeds_shepp_words(x: float, y: float, theta: float) -> Words:
    """All words from the origin to (x, y, theta), x and y in turning radii."""
    words = room_for(MAX_WORDS)
    n = _words(x, y, theta, np.inf, words)
    return Words(words.turns[:n], words.lengths[:n])


@kernel
def reeds_shepp_shortest(x: float, y: float, theta: float, word: Words, below: float = LONGER) -> float:
    """Length in turning radii of the shortest word, which becomes the first row of ``word``.

    Infinite where none is shorter than ``below``; a smaller ``below`` is faster."""
    if _words(x, y, theta, min(below, LONGER), word) == 0:
        return np.inf
    total = 0.0
    for j in range(SEGMENTS):
        total += abs(word.lengths[0, j])
    return total


@kernel
def shortest_word(a: FloatArray, b: FloatArray, phi: float, word: Words, below: float = LONGER) -> float:
    """Length [m] at curvature phi of the shortest word from pose a (3,) to b (3,), as ``reeds_shepp_shortest`` gives
    it; infinite where none is shorter than ``below`` [m]."""
    dx, dy = b[0] - a[0], b[1] - a[1]
    c, s = math.cos(a[2]), math.sin(a[2])
    return reeds_shepp_shortest(phi * (c * dx + s * dy), phi * (c * dy - s * dx), b[2] - a[2], word, below * phi) / phi


@kernel
def advance(x: float, y: float, theta: float, turn: float, length: float, phi: float) -> tuple[float, float, float]:
    """The pose after one segment of signed length [m] at curvature turn * phi (turn may be any real ratio)."""
    kappa = turn * phi
    if abs(kappa) < 1e-12:
        return x + length * math.cos(theta), y + length * math.sin(theta), theta
    end = theta + kappa * length
    return (x + (math.sin(end) - math.sin(theta)) / kappa, y - (math.cos(end) - math.cos(theta)) / kappa, end)

"""Reeds-Shepp words: the shortest curves of bounded curvature for a vehicle that may reverse.

J. A. Reeds, L. A. Shepp, "Optimal paths for a car that goes both forwards and backwards", Pacific J. Math. 145 (1990);
equation numbers are theirs. Lengths are in turning radii; a segment's sign is its driving direction; its turn is +1 for
left, -1 for right, 0 for straight.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from vsx_ros.kernels import kernel

MAX_WORDS = 48
SEGMENTS = 5
TABLE_PLACES, TABLE_STEP, TABLE_HEADINGS = 33, 0.2, 32
_HALF_PI = 0.5 * math.pi
_ZERO = 1e-10


@kernel
def _wrap(a: float) -> float:
    return a - 2.0 * math.pi * math.floor((a + math.pi) / (2.0 * math.pi))


@kernel
def _tau_omega(u: float, v: float, xi: float, eta: float, phi: float) -> tuple[float, float]:
    delta = _wrap(u - v)
    a = math.sin(u) - math.sin(delta)
    b = math.cos(u) - math.cos(delta) - 1.0
    t1 = math.atan2(eta * a - xi * b, xi * a + eta * b)
    t2 = 2.0 * (math.cos(delta) - math.cos(v) - math.cos(u)) + 3.0
    tau = _wrap(t1 + math.pi) if t2 < 0.0 else _wrap(t1)
    return tau, _wrap(tau - u + v - phi)


@kernel
def _store(
    turns: Any, lengths: Any, n: int, reverse: bool, flip: bool, mirror: bool, word_turns: Any, word_lengths: Any
) -> int:
    """Append a word, undoing time flip, reflection and reversal of the order."""
    m = word_turns.shape[0]
    for i in range(SEGMENTS):
        turns[n, i] = 0
        lengths[n, i] = 0.0
    for i in range(m):
        j = m - 1 - i if reverse else i
        turns[n, i] = -word_turns[j] if mirror else word_turns[j]
        lengths[n, i] = -word_lengths[j] if flip else word_lengths[j]
    return n + 1


@kernel
def reeds_shepp_words(x: float, y: float, theta: float, turns: Any, lengths: Any) -> int:
    """All words from the origin to (x, y, theta), x and y in turning radii.

    turns (MAX_WORDS, 5) int64 and lengths (MAX_WORDS, 5) float64 are filled; returns the number of words.
    """
    n = 0
    wt = np.zeros(5, np.int64)
    wl = np.zeros(5)
    theta = _wrap(theta)
    for variant in range(8):
        flip = variant & 1 == 1
        mirror = variant & 2 == 2
        backwards = variant & 4 == 4
        px, py, pt = x, y, theta
        if backwards:
            px = x * math.cos(theta) + y * math.sin(theta)
            py = x * math.sin(theta) - y * math.cos(theta)
        if flip:
            px, pt = -px, -pt
        if mirror:
            py, pt = -py, -pt
        s, c = math.sin(pt), math.cos(pt)
        xi_l, eta_l = px - s, py - 1.0 + c
        xi_r, eta_r = px + s, py - 1.0 - c
        rho_l, angle_l = math.hypot(xi_l, eta_l), math.atan2(eta_l, xi_l)
        rho_r = math.hypot(xi_r, eta_r)
        # (8.3), (8.4): L+ R- L
        if rho_l <= 4.0:
            u = -2.0 * math.asin(0.25 * rho_l)
            t = _wrap(angle_l + 0.5 * u + math.pi)
            v = _wrap(pt - t + u)
            if t >= -_ZERO and u <= _ZERO:
                wt[0], wt[1], wt[2] = 1, -1, 1
                wl[0], wl[1], wl[2] = t, u, v
                n = _store(turns, lengths, n, backwards, flip, mirror, wt[:3], wl[:3])
        # (8.9): L+ R-(pi/2) S- L-
        if rho_l >= 2.0:
            r = math.sqrt(rho_l * rho_l - 4.0)
            u = 2.0 - r
            t = _wrap(angle_l + math.atan2(r, -2.0))
            v = _wrap(pt - _HALF_PI - t)
            if t >= -_ZERO and u <= _ZERO and v <= _ZERO:
                wt[0], wt[1], wt[2], wt[3] = 1, -1, 0, 1
                wl[0], wl[1], wl[2], wl[3] = t, -_HALF_PI, u, v
                n = _store(turns, lengths, n, backwards, flip, mirror, wt[:4], wl[:4])
        # (8.10): L+ R-(pi/2) S- R-
        if rho_r >= 2.0:
            t = math.atan2(xi_r, -eta_r)
            u = 2.0 - rho_r
            v = _wrap(t + _HALF_PI - pt)
            if t >= -_ZERO and u <= _ZERO and v <= _ZERO:
                wt[0], wt[1], wt[2], wt[3] = 1, -1, 0, -1
                wl[0], wl[1], wl[2], wl[3] = t, -_HALF_PI, u, v
                n = _store(turns, lengths, n, backwards, flip, mirror, wt[:4], wl[:4])
        if backwards:
            continue
        # (8.1): L+ S+ L+
        v = _wrap(pt - angle_l)
        if angle_l >= -_ZERO and v >= -_ZERO:
            wt[0], wt[1], wt[2] = 1, 0, 1
            wl[0], wl[1], wl[2] = angle_l, rho_l, v
            n = _store(turns, lengths, n, False, flip, mirror, wt[:3], wl[:3])
        # (8.2): L+ S+ R+
        if rho_r >= 2.0:
            u = math.sqrt(rho_r * rho_r - 4.0)
            t = _wrap(math.atan2(eta_r, xi_r) + math.atan2(2.0, u))
            v = _wrap(t - pt)
            if t >= -_ZERO and v >= -_ZERO:
                wt[0], wt[1], wt[2] = 1, 0, -1
                wl[0], wl[1], wl[2] = t, u, v
                n = _store(turns, lengths, n, False, flip, mirror, wt[:3], wl[:3])
        # (8.7): L+ R+ L- R-
        rho = 0.25 * (2.0 + rho_r)
        if rho <= 1.0:
            u = math.acos(rho)
            t, v = _tau_omega(u, -u, xi_r, eta_r, pt)
            if t >= -_ZERO and v <= _ZERO:
                wt[0], wt[1], wt[2], wt[3] = 1, -1, 1, -1
                wl[0], wl[1], wl[2], wl[3] = t, u, -u, v
                n = _store(turns, lengths, n, False, flip, mirror, wt[:4], wl[:4])
        # (8.8): L+ R- L- R+
        rho = (20.0 - xi_r * xi_r - eta_r * eta_r) / 16.0
        if 0.0 <= rho <= 1.0:
            u = -math.acos(rho)
            t, v = _tau_omega(u, u, xi_r, eta_r, pt)
            if t >= -_ZERO and v >= -_ZERO:
                wt[0], wt[1], wt[2], wt[3] = 1, -1, 1, -1
                wl[0], wl[1], wl[2], wl[3] = t, u, u, v
                n = _store(turns, lengths, n, False, flip, mirror, wt[:4], wl[:4])
        # (8.11): L+ R-(pi/2) S- L-(pi/2) R+
        if rho_r >= 2.0:
            u = 4.0 - math.sqrt(rho_r * rho_r - 4.0)
            if u <= _ZERO:
                t = _wrap(math.atan2((4.0 - u) * xi_r - 2.0 * eta_r, -2.0 * xi_r + (u - 4.0) * eta_r))
                v = _wrap(t - pt)
                if t >= -_ZERO and v >= -_ZERO:
                    wt[0], wt[1], wt[2], wt[3], wt[4] = 1, -1, 0, 1, -1
                    wl[0], wl[1], wl[2], wl[3], wl[4] = t, -_HALF_PI, u, -_HALF_PI, v
                    n = _store(turns, lengths, n, False, flip, mirror, wt, wl)
    return n


@kernel
def reeds_shepp_shortest(
    x: float, y: float, theta: float, turns: Any, lengths: Any, word_turns: Any, word_lengths: Any
) -> float:
    """Length of the shortest word in turning radii; its segments go to word_turns (5,) and word_lengths (5,).

    turns and lengths are work space, as for ``reeds_shepp_words``.
    """
    n = reeds_shepp_words(x, y, theta, turns, lengths)
    best, winner = np.inf, -1
    for i in range(n):
        total = 0.0
        for j in range(SEGMENTS):
            total += abs(lengths[i, j])
        if total < best:
            best, winner = total, i
    if winner >= 0:
        for j in range(SEGMENTS):
            word_turns[j] = turns[winner, j]
            word_lengths[j] = lengths[winner, j]
    return best


@kernel
def reeds_shepp_lengths(starts: Any, goals: Any, phi: float) -> Any:
    """(N,) shortest lengths [m] between the poses starts (N, 3) and goals (N, 3) at curvature phi [rad/m]."""
    n = starts.shape[0]
    out = np.empty(n)
    turns = np.zeros((MAX_WORDS, SEGMENTS), np.int64)
    lengths = np.zeros((MAX_WORDS, SEGMENTS))
    wt = np.zeros(SEGMENTS, np.int64)
    wl = np.zeros(SEGMENTS)
    for i in range(n):
        dx, dy = goals[i, 0] - starts[i, 0], goals[i, 1] - starts[i, 1]
        c, s = math.cos(starts[i, 2]), math.sin(starts[i, 2])
        out[i] = (
            reeds_shepp_shortest(
                phi * (c * dx + s * dy), phi * (c * dy - s * dx), goals[i, 2] - starts[i, 2], turns, lengths, wt, wl
            )
            / phi
        )
    return out


@kernel
def reeds_shepp_table() -> Any:
    """(TABLE_PLACES, TABLE_PLACES, TABLE_HEADINGS + 1) float32: shortest lengths in radii from the origin.

    x and y in steps of TABLE_STEP radii from 0 on, headings around the circle (the last as the first): a quadrant, the
    others are its mirror images.
    """
    out = np.empty((TABLE_PLACES, TABLE_PLACES, TABLE_HEADINGS + 1), np.float32)
    turns = np.zeros((MAX_WORDS, SEGMENTS), np.int64)
    lengths = np.zeros((MAX_WORDS, SEGMENTS))
    wt = np.zeros(SEGMENTS, np.int64)
    wl = np.zeros(SEGMENTS)
    for i in range(TABLE_PLACES):
        for j in range(TABLE_PLACES):
            for k in range(TABLE_HEADINGS + 1):
                theta = k * 2.0 * math.pi / TABLE_HEADINGS
                out[i, j, k] = reeds_shepp_shortest(i * TABLE_STEP, j * TABLE_STEP, theta, turns, lengths, wt, wl)
    return out


@kernel
def look_up_length(table: Any, x: float, y: float, theta: float) -> float:
    """About the shortest length in radii to (x, y, theta), x and y in radii; 0 outside the table.

    Interpolated in ``reeds_shepp_table``: a guide for searches, neither a lower bound nor an upper.
    """
    if x < 0.0:
        x, theta = -x, -theta
    if y < 0.0:
        y, theta = -y, -theta
    u, v = x / TABLE_STEP, y / TABLE_STEP
    i, j = int(u), int(v)
    if i >= TABLE_PLACES - 1 or j >= TABLE_PLACES - 1:
        return 0.0
    w = theta / (2.0 * math.pi)
    w = (w - math.floor(w)) * TABLE_HEADINGS
    k = min(int(w), TABLE_HEADINGS - 1)
    u, v, w = u - i, v - j, w - k
    near = (1.0 - v) * table[i, j, k] + v * table[i, j + 1, k]
    far = (1.0 - v) * table[i + 1, j, k] + v * table[i + 1, j + 1, k]
    low = (1.0 - u) * near + u * far
    near = (1.0 - v) * table[i, j, k + 1] + v * table[i, j + 1, k + 1]
    far = (1.0 - v) * table[i + 1, j, k + 1] + v * table[i + 1, j + 1, k + 1]
    high = (1.0 - u) * near + u * far
    length: float = (1.0 - w) * low + w * high
    return length


@kernel
def advance(x: float, y: float, theta: float, turn: float, length: float, phi: float) -> tuple[float, float, float]:
    """The pose after one segment of signed length [m] at curvature turn * phi (turn may be any real ratio)."""
    kappa = turn * phi
    if abs(kappa) < 1e-12:
        return x + length * math.cos(theta), y + length * math.sin(theta), theta
    end = theta + kappa * length
    return (
        x + (math.sin(end) - math.sin(theta)) / kappa,
        y - (math.cos(end) - math.cos(theta)) / kappa,
        end,
    )

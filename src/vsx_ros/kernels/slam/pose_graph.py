"""Pose-graph optimisation over similarities T_world_node = (s, R, t): x_world = s R x_node + t.

An edge measures b from a: R_ab, t_ab in a's unit of length, and s_ab = s_b / s_a. Residual (7,), exact:
translation R_a^T (t_b - t_a) / s_a - t_ab; rotation log(R_ab^T R_a^T R_b); scale log(s_b / s_a) - log s_ab.
Perturbation: t <- t + rho, R <- R exp(omega), s <- s exp(sigma); tangent order (rho, omega, sigma)."""

import math
from typing import NamedTuple

import numpy as np

from vsx_ros.arrays import BoolArray, FloatArray, IntArray
from vsx_ros.kernels import kernel
from vsx_ros.kernels.geometry import exp_se3, log_se3, orthonormalize
from vsx_ros.kernels.linalg.cholesky import envelope, factor_envelope, solve_envelope

NODE_DOF = 7


class Edges(NamedTuple):
    """E measurements of nodes b from nodes a (E,): R (E, 3, 3), t (E, 3), s (E,) and information (E, 7, 7)."""

    a: IntArray
    b: IntArray
    R: FloatArray
    t: FloatArray
    s: FloatArray
    information: FloatArray


@kernel
def edge_residual(R: FloatArray, t: FloatArray, s: FloatArray, edges: Edges, e: int) -> FloatArray:
    """(7,) residual of edge e at its two nodes."""
    a, b = edges.a[e], edges.b[e]
    Ra, ta, Rb, tb, Zr, zt = R[a], t[a], R[b], t[b], edges.R[e], edges.t[e]
    r = np.empty(NODE_DOF)
    E = np.zeros((3, 3))
    for i in range(3):
        r[i] = (Ra[0, i] * (tb[0] - ta[0]) + Ra[1, i] * (tb[1] - ta[1]) + Ra[2, i] * (tb[2] - ta[2])) / s[a] - zt[i]
        for j in range(3):
            for k in range(3):
                E[i, j] += Zr[k, i] * (Ra[0, k] * Rb[0, j] + Ra[1, k] * Rb[1, j] + Ra[2, k] * Rb[2, j])
    r[3:6] = log_se3(E, np.zeros(3))[3:]
    r[6] = math.log(s[b] / s[a]) - math.log(edges.s[e])
    return r


@kernel
def edge_jacobians(r: FloatArray, R: FloatArray, s: FloatArray, edges: Edges, e: int) -> tuple[FloatArray, FloatArray]:
    """(7, 7) exact derivatives of ``edge_residual`` (value r) by the perturbations of the edge's nodes a and b."""
    Ra, Rb, sa, zt = R[edges.a[e]], R[edges.b[e]], s[edges.a[e]], edges.t[e]
    Ja, Jb = np.zeros((NODE_DOF, NODE_DOF)), np.zeros((NODE_DOF, NODE_DOF))
    p0, p1, p2 = r[0] + zt[0], r[1] + zt[1], r[2] + zt[2]
    for i in range(3):
        for j in range(3):
            Jb[i, j] = Ra[j, i] / sa
            Ja[i, j] = -Jb[i, j]
    Ja[0, 4], Ja[0, 5] = -p2, p1
    Ja[1, 3], Ja[1, 5] = p2, -p0
    Ja[2, 3], Ja[2, 4] = -p1, p0
    Ja[0, 6], Ja[1, 6], Ja[2, 6] = -p0, -p1, -p2
    # Inverse right Jacobian of the rotation residual w: I + [w] / 2 + c [w]^2.
    w0, w1, w2 = r[3], r[4], r[5]
    angle = math.sqrt(w0 * w0 + w1 * w1 + w2 * w2)
    c = 1.0 / 12.0 if angle < 1e-4 else (1.0 - 0.5 * angle / math.tan(0.5 * angle)) / (angle * angle)
    W = np.array([[0.0, -w2, w1], [w2, 0.0, -w0], [-w1, w0, 0.0]])
    for i in range(3):
        for j in range(3):
            square = W[i, 0] * W[0, j] + W[i, 1] * W[1, j] + W[i, 2] * W[2, j]
            Jb[3 + i, 3 + j] = (1.0 if i == j else 0.0) + 0.5 * W[i, j] + c * square
    for i in range(3):
        for j in range(3):
            for k in range(3):
                Rba = Rb[0, k] * Ra[0, j] + Rb[1, k] * Ra[1, j] + Rb[2, k] * Ra[2, j]
                Ja[3 + i, 3 + j] -= Jb[3 + i, 3 + k] * Rba
    Ja[6, 6], Jb[6, 6] = -1.0, 1.0
    return Ja, Jb


@kernel
def graph_cost(R: FloatArray, t: FloatArray, s: FloatArray, edges: Edges) -> float:
    """Half the weighted squared error of all edges."""
    total = 0.0
    for e in range(edges.a.shape[0]):
        r = edge_residual(R, t, s, edges, e)
        for p in range(NODE_DOF):
            for q in range(NODE_DOF):
                total += 0.5 * r[p] * edges.information[e, p, q] * r[q]
    return total


@kernel
def _assemble(
    blocks: FloatArray, g: FloatArray, first: IntArray, start: IntArray, free: IntArray, R: FloatArray,
    t: FloatArray, s: FloatArray, edges: Edges,
) -> None:  # fmt: skip
    """Normal equations of all edges into the envelope's upper triangle; g (n, D) is the right-hand side."""
    D = blocks.shape[1]
    blocks[:] = 0.0
    g[:] = 0.0
    for e in range(edges.a.shape[0]):
        i, j, info = edges.a[e], edges.b[e], edges.information[e]
        r = edge_residual(R, t, s, edges, e)
        Ja, Jb = edge_jacobians(r, R, s, edges, e)
        weighted = info @ r
        for u in range(2):
            row, Ju = (free[i], Ja) if u == 0 else (free[j], Jb)
            if row < 0:
                continue
            JuW = Ju.T @ info
            for p in range(D):
                for q in range(NODE_DOF):
                    g[row, p] -= Ju[q, p] * weighted[q]
            for v in range(2):
                column, Jv = (free[i], Ja) if v == 0 else (free[j], Jb)
                if column < row:
                    continue
                block = blocks[start[column] + row - first[column]]
                for p in range(D):
                    for q in range(D):
                        for k in range(NODE_DOF):
                            block[p, q] += JuW[p, k] * Jv[k, q]


@kernel
def _moved(
    R: FloatArray, t: FloatArray, s: FloatArray, free: IntArray, step: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """All nodes after a step (n, D) of the free ones."""
    R, t, s = R.copy(), t.copy(), s.copy()
    xi = np.zeros(6)
    for k in range(free.shape[0]):
        if free[k] < 0:
            continue
        x = step[free[k]]
        xi[3:] = x[3:6]
        turn, _ = exp_se3(xi)
        R[k] = R[k] @ turn
        orthonormalize(R[k])
        t[k] += x[:3]
        if step.shape[1] == NODE_DOF:
            s[k] *= math.exp(x[6])
    return R, t, s


@kernel
def optimize_graph(
    R: FloatArray, t: FloatArray, s: FloatArray, held: BoolArray, edges: Edges, free_scale: bool, iterations: int
) -> tuple[FloatArray, FloatArray, FloatArray, float]:
    """Levenberg-Marquardt on all nodes but those ``held`` (K,).

    R (K, 3, 3), t (K, 3), s (K,): T_world_node. free_scale False keeps every s. Returns R, t, s and half the weighted
    squared error reached. A node that no edges connect to a held one stays where it is."""
    D = NODE_DOF if free_scale else NODE_DOF - 1
    free = np.where(held, -1, np.cumsum(~held) - 1)
    n = int(np.count_nonzero(~held))
    cost = graph_cost(R, t, s, edges)
    if n == 0:
        return R, t, s, cost
    first, start = envelope(n, free[edges.a], free[edges.b])
    blocks, g = np.zeros((start[n], D, D)), np.zeros((n, D))
    damping = 1e-6
    for _ in range(iterations):
        _assemble(blocks, g, first, start, free, R, t, s, edges)
        for _ in range(6):
            factor, step = blocks.copy(), g.copy()
            for k in range(n):
                diagonal = factor[start[k + 1] - 1]
                for p in range(D):
                    diagonal[p, p] += damping * diagonal[p, p] + 1e-9
            if factor_envelope(factor, first, start):
                solve_envelope(factor, first, start, step)
                R_new, t_new, s_new = _moved(R, t, s, free, step)
                reached = graph_cost(R_new, t_new, s_new, edges)
                if reached <= cost:
                    break
            damping = max(damping, 1e-6) * 10.0
        else:
            break
        gain = cost - reached
        R, t, s, cost, damping = R_new, t_new, s_new, reached, damping * 0.1
        if gain <= 1e-6 * cost + 1e-12:
            break
    return R, t, s, cost


@kernel
def count_shared(rows: IntArray, ends: IntArray, n_points: int) -> IntArray:
    """(N, N) number of points, of n_points, that each two of N keyframes share. Keyframe n sees the rows up to ends[n]
    that follow those of keyframe n - 1."""
    n = len(ends)
    first = np.zeros(n_points + 1, np.int64)
    for row in rows:
        first[row + 1] += 1
    first = np.cumsum(first)
    viewers, seen = np.empty(len(rows), np.int64), np.zeros(n_points, np.int64)
    shared = np.zeros((n, n), np.int64)
    begin = 0
    for a in range(n):
        for row in rows[begin : ends[a]]:
            viewers[first[row] + seen[row]] = a
            seen[row] += 1
            for i in range(first[row], first[row] + seen[row]):
                shared[a, viewers[i]] += 1
        begin = ends[a]
        for b in range(a):
            shared[b, a] = shared[a, b]
    return shared

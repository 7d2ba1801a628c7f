"""Cholesky factorisation of a symmetric matrix of D x D blocks that is stored by its envelope: column j keeps the
blocks from its first row ``first[j]`` down to the diagonal, one after the other from ``start[j]`` on.

Keyframes along a path give a narrow band, a closed loop one tall column; nothing outside the envelope ever fills in.
"""

import numpy as np

from vsx_ros.arrays import FloatArray, IntArray
from vsx_ros.kernels import kernel
from vsx_ros.kernels.linalg.cholesky import factor_in_place


@kernel
def envelope(n: int, a: IntArray, b: IntArray) -> tuple[IntArray, IntArray]:
    """first (n,) and start (n + 1,) of the envelope that holds the blocks (a, b), in either order, and the diagonal.

    A negative index stands for a block that is not in the matrix.
    """
    first = np.arange(n)
    for e in range(a.shape[0]):
        low, high = min(a[e], b[e]), max(a[e], b[e])
        if low >= 0 and low < first[high]:
            first[high] = low
    start = np.zeros(n + 1, np.int64)
    for j in range(n):
        start[j + 1] = start[j] + j - first[j] + 1
    return first, start


@kernel
def factor_envelope(blocks: FloatArray, first: IntArray, start: IntArray) -> bool:
    """Overwrite blocks (B, D, D) by the upper Cholesky factor; False when the matrix is not positive definite."""
    n, D = first.shape[0], blocks.shape[1]
    for j in range(n):
        for i in range(first[j], j + 1):
            target = blocks[start[j] + i - first[j]]
            for k in range(max(first[i], first[j]), i):
                left, right = blocks[start[i] + k - first[i]], blocks[start[j] + k - first[j]]
                for r in range(D):
                    for p in range(D):
                        f = left[r, p]
                        for q in range(D):
                            target[p, q] -= f * right[r, q]
            if i == j:
                if not factor_in_place(target):
                    return False
                continue
            diagonal = blocks[start[i + 1] - 1]
            for r in range(D):
                for p in range(r):
                    f = diagonal[p, r]
                    for q in range(D):
                        target[r, q] -= f * target[p, q]
                for q in range(D):
                    target[r, q] /= diagonal[r, r]
    return True


@kernel
def solve_envelope(blocks: FloatArray, first: IntArray, start: IntArray, x: FloatArray) -> None:
    """Overwrite x (n, D) by the solution of U^T U y = x, U as ``factor_envelope`` leaves it."""
    n, D = first.shape[0], blocks.shape[1]
    for j in range(n):
        for i in range(first[j], j):
            block = blocks[start[j] + i - first[j]]
            for r in range(D):
                for q in range(D):
                    x[j, q] -= block[r, q] * x[i, r]
        diagonal = blocks[start[j + 1] - 1]
        for r in range(D):
            for p in range(r):
                x[j, r] -= diagonal[p, r] * x[j, p]
            x[j, r] /= diagonal[r, r]
    for j in range(n - 1, -1, -1):
        diagonal = blocks[start[j + 1] - 1]
        for r in range(D - 1, -1, -1):
            for p in range(r + 1, D):
                x[j, r] -= diagonal[r, p] * x[j, p]
            x[j, r] /= diagonal[r, r]
        for i in range(first[j], j):
            block = blocks[start[j] + i - first[j]]
            for r in range(D):
                for q in range(D):
                    x[i, r] -= block[r, q] * x[j, q]

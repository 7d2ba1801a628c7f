"""Cholesky factorisation of small dense symmetric systems, in place, and of symmetric matrices of D x D blocks in
envelope storage: column j keeps the blocks from row ``first[j]`` to the diagonal, in sequence from ``start[j]`` on.

Keyframes along a path give a narrow band, a closed loop one tall column; nothing outside the envelope is ever
filled."""

import math

import numpy as np

from vsx_ros.arrays import FloatArray, IntArray
from vsx_ros.kernels import kernel


@kernel
def factor_in_place(A: FloatArray) -> bool:
    """Upper Cholesky factor of the symmetric A (upper triangle read and overwritten); False when not positive
    definite.

    Right-looking with contiguous row updates: vectorises without reassociating sums, hence reproducible."""
    n = A.shape[0]
    for k in range(n):
        pivot = A[k, k]
        if not pivot > 1e-12:
            return False
        root = math.sqrt(pivot)
        for j in range(k, n):
            A[k, j] /= root
        for i in range(k + 1, n):
            f = A[k, i]
            if f != 0.0:
                for j in range(i, n):
                    A[i, j] -= f * A[k, j]
    return True


@kernel
def solve_factored(U: FloatArray, b: FloatArray) -> None:
    """Overwrite b with the solution of U^T U x = b."""
    n = U.shape[0]
    for k in range(n):
        b[k] /= U[k, k]
        f = b[k]
        for j in range(k + 1, n):
            b[j] -= f * U[k, j]
    for k in range(n - 1, -1, -1):
        s = b[k]
        for j in range(k + 1, n):
            s -= U[k, j] * b[j]
        b[k] = s / U[k, k]


@kernel
def envelope(n: int, a: IntArray, b: IntArray) -> tuple[IntArray, IntArray]:
    """first (n,) and start (n + 1,) of the envelope that holds the blocks (a, b), in either order, and the diagonal.

    A negative index stands for a block that is not in the matrix."""
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

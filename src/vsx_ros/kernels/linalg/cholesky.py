"""Dense Cholesky factorisation of small symmetric systems, in place."""

import math

from vsx_ros.arrays import FloatArray
from vsx_ros.kernels import kernel


@kernel
def factor_in_place(A: FloatArray) -> bool:
    """Upper Cholesky factor of the symmetric A (upper triangle read and overwritten); False when not positive
    definite.

    Right-looking with contiguous row updates: vectorises without reassociating sums, hence reproducible.
    """
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

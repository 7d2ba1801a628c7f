"""The frontal solver: same solution as the dense one whatever is tied to what; the front is as wide as it must be."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vsx_ros.kernels.linalg import frontal


def system(tied, rng):
    """Symmetric positive definite (6 n, 6 n) with blocks where frames are tied, and a right-hand side (n, 6)."""
    n = len(tied)
    S = rng.normal(size=(6 * n, 6 * n)) * np.kron(tied | tied.T | np.eye(n, dtype=bool), np.ones((6, 6)))
    S = S + S.T
    return S + np.diag(np.abs(S).sum(axis=1) + 0.1), rng.normal(size=(n, 6))


def solve(tied, S, b):
    n = len(tied)
    order, entry, extent = frontal.elimination(tied)
    assert sorted(order) == sorted(entry) == list(range(n))
    position = np.argsort(order)
    blocks, begin, column = [], [0], []
    for k, frame in enumerate(order):
        later = [j for j in range(k + 1, n) if tied[min(frame, order[j]), max(frame, order[j])]]
        for j in [k, *later]:
            blocks.append(S[6 * frame : 6 * frame + 6, 6 * order[j] : 6 * order[j] + 6])
            column.append(j)
        begin.append(len(column))
    x = b[order].copy()
    ok = frontal.solve(np.array(blocks), np.array(begin), np.array(column), position[entry], extent, x)
    return ok, x[position], extent


@settings(max_examples=60)
@given(st.integers(1, 25), st.floats(0.0, 1.0), st.integers(0, 1000))
def test_solves_what_the_dense_solver_solves(n, density, seed):
    rng = np.random.default_rng(seed)
    tied = np.triu(rng.random((n, n)) < density, 1)
    S, b = system(tied, rng)
    ok, x, _ = solve(tied, S, b)
    assert ok
    assert x.ravel() == pytest.approx(np.linalg.solve(S, b.ravel()), rel=1e-9, abs=1e-12)


def test_same_bits_twice():
    rng = np.random.default_rng(0)
    tied = np.triu(rng.random((30, 30)) < 0.2, 1)
    S, b = system(tied, rng)
    assert (solve(tied, S, b)[1] == solve(tied, S, b)[1]).all()


def test_what_is_not_positive_definite_is_told():
    tied = np.triu(np.ones((3, 3), np.bool_), 1)
    S, b = system(tied, np.random.default_rng(0))
    S[8, 8] = -1.0
    assert not solve(tied, S, b)[0]
    S[8, 8] = np.nan
    assert not solve(tied, S, b)[0]


@pytest.mark.parametrize("n", [40, 400])
def test_along_a_path_the_front_does_not_grow_with_its_length(n):
    """However the frames are numbered; closed to a loop it is twice as wide."""
    shuffled = np.random.default_rng(0).permutation(n)
    offset = np.abs(np.arange(n)[:, None] - np.arange(n))
    for tied, widest in ((offset <= 5, 8), (np.minimum(offset, n - offset) <= 5, 13)):
        mixed = np.triu(tied[shuffled][:, shuffled], 1)
        assert 6 <= frontal.elimination(mixed)[2].max() <= widest


def test_a_branch_is_finished_before_the_next_is_begun():
    """Twelve corridors from one junction: eliminated one by one, not all at once."""
    n, arm = 121, 10
    tied = np.zeros((n, n), np.bool_)
    for first in range(1, n, arm):
        tied[0, first] = True
        for k in range(first, first + arm - 1):
            tied[k, k + 1] = True
    assert frontal.elimination(tied)[2].max() <= 14

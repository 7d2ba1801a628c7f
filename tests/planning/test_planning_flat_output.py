"""The basis is orthonormal, profiles are monotone S-curves, and the Bernstein bound is a bound."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vsx_ros.planning.flat_output import (
    COARSE,
    COEFFICIENTS,
    FINE,
    FLAGS,
    RATE_ROWS,
    curvature_bound,
    jacobi,
    profile,
    profile_rate,
    rest_factor,
)

T = np.linspace(0.0, 1.0, 2001)


def test_the_rates_are_orthonormal():
    basis = COARSE.basis[(False, False)]
    gram = basis.T @ (COARSE.weights[:, None] * basis)
    np.testing.assert_allclose(gram, np.eye(COEFFICIENTS), atol=1e-12)


@pytest.mark.parametrize("flags", FLAGS)
def test_the_profile_is_the_integral_of_its_rate(flags):
    rate = rest_factor(T, *flags) * profile_rate(T, *flags)
    assert np.all(rate >= 0.0)
    fine = rest_factor(FINE.t, *flags) * profile_rate(FINE.t, *flags)
    np.testing.assert_allclose(FINE.cumulative(fine), profile(FINE.knots, *flags), atol=1e-12)
    assert profile(np.array([0.0, 1.0]), *flags) == pytest.approx([0.0, 1.0], abs=1e-12)


@pytest.mark.parametrize("flags", FLAGS)
def test_rho_vanishes_exactly_where_the_base_rests(flags):
    ends = rest_factor(np.array([0.0, 1.0]), *flags)
    assert ends == pytest.approx([float(flags[0]), float(flags[1])], abs=1e-15)


@given(st.lists(st.floats(-1.0, 1.0), min_size=9, max_size=9), st.floats(-3.0, 3.0), st.sampled_from(FLAGS))
@settings(max_examples=100)
def test_no_point_turns_faster_than_the_bernstein_bound(tail, turn, flags):
    coefficients = np.array([8.0, *tail])
    p = jacobi(T) @ coefficients
    bound = curvature_bound(coefficients, turn, flags)
    if not np.isfinite(bound):
        assert (RATE_ROWS @ coefficients).min() <= 0.0
        return
    assert p.min() > 0.0
    worst = np.max(abs(turn) * profile_rate(T, *flags) / p)
    assert worst <= bound * (1.0 + 1e-12)


def test_the_bound_of_a_constant_rate_is_exact():
    coefficients = np.zeros(COEFFICIENTS)
    coefficients[0] = 2.0
    p = float(jacobi(np.array([0.3]))[0, 0]) * 2.0
    assert curvature_bound(coefficients, 0.5, (True, True)) == pytest.approx(0.5 * 6.0 * 0.25 / p, rel=0.1)

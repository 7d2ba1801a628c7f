"""Laws of SE2 and SE3, also near their singular places."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vsx_ros.geometry.se2 import SE2, wrap_angle
from vsx_ros.geometry.se3 import (
    SE3,
    StampedPoses,
    quaternion_from_rotation,
    rotation_from_quaternion,
    so3_exp,
    so3_log,
    stacked,
)

coordinate = st.floats(-50, 50)
poses2 = st.builds(SE2, coordinate, coordinate, st.floats(-10, 10))
tangents = st.lists(st.floats(-2, 2), min_size=6, max_size=6).map(np.array)
poses3 = tangents.map(SE3.exp)


def same(a, b, tolerance=1e-9):
    if isinstance(a, SE2):
        return a.distance_to(b) < tolerance * 100 and abs(a.angle_to(b)) < tolerance * 100
    return np.abs(a.matrix() - b.matrix()).max() < tolerance


@given(poses2, poses2, poses2)
def test_se2_is_a_group(a, b, c):
    assert same((a @ b) @ c, a @ (b @ c))
    assert same(a @ a.inverse(), SE2())
    assert same((a @ b).inverse(), b.inverse() @ a.inverse())


@given(poses3, poses3, poses3)
def test_se3_is_a_group(a, b, c):
    assert same((a @ b) @ c, a @ (b @ c))
    assert same(a @ a.inverse(), SE3.identity())
    assert same((a @ b).inverse(), b.inverse() @ a.inverse())


@given(poses2, poses2)
def test_acting_on_points_is_composition(a, b):
    points = np.array([[1.0, 2.0], [-3.0, 0.5]])
    assert np.allclose((a @ b) @ points, a @ (b @ points), atol=1e-9)


@given(poses3, poses3)
def test_acting_on_points_is_composition_in_space(a, b):
    points = np.array([[1.0, 2.0, -1.0], [-3.0, 0.5, 4.0]])
    assert np.allclose((a @ b) @ points, a @ (b @ points), atol=1e-9)


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-8, 1e-7, 2e-6, 1e-3, 1.0, 3.0, math.pi - 1e-3, math.pi - 1e-7])
def test_log_undoes_exp_at_every_angle(angle):
    axis = np.array([0.48, -0.6, 0.64])
    xi = np.concatenate([[0.3, -1.2, 0.7], angle * axis])
    assert SE3.exp(xi).log() == pytest.approx(xi, abs=2e-7)
    assert so3_log(so3_exp(angle * axis)) == pytest.approx(angle * axis, abs=2e-8)


@given(poses3)
def test_quaternions_say_the_same(T):
    quaternion = T.quaternion()
    assert quaternion[3] >= 0
    assert math.isclose(sum(q * q for q in quaternion), 1.0, rel_tol=1e-12)
    assert np.allclose(rotation_from_quaternion(*quaternion), T.rotation, atol=1e-12)
    assert same(SE3.from_quaternion(T.translation, quaternion), T)


@pytest.mark.parametrize("axis", np.eye(3))
def test_half_turns_have_a_quaternion(axis):
    R = so3_exp(math.pi * axis)
    assert np.abs(np.abs(quaternion_from_rotation(R)[:3]) - axis).max() < 1e-9


@given(st.floats(-1, 1), st.floats(-3, 3))
def test_se2_exp_halves(v, omega):
    half = SE2.exp(0.5 * v, 0.5 * omega)
    assert same(half @ half, SE2.exp(v, omega))


def test_se2_exp_is_continuous_at_zero_turn():
    assert same(SE2.exp(1.0, 1e-10), SE2.exp(1.0, 2e-9), 1e-10)


@given(poses2)
def test_floor_poses_survive_space(T):
    back = (SE3(np.eye(3), np.array([0.0, 0.0, 0.3])) @ SE3.from_se2(T)).to_se2()
    assert same(back, T)


@given(st.floats(-100, 100))
def test_wrapped_angles_lie_in_one_turn(angle):
    wrapped = wrap_angle(angle)
    assert -math.pi <= wrapped < math.pi
    assert math.isclose(math.cos(wrapped), math.cos(angle), abs_tol=1e-9)
    assert math.isclose(math.sin(wrapped), math.sin(angle), abs_tol=1e-9)


def test_interpolation_takes_the_shorter_turn():
    middle = SE2(0, 0, 3.0).interpolate(SE2(2, 4, -3.0), 0.5)
    assert (middle.x, middle.y) == (1.0, 2.0)
    assert abs(wrap_angle(middle.theta - math.pi)) < 1e-12


def test_poses_are_values():
    T = SE3.identity()
    with pytest.raises(ValueError, match="read-only"):
        T.rotation[0, 0] = 2.0
    assert SE3.identity().inverse().rotation.flags.c_contiguous


@given(st.lists(poses3, max_size=5))
def test_stamped_poses_are_kept_bit_for_bit(given_):
    kept = StampedPoses(enumerate(given_))
    assert len(kept) == len(given_) == len(kept[:])
    for k, (stamp_ns, T) in enumerate(kept):
        assert stamp_ns == k == kept.stamps_ns[k]
        assert T.matrix().tobytes() == given_[k].matrix().tobytes()
    assert all(map(np.array_equal, kept.stacked(), stacked(given_)))
    with pytest.raises(IndexError):
        kept[len(given_)]

"""Poses in space. Tangent order is (translation, rotation): xi = (rho, omega), as in the bundle adjustment."""

from __future__ import annotations

import math
from array import array
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple, overload

import numpy as np

from vsx_ros.arrays import FloatArray, IntArray, Points3
from vsx_ros.geometry.se2 import SE2


def skew(w: FloatArray) -> FloatArray:
    """(3, 3) matrix whose product with v is the cross product of w (3,) and v."""
    return np.array([[0.0, -w[2], w[1]], [w[2], 0.0, -w[0]], [-w[1], w[0], 0.0]])


def so3_exp(omega: FloatArray) -> FloatArray:
    """(3, 3) rotation by the vector omega (3,) [rad] (Rodrigues)."""
    angle = math.hypot(*omega)
    if angle < 1e-8:
        return _series(omega, 1.0, 0.5)
    return _series(omega, math.sin(angle) / angle, (1.0 - math.cos(angle)) / angle**2)


def _series(omega: FloatArray, first: float, second: float) -> FloatArray:
    """(3, 3) matrix I + first W + second W W, with W = skew(omega)."""
    # Python's own floats: arrays of nine cost ten times as much.
    x, y, z = map(float, omega)
    xx, yy, zz = second * x * x, second * y * y, second * z * z
    xy, xz, yz = second * x * y, second * x * z, second * y * z
    x, y, z = first * x, first * y, first * z
    return np.array([[1.0 - yy - zz, xy - z, xz + y], [xy + z, 1.0 - xx - zz, yz - x], [xz - y, yz + x, 1.0 - xx - yy]])


def so3_log(R: FloatArray) -> FloatArray:
    """(3,) rotation vector of R, of norm at most pi [rad]; accurate near 0 and near pi."""
    qx, qy, qz, qw = quaternion_from_rotation(R)
    v = np.array([qx, qy, qz])
    norm = math.hypot(qx, qy, qz)
    if norm < 1e-12:
        return 2.0 * v
    return 2.0 * math.atan2(norm, qw) / norm * v


def quaternion_from_rotation(R: FloatArray) -> tuple[float, float, float, float]:
    """(qx, qy, qz, qw) with qw >= 0, by the largest-component rule (no division by a small number)."""
    # Python's own floats: an array of four costs ten times as much.
    (m00, m01, m02), (m10, m11, m12), (m20, m21, m22) = np.asarray(R, float).tolist()
    four = (1 + m00 - m11 - m22, 1 - m00 + m11 - m22, 1 - m00 - m11 + m22, 1 + m00 + m11 + m22)
    largest = max(four)
    if largest == four[0]:
        q = (largest, m01 + m10, m02 + m20, m21 - m12)
    elif largest == four[1]:
        q = (m01 + m10, largest, m12 + m21, m02 - m20)
    elif largest == four[2]:
        q = (m02 + m20, m12 + m21, largest, m10 - m01)
    else:
        q = (m21 - m12, m02 - m20, m10 - m01, largest)
    norm = math.copysign(math.hypot(*q), q[3])
    return q[0] / norm, q[1] / norm, q[2] / norm, q[3] / norm


def rotation_from_quaternion(qx: float, qy: float, qz: float, qw: float) -> FloatArray:
    """(3, 3) rotation of a quaternion of any non-zero norm."""
    n = math.sqrt(qx * qx + qy * qy + qz * qz + qw * qw)
    x, y, z, w = qx / n, qy / n, qz / n, qw / n
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


@dataclass(frozen=True, slots=True, eq=False)
class SE3:
    """Rigid motion of space: rotation (3, 3), translation (3,) [m]; both are made read-only."""

    rotation: FloatArray
    translation: FloatArray

    def __post_init__(self) -> None:
        R = np.array(self.rotation, dtype=np.float64, order="C")
        t = np.array(self.translation, dtype=np.float64).reshape(3)
        R.flags.writeable = False
        t.flags.writeable = False
        object.__setattr__(self, "rotation", R)
        object.__setattr__(self, "translation", t)

    @staticmethod
    def _of(rotation: FloatArray, translation: FloatArray) -> SE3:
        """From new contiguous arrays that nothing else uses; takes a third of the constructor's time."""
        T = object.__new__(SE3)
        rotation.setflags(write=False)
        translation.setflags(write=False)
        object.__setattr__(T, "rotation", rotation)
        object.__setattr__(T, "translation", translation)
        return T

    @staticmethod
    def identity() -> SE3:
        """The motion that moves nothing."""
        return SE3._of(np.eye(3), np.zeros(3))

    @overload
    def __matmul__(self, other: SE3) -> SE3: ...
    @overload
    def __matmul__(self, other: Points3) -> Points3: ...
    def __matmul__(self, other: SE3 | Points3) -> SE3 | Points3:
        """Compose with a pose, or map (N, 3) points."""
        if isinstance(other, SE3):
            return SE3._of(self.rotation @ other.rotation, self.rotation @ other.translation + self.translation)
        return np.asarray(other) @ self.rotation.T + self.translation

    def inverse(self) -> SE3:
        """The motion that undoes this one."""
        turned = self.rotation.T
        return SE3._of(turned.copy(), -turned @ self.translation)

    def scaled(self, factor: float) -> SE3:
        """The same rotation, with a translation ``factor`` times as long."""
        return SE3(self.rotation, factor * self.translation)

    def matrix(self) -> FloatArray:
        """(4, 4) homogeneous matrix."""
        return np.vstack([np.column_stack([self.rotation, self.translation]), [0.0, 0.0, 0.0, 1.0]])

    @staticmethod
    def from_matrix(T: FloatArray) -> SE3:
        """From a (4, 4) or (3, 4) matrix."""
        return SE3(T[:3, :3], T[:3, 3])

    @staticmethod
    def exp(xi: FloatArray) -> SE3:
        """From the tangent vector (6,) = (rho [m], omega [rad])."""
        rho, omega = np.asarray(xi[:3], float), np.asarray(xi[3:], float)
        angle = math.hypot(*omega)
        if angle < 1e-6:
            V = _series(omega, 0.5, 1.0 / 6.0)
        else:
            V = _series(omega, (1.0 - math.cos(angle)) / angle**2, (angle - math.sin(angle)) / angle**3)
        return SE3._of(so3_exp(omega), V @ rho)

    def log(self) -> FloatArray:
        """The tangent vector (6,) whose ``exp`` is this motion; rotation below pi."""
        omega = so3_log(self.rotation)
        half = 0.5 * math.hypot(*omega)
        second = 1.0 / 12.0 if half < 5e-7 else 0.25 * (1.0 - half / math.tan(half)) / half**2
        V_inverse = _series(omega, -0.5, second)
        return np.concatenate([V_inverse @ self.translation, omega])

    def quaternion(self) -> tuple[float, float, float, float]:
        """(qx, qy, qz, qw) with qw >= 0."""
        return quaternion_from_rotation(self.rotation)

    @staticmethod
    def from_quaternion(translation: FloatArray, quaternion: tuple[float, float, float, float]) -> SE3:
        """From translation (3,) [m] and (qx, qy, qz, qw)."""
        return SE3(rotation_from_quaternion(*quaternion), np.asarray(translation, float))

    @staticmethod
    def from_se2(T: SE2) -> SE3:
        """A pose on the floor as a pose in space, at height 0."""
        c, s = math.cos(T.theta), math.sin(T.theta)
        return SE3._of(np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]), np.array([T.x, T.y, 0.0], float))

    def to_se2(self) -> SE2:
        """Drop height, roll and pitch: x, y and the heading of the x axis."""
        heading = math.atan2(float(self.rotation[1, 0]), float(self.rotation[0, 0]))
        return SE2(float(self.translation[0]), float(self.translation[1]), heading)

    def rotation_angle_to(self, other: SE3) -> float:
        """Angle of the rotation between the two poses, in [0, pi] [rad]."""
        qx, qy, qz, qw = quaternion_from_rotation(self.rotation.T @ other.rotation)
        return 2.0 * math.atan2(math.hypot(qx, qy, qz), qw)

    def is_near(self, other: SE3, distance: float, angle: float) -> bool:
        """Whether the two poses are less than a distance [m] and an angle [rad] apart."""
        near = float(np.linalg.norm(self.translation - other.translation)) < distance
        return near and self.rotation_angle_to(other) < angle


def stacked(poses: Sequence[SE3]) -> tuple[FloatArray, FloatArray]:
    """(rotations (N, 3, 3), translations (N, 3)) of poses, as kernels take them."""
    R, t = [T.rotation for T in poses], [T.translation for T in poses]
    return np.array(R).reshape(-1, 3, 3), np.array(t).reshape(-1, 3)


class StampedPose(NamedTuple):
    """stamp_ns: time [ns]. T: the pose at that time; its owner defines the two frames."""

    stamp_ns: int
    T: SE3


class StampedPoses(Sequence[StampedPose]):
    """Poses in order, bit for bit; each takes 104 bytes instead of 600. One thread may append while others read."""

    def __init__(self, poses: Iterable[tuple[int, SE3]] = ()) -> None:
        self._numbers, self._stamps_ns = array("d"), array("q")  # a pose is there once its stamp is
        for stamp_ns, T in poses:
            self.append(stamp_ns, T)

    def append(self, stamp_ns: int, T: SE3) -> None:
        """Add a pose at the end."""
        self._numbers.frombytes(T.rotation.tobytes() + T.translation.tobytes())
        self._stamps_ns.append(stamp_ns)

    @property
    def stamps_ns(self) -> IntArray:
        """(N,) times."""
        return np.array(self._stamps_ns[:], np.int64)

    def stacked(self) -> tuple[FloatArray, FloatArray]:
        """(rotations (N, 3, 3), translations (N, 3))."""
        numbers = np.array(self._numbers[: 12 * len(self)]).reshape(-1, 12)
        return numbers[:, :9].copy().reshape(-1, 3, 3), numbers[:, 9:].copy()

    def __len__(self) -> int:
        return len(self._stamps_ns)

    @overload
    def __getitem__(self, index: int) -> StampedPose: ...
    @overload
    def __getitem__(self, index: slice) -> list[StampedPose]: ...
    def __getitem__(self, index: int | slice) -> StampedPose | list[StampedPose]:
        """One pose, or some; each call makes new ones."""
        if isinstance(index, slice):
            return [self[k] for k in range(len(self))[index]]
        k = range(len(self))[index]
        numbers = np.array(self._numbers[12 * k : 12 * k + 12])
        return StampedPose(self._stamps_ns[k], SE3(numbers[:9].reshape(3, 3), numbers[9:]))

"""Reconstructions made by others as problems for ``bundle.adjust``: all observations in pixels of one camera without
distortion."""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from vsx_ros.geometry.se3 import SE3
from vsx_ros.kernels.slam import bundle
from vsx_ros.kernels.slam.factors import no_factors, no_floor
from vsx_ros.kernels.slam.schur import BundleObservations


class BundleFile(NamedTuple):
    """K (4,); poses T_cam_world; points (M, 3); point (O,), sorted, and frame (O,): who sees what; xy (O, 2) px; weight
    (O,): makes a residual count in pixels of its own camera."""

    K: np.ndarray
    poses: list[SE3]
    points: np.ndarray
    point: np.ndarray
    frame: np.ndarray
    xy: np.ndarray
    weight: np.ndarray

    def disturbed(self, pose_sigma: float, point_sigma: float, rng: np.random.Generator) -> "BundleFile":
        """All but the first camera moved, and the points by a share of the scene's size."""
        size = np.linalg.norm(self.points - self.points.mean(axis=0), axis=1).mean()
        poses = [T if k == 0 else SE3.exp(rng.normal(0, pose_sigma, 6)) @ T for k, T in enumerate(self.poses)]
        return self._replace(poses=poses, points=self.points + rng.normal(0, point_sigma * size, self.points.shape))

    def residual_px(self, iterations: int, sigma_min_px: float) -> float:
        """Median residual after ``iterations`` of ``bundle.adjust`` with the first camera fixed."""
        start = np.searchsorted(self.point, np.arange(len(self.points) + 1))
        _, _, _, squared, *_ = bundle.adjust(
            self.K,
            np.array([T.rotation for T in self.poses]),
            np.array([T.translation for T in self.poses]),
            np.arange(-1, len(self.poses) - 1),
            self.points,
            BundleObservations(start, self.point, self.frame, self.xy, self.weight),
            no_factors(),
            no_floor(),
            iterations,
            sigma_min_px,
            bundle.START,
        )
        return float(np.sqrt(np.median(squared)))


def read_colmap(folder: Path) -> BundleFile:
    """A COLMAP text model with one SIMPLE_RADIAL camera."""
    _, model, _, _, f, cx, cy, k1 = _lines(folder / "cameras.txt")[0].split()
    assert model == "SIMPLE_RADIAL"
    images, poses, index, uv = _lines(folder / "images.txt"), [], {}, {}
    for header, pixels in zip(images[::2], images[1::2]):
        name, qw, qx, qy, qz, *t = header.split()[:8]
        index[name] = len(poses)
        uv[name] = np.array(pixels.split(), float).reshape(-1, 3)[:, :2]
        poses.append(SE3.from_quaternion(np.array(t, float), (float(qx), float(qy), float(qz), float(qw))))
    points, rows = [], []
    for line in _lines(folder / "points3D.txt"):
        fields = line.split()
        track = sorted({index[k]: uv[k][int(j)] for k, j in zip(fields[8::2], fields[9::2])}.items())
        rows += [(len(points), frame, *pixel) for frame, pixel in track]
        points.append([float(v) for v in fields[1:4]])
    table, K = np.array(rows), np.array([f, f, cx, cy], float)
    normal = _without_distortion((table[:, 2:] - K[2:]) / K[0], np.full((len(table), 2), [float(k1), 0.0]))
    point, frame = table[:, :2].astype(int).T
    return BundleFile(K, poses, np.array(points), point, frame, normal * K[0] + K[2:], np.ones(len(table)))


def read_bal(path: Path) -> BundleFile:
    """A "Bundle Adjustment in the Large" file; its cameras look along -z with y upwards and have own focal lengths."""
    numbers = np.array(path.read_text().split(), float)
    cameras, points, observations = numbers[:3].astype(int)
    table = numbers[3 : 3 + 4 * observations].reshape(-1, 4)
    rest = numbers[3 + 4 * observations :]
    parameters, xyz = rest[: 9 * cameras].reshape(-1, 9), rest[9 * cameras :].reshape(points, 3)
    turn = SE3.exp(np.array([0.0, 0.0, 0.0, np.pi, 0.0, 0.0]))
    poses = [turn @ SE3(SE3.exp(np.concatenate([np.zeros(3), c[:3]])).rotation, c[3:6]) for c in parameters]
    table = table[np.lexsort((table[:, 0], table[:, 1]))]
    frame, point = table[:, :2].astype(int).T
    f = parameters[frame, 6]
    normal = _without_distortion(table[:, 2:] * [1.0, -1.0] / f[:, None], parameters[frame, 7:9])
    common = parameters[:, 6].mean()
    return BundleFile(np.array([common, common, 0.0, 0.0]), poses, xyz, point, frame, normal * common, f / common)


def _without_distortion(distorted: np.ndarray, k: np.ndarray) -> np.ndarray:
    """Normal coordinates (O, 2) without radial distortion k (O, 2), by fixed-point iteration."""
    normal = distorted
    for _ in range(20):
        r2 = (normal**2).sum(axis=1)
        normal = distorted / (1.0 + k[:, 0] * r2 + k[:, 1] * r2**2)[:, None]
    return normal


def _lines(path: Path) -> list[str]:
    return [line for line in path.read_text().splitlines() if not line.startswith("#")]

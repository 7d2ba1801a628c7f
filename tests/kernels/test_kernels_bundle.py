"""Bundle adjustment: derivatives, recovery with outliers, metric scale by factors, third-party problems."""

import os
from pathlib import Path

import numpy as np
import pytest

from vsx_ros.geometry.se3 import SE3
from vsx_ros.kernels import bundle, floor, relative_pose

K = np.array([525.0, 525.0, 320.0, 240.0])
DATA = Path(os.environ.get("VSX_DATA", Path(__file__).parents[2] / "../shared/data"))


def random_pose(rng, scale):
    return SE3.exp(rng.normal(0, scale, 6))


def test_relative_pose_derivatives():
    rng = np.random.default_rng(0)
    for _ in range(5):
        a, b = random_pose(rng, 0.7), random_pose(rng, 0.7)
        Z = a @ b.inverse() @ random_pose(rng, 0.02)

        def residual(a, b, Z=Z):
            return relative_pose.relative_residual(
                a.rotation, a.translation, b.rotation, b.translation, Z.rotation, Z.translation
            )

        Ja, Jb = relative_pose.relative_jacobians(residual(a, b), Z.rotation, Z.translation)
        h = 1e-6
        for k in range(6):
            step = SE3.exp(h * np.eye(6)[k])
            assert (residual(step @ a, b) - residual(a, b)) / h == pytest.approx(Ja[:, k], abs=2e-3)
            assert (residual(a, step @ b) - residual(a, b)) / h == pytest.approx(Jb[:, k], abs=2e-3)


def test_logarithm_is_se3s():
    rng = np.random.default_rng(1)
    for scale in (1e-9, 1e-4, 0.5, 1.0):
        T = random_pose(rng, scale)
        assert relative_pose.log_se3(T.rotation, T.translation) == pytest.approx(T.log(), rel=1e-7, abs=1e-12)


class Problem:
    """Six cameras on a line, 300 points, 0.5 px noise, 5 % gross outliers."""

    def __init__(self, outliers=0.05):
        rng = np.random.default_rng(4)
        self.truth = [SE3.exp(np.array([0.15 * f, 0, 0.03 * f, 0, 0.015 * f, 0])).inverse() for f in range(6)]
        self.points = np.column_stack([rng.uniform(-3, 4, 300), rng.uniform(-1.5, 1.5, 300), rng.uniform(3, 7, 300)])
        rows = []
        for p, point in enumerate(self.points):
            for f, T in enumerate(self.truth):
                cam = T @ point
                uv = cam[:2] / cam[2] * K[:2] + K[2:]
                if 0 < uv[0] < 640 and 0 < uv[1] < 480:
                    noise = rng.normal(0, 0.5 if rng.random() > outliers else 30.0, 2)
                    rows.append((p, f, *(uv + noise)))
        table = np.array(rows)
        self.obs_point, self.obs_frame = table[:, 0].astype(int), table[:, 1].astype(int)
        self.obs_xy = np.ascontiguousarray(table[:, 2:])
        self.start_poses = [T if f < 2 else random_pose(rng, 0.01) @ T for f, T in enumerate(self.truth)]
        self.start_points = self.points + rng.normal(0, 0.05, self.points.shape)

    def solve(self, free, factors=(), scale=1.0, iterations=30, ground=None, progress=bundle.START):
        poses = [SE3(T.rotation, T.translation * scale) for T in self.start_poses]
        n = len(factors)
        return bundle.adjust(
            K,
            np.array([T.rotation for T in poses]),
            np.array([T.translation for T in poses]),
            np.array(free),
            self.start_points * scale,
            np.searchsorted(self.obs_point, np.arange(len(self.points) + 1)),
            self.obs_point,
            self.obs_frame,
            self.obs_xy,
            np.ones(len(self.obs_xy)),
            relative_pose.Factors(
                np.array([a for a, _ in factors], np.int64),
                np.array([b for _, b in factors], np.int64),
                np.array([(self.truth[a] @ self.truth[b].inverse()).rotation for a, b in factors]).reshape(n, 3, 3),
                np.array([(self.truth[a] @ self.truth[b].inverse()).translation for a, b in factors]).reshape(n, 3),
                np.tile(np.diag([1e6, 1e4, 1e4, 1e4, 1e4, 1e4]), (n, 1, 1)),
            ),
            ground or floor.no_floor(),
            iterations,
            0.4,
            progress,
        )


def test_recovers_poses_points_and_names_the_outliers():
    problem = Problem()
    R, t, points, squared, sigma, steps, _ = problem.solve([-1, -1, 0, 1, 2, 3])
    for f, T in enumerate(problem.truth):
        assert np.abs(t[f] - T.translation).max() < 0.012
        assert T.rotation_angle_to(SE3(R[f], t[f])) < 0.002
        assert np.abs(R[f] @ R[f].T - np.eye(3)).max() < 1e-14
    assert np.median(np.linalg.norm(points - problem.points, axis=1)) < 0.05
    assert 0.4 < sigma < 1.0
    assert 2 <= steps <= 30
    assert 0.03 < (squared > (4.6851 * sigma) ** 2).mean() < 0.07


def test_fixed_frames_stay_bit_for_bit():
    problem = Problem()
    R, t, *_ = problem.solve([-1, -1, 0, 1, 2, 3])
    for f in (0, 1):
        assert (t[f] == problem.start_poses[f].translation).all()
    assert (t[2] != problem.start_poses[2].translation).all()


def test_factors_hold_the_metric_scale():
    problem = Problem(outliers=0.0)
    true = np.linalg.norm(problem.truth[5].inverse().translation)

    def length(factors):
        R, t, *_ = problem.solve([-1, 0, 1, 2, 3, 4], factors, scale=1.08, iterations=60)
        return np.linalg.norm(SE3(R[5], t[5]).inverse().translation)

    assert abs(length([]) / true - 1) > 0.03
    assert length([(k, k + 1) for k in range(5)]) == pytest.approx(true, rel=0.003)


def test_work_is_capped_whatever_the_input():
    problem = Problem()
    problem.obs_xy = np.random.default_rng(0).uniform(0, 640, problem.obs_xy.shape)
    R, t, points, *_, steps, _ = problem.solve([-1, -1, 0, 1, 2, 3], iterations=7)
    assert steps <= 7
    assert np.isfinite(t).all()
    assert np.isfinite(R).all()


@pytest.mark.data
def test_real_reconstruction_returns_to_its_residual():
    folder = DATA / "ba/crane_mast"
    if not folder.exists():
        pytest.skip(f"{folder} is absent (set VSX_DATA)")
    f, cx, cy = (float(v) for v in read_colmap(folder / "cameras.txt")[0].split()[4:7])
    images = read_colmap(folder / "images.txt")
    poses, index = [], {}
    for line in images[::2]:
        fields = line.split()
        qw, qx, qy, qz, *t = (float(v) for v in fields[1:8])
        index[fields[0]] = len(poses)
        poses.append(SE3.from_quaternion(np.array(t), (qx, qy, qz, qw)))
    uv = {k: np.array(images[2 * i + 1].split(), float).reshape(-1, 3)[:, :2] for k, i in index.items()}
    points, rows = [], []
    for line in read_colmap(folder / "points3D.txt"):
        fields = line.split()
        points.append([float(v) for v in fields[1:4]])
        track = sorted({index[k]: (k, int(j)) for k, j in zip(fields[8::2], fields[9::2])}.items())
        rows += [(len(points) - 1, frame, *uv[k][j]) for frame, (k, j) in track]
    table, points = np.array(rows), np.array(points)
    obs_point, obs_frame = table[:, 0].astype(int), table[:, 1].astype(int)

    def solve(poses, points, iterations):
        return bundle.adjust(
            np.array([f, f, cx, cy]),
            np.array([T.rotation for T in poses]),
            np.array([T.translation for T in poses]),
            np.arange(-1, len(poses) - 1),
            points,
            np.searchsorted(obs_point, np.arange(len(points) + 1)),
            obs_point,
            obs_frame,
            np.ascontiguousarray(table[:, 2:]),
            np.ones(len(table)),
            relative_pose.no_factors(),
            floor.no_floor(),
            iterations,
            0.2,
            bundle.START,
        )

    rng = np.random.default_rng(0)
    reference = np.sqrt(np.median(solve(poses, points, 40)[3]))
    size = np.linalg.norm(points - points.mean(axis=0), axis=1).mean()
    disturbed = [T if k == 0 else SE3.exp(rng.normal(0, 0.003, 6)) @ T for k, T in enumerate(poses)]
    noisy = points + rng.normal(0, 0.003 * size, points.shape)
    before = np.sqrt(np.median(solve(disturbed, noisy, 0)[3]))
    after = np.sqrt(np.median(solve(disturbed, noisy, 60)[3]))
    assert before > 2 * reference
    assert after == pytest.approx(reference, rel=0.03)


def read_colmap(path):
    return [line for line in path.read_text().splitlines() if not line.startswith("#")]

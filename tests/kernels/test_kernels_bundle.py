"""Bundle adjustment: derivatives, recovery with outliers, metric scale by factors, third-party problems."""

import os
from pathlib import Path

import bundle_files
import numpy as np
import pytest

from vsx_ros.geometry.se3 import SE3
from vsx_ros.kernels.slam import bundle, schur
from vsx_ros.kernels.slam import factors as ties

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
            return ties.relative_residual(
                a.rotation, a.translation, b.rotation, b.translation, Z.rotation, Z.translation
            )

        Ja, Jb = ties.relative_jacobians(residual(a, b), Z.rotation, Z.translation)
        h = 1e-6
        for k in range(6):
            step = SE3.exp(h * np.eye(6)[k])
            assert (residual(step @ a, b) - residual(a, b)) / h == pytest.approx(Ja[:, k], abs=2e-3)
            assert (residual(a, step @ b) - residual(a, b)) / h == pytest.approx(Jb[:, k], abs=2e-3)


def test_logarithm_is_se3s():
    rng = np.random.default_rng(1)
    for scale in (1e-9, 1e-4, 0.5, 1.0):
        T = random_pose(rng, scale)
        assert ties.log_se3(T.rotation, T.translation) == pytest.approx(T.log(), rel=1e-7, abs=1e-12)


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

    @property
    def observed(self):
        start = np.searchsorted(self.obs_point, np.arange(len(self.points) + 1))
        return schur.BundleObservations(start, self.obs_point, self.obs_frame, self.obs_xy, np.ones(len(self.obs_xy)))

    def solve(self, free, factors=(), scale=1.0, iterations=30, ground=None, progress=bundle.START):
        poses = [SE3(T.rotation, T.translation * scale) for T in self.start_poses]
        n = len(factors)
        return bundle.adjust(
            K,
            np.array([T.rotation for T in poses]),
            np.array([T.translation for T in poses]),
            np.array(free),
            self.start_points * scale,
            self.observed,
            ties.Factors(
                np.array([a for a, _ in factors], np.int64),
                np.array([b for _, b in factors], np.int64),
                np.array([(self.truth[a] @ self.truth[b].inverse()).rotation for a, b in factors]).reshape(n, 3, 3),
                np.array([(self.truth[a] @ self.truth[b].inverse()).translation for a, b in factors]).reshape(n, 3),
                np.tile(np.diag([1e6, 1e4, 1e4, 1e4, 1e4, 1e4]), (n, 1, 1)),
            ),
            ground or ties.no_floor(),
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


def test_gradients_of_poses_and_points():
    """What the linearisation calls downhill is minus the derivative of the cost."""
    problem, sigma, h = Problem(), 2.0, 1e-6
    R, t = (np.array([getattr(T, name) for T in problem.start_poses]) for name in ("rotation", "translation"))
    points, n_obs = problem.start_points, len(problem.obs_xy)
    seen = problem.observed._replace(weight=np.random.default_rng(0).choice([1.0, 0.5, 0.25], n_obs))
    nothing = ties.no_factors(), ties.no_floor()

    def estimate(R, t, points):
        now = bundle.Estimate(R, t, points, np.zeros((n_obs, 2)), np.empty(n_obs))
        bundle.fill_residuals(K, now, seen)
        return now

    def cost(R, t, points):
        return bundle.cost_of(estimate(R, t, points), sigma, *nothing)

    m = len(points)
    linear = schur.room_for(6, m, n_obs)
    bundle.linearise(K, estimate(R, t, points), np.arange(6), seen, sigma, linear)
    g, gp = linear.g, linear.gp
    for f in (0, 5):
        for k in range(6):
            ends = []
            for sign in (1.0, -1.0):
                T = SE3.exp(sign * h * np.eye(6)[k]) @ problem.start_poses[f]
                there = R.copy(), t.copy()
                there[0][f], there[1][f] = T.rotation, T.translation
                ends.append(cost(*there, points))
            assert (ends[1] - ends[0]) / (2 * h) == pytest.approx(g[f, k], rel=1e-4, abs=1e-6 * np.abs(g[f]).max())
    for p in (0, m // 2):
        for k in range(3):
            step = np.zeros_like(points)
            step[p, k] = h
            numeric = (cost(R, t, points - step) - cost(R, t, points + step)) / (2 * h)
            assert numeric == pytest.approx(gp[p, k], rel=1e-4, abs=1e-6 * np.abs(gp[p]).max())


@pytest.mark.compiled
def test_slices_go_where_one_piece_goes():
    problem, free = Problem(), [-1, -1, 0, 1, 2, 3]
    whole = problem.solve(free, iterations=6)
    progress = bundle.START
    for _ in range(6):
        R, t, points, *_, progress = problem.solve(free, iterations=1, progress=progress)
        problem.start_poses = [SE3(a, b) for a, b in zip(R, t)]
        problem.start_points = points
    assert t == pytest.approx(whole[1], abs=1e-10)
    assert points == pytest.approx(whole[2], abs=1e-8)
    assert progress == pytest.approx(whole[-1])


def test_an_adjustment_at_its_end_stays_there():
    problem, free = Problem(), [-1, -1, 0, 1, 2, 3]
    *_, progress = problem.solve(free, iterations=100)
    assert progress.done
    *_, steps, after = problem.solve(free, iterations=5, progress=progress)
    assert steps == 0
    assert after == progress


def test_third_party_cameras_return_to_their_residual():
    """Three cameras, nearly determined: whatever the start the residuals vanish but for outliers."""
    given = bundle_files.read_bal(Path(__file__).parents[1] / "third_party/dubrovnik-3-7-pre.txt")
    assert given.residual_px(0, 0.05) > 5.0
    reference = given.residual_px(60, 0.05)
    disturbed = given.disturbed(0.01, 0.01, np.random.default_rng(0))
    assert disturbed.residual_px(0, 0.05) > 10.0
    assert disturbed.residual_px(60, 0.05) == pytest.approx(reference, abs=1e-3)
    assert reference < 0.01


@pytest.mark.compiled
@pytest.mark.data
def test_real_reconstruction_returns_to_its_residual():
    folder = DATA / "ba/crane_mast"
    if not folder.exists():
        pytest.skip(f"{folder} is absent (set VSX_DATA)")
    given = bundle_files.read_colmap(folder)
    reference = given.residual_px(60, 0.2)
    assert 0.8 < reference < given.residual_px(0, 0.2) < 1.0
    disturbed = given.disturbed(0.003, 0.003, np.random.default_rng(0))
    assert disturbed.residual_px(0, 0.2) > 5.0
    assert disturbed.residual_px(60, 0.2) == pytest.approx(reference, rel=0.02)

"""How well and how fast bundle adjustment works: ``PYTHONPATH=src:hw python benchmarks/bundle_adjustment.py [section
...]``.

Sections: peer, files, building (all by default). Everything except the milliseconds repeats exactly. The peer
(pycolmap's adjuster, which is Ceres) is measured in the same run if ``pip install pycolmap`` provides it, else skipped
with a note. files needs the recordings in $VSX_DATA. Times are processor time of this process on one thread; in the
peer section, medians over the problems of the median of three runs.
"""

import argparse
import functools
import importlib.util
import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from bundle_problems import CAMERA, MOUNT, K, Problem, building, driven_map, ring

from vsx_ros.config.maps import OdometryNoiseConfig
from vsx_ros.geometry.se3 import SE3
from vsx_ros.kernels.slam import bundle
from vsx_ros.kernels.slam.factors import no_factors, no_floor
from vsx_ros.kernels.slam.schur import BundleObservations
from vsx_ros.slam import bundle_adjustment
from vsx_ros.slam.bundle_adjustment import BundleAdjuster
from vsx_ros.slam.map import Map

sys.path.append(str(Path(__file__).parents[1] / "tests"))
SEEDS, RUNS = 7, 3
# Ours stops at the first gain below 1e-4 of the cost; with this tolerance so does Ceres. Ceres has no Tukey loss.
# COLMAP's own scale for Cauchy's loss is 1 px. Cauchy at 2.385 of our residual scale (0.9 px) is as efficient on
# Gaussian noise as Tukey at 4.685. A narrow loss has a lower median residual but a larger error. So compare residuals
# only with the same loss: without gross outliers, by least squares.
TOLERANCE = 1e-4
PEER_PX = (1.0, 2.1)
# With this robust scale, Tukey's loss equals least squares to a part in 1e6.
PLAIN_PX = 1e4


class Solved(NamedTuple):
    """A solver's result. solve_ms: without preparation; build_ms: preparation of the solver's data."""

    solve_ms: float
    build_ms: float
    steps: int
    poses: list[SE3]
    points: np.ndarray


def residual_px(problem: Problem, poses: list[SE3], points: np.ndarray) -> float:
    """Median length of the residuals; all observations have equal weight."""
    R, t = np.array([T.rotation for T in poses])[problem.frame], np.array([T.translation for T in poses])[problem.frame]
    cam = np.einsum("oij,oj->oi", R, points[problem.point]) + t
    return float(np.median(np.linalg.norm(cam[:, :2] / cam[:, 2:] * K[:2] + K[2:] - problem.xy, axis=1)))


def ours(problem: Problem, sigma_min_px: float = bundle_adjustment.SIGMA_MIN_PX) -> Solved:
    R, t = (np.array([getattr(T, name) for T in problem.poses]) for name in ("rotation", "translation"))
    start = np.searchsorted(problem.point, np.arange(len(problem.points) + 1))
    free = np.maximum(np.arange(len(R)) - 2, -1)
    seen = BundleObservations(start, problem.point, problem.frame, problem.xy, np.ones(len(problem.xy)))
    begun = time.process_time()
    solution = bundle.adjust(
        K, R, t, free, problem.points, seen, no_factors(), no_floor(), 50, sigma_min_px, bundle.START
    )
    seconds = time.process_time() - begun
    return Solved(1e3 * seconds, 0.0, solution[5], [SE3(a, b) for a, b in zip(*solution[:2])], solution[2])


def pycolmaps(problem: Problem, cauchy_px: float | None) -> Solved:
    """Ceres with a Cauchy loss or none, known intrinsics and two fixed poses."""
    import pycolmap

    begun = time.process_time()
    model, config = pycolmap.Reconstruction(), pycolmap.BundleAdjustmentConfig()
    camera = pycolmap.Camera(model="PINHOLE", width=640, height=480, params=K, camera_id=1)
    model.add_camera_with_trivial_rig(camera)
    index = np.empty(len(problem.xy), int)
    for k, T in enumerate(problem.poses):
        mine = np.flatnonzero(problem.frame == k)
        index[mine] = np.arange(len(mine))
        image = pycolmap.Image(f"{k}.png", problem.xy[mine], 1, k + 1)
        pose = pycolmap.Rigid3d(pycolmap.Rotation3d(np.array(T.rotation)), np.array(T.translation))
        model.add_image_with_trivial_frame(image, pose)
        config.add_image(k + 1)
    start = np.searchsorted(problem.point, np.arange(len(problem.points) + 1))
    images, index = (problem.frame + 1).tolist(), index.tolist()
    for p, point in enumerate(problem.points):
        elements = [pycolmap.TrackElement(images[o], index[o]) for o in range(start[p], start[p + 1])]
        model.add_point3D(point, pycolmap.Track(elements))
    config.set_constant_cam_intrinsics(1)
    for k in (1, 2):
        config.set_constant_rig_from_world_pose(k)
    options = pycolmap.BundleAdjustmentOptions(print_summary=False)
    options.refine_focal_length = options.refine_extra_params = False
    if cauchy_px is None:
        options.ceres.loss_function_type = pycolmap.LossFunctionType.TRIVIAL
    else:
        options.ceres.loss_function_type = pycolmap.LossFunctionType.CAUCHY
        options.ceres.loss_function_scale = cauchy_px
    options.ceres.solver_options.num_threads = 1
    options.ceres.solver_options.function_tolerance = TOLERANCE
    built = time.process_time()
    summary = pycolmap.create_default_bundle_adjuster(options, config, model).solve()
    solved = time.process_time()
    poses = [model.images[k + 1].cam_from_world() for k in range(len(problem.poses))]
    return Solved(
        1e3 * (solved - built),
        1e3 * (built - begun),
        summary.ceres_summary.num_successful_steps,
        [SE3(T.rotation.matrix(), T.translation) for T in poses],
        np.array([model.points3D[p + 1].xyz for p in range(len(problem.points))]),
    )


def section_peer() -> None:
    """The same problems, solved by both: times, steps, residual, error."""
    robust: dict[str, Callable[[Problem], Solved]] = {"ours": ours}
    plain: dict[str, Callable[[Problem], Solved]] = {"ours": functools.partial(ours, sigma_min_px=PLAIN_PX)}
    if importlib.util.find_spec("pycolmap") is None:
        print("pycolmap is not installed: its rows are left out")
    else:
        robust |= {f"pycolmap, Cauchy {px} px": functools.partial(pycolmaps, cauchy_px=px) for px in PEER_PX}
        plain["pycolmap"] = functools.partial(pycolmaps, cauchy_px=None)
    for name, size in (("local", (10, 1110, 5550)), ("global", (100, 8090, 59600))):
        print(f"{name}, 3 % gross outliers, each with its robust loss:")
        compare(robust, [ring(*size, seed) for seed in range(SEEDS)])
        print(f"{name}, no gross outliers, least squares:")
        compare(plain, [ring(*size, seed, 0.0) for seed in range(SEEDS)])


def compare(solvers: dict[str, Callable[[Problem], Solved]], problems: list[Problem]) -> None:
    """One line per solver; the first solver is the reference."""
    counts = [int(np.median([len(part) for part in parts])) for parts in zip(*[problem[1:3] for problem in problems])]
    print(f"  {len(problems[0].poses)} keyframes, about {counts[0]} points, {counts[1]} observations; {SEEDS} problems")
    reference = np.zeros(2)
    for who, solver in solvers.items():
        solver(problems[0])
        runs = [[solver(problem) for _ in range(RUNS)] for problem in problems]
        solve = np.median([[run.solve_ms for run in each] for each in runs], axis=1)
        whole = np.median([[run.solve_ms + run.build_ms for run in each] for each in runs], axis=1)
        reference = reference if reference.any() else solve
        last = [(problem, each[-1]) for problem, each in zip(problems, runs)]
        px = [residual_px(problem, run.poses, run.points) for problem, run in last]
        mm = [1e3 * problem.pose_error_m(run.poses) for problem, run in last]
        ratio = solve / reference
        print(
            f"  {who:23s} {np.median(solve):6.1f} ms ({np.median(ratio):.1f} x ours; {ratio.min():.1f} .. "
            f"{ratio.max():.1f}), with building {np.median(whole):6.1f} ms, "
            f"{np.median([run.steps for _, run in last]):.0f} steps, {np.median(px):.4f} px, {np.median(mm):.2f} mm"
        )


def section_files() -> None:
    """Disturbed third-party reconstructions: residual before and after."""
    import bundle_files

    tests = Path(__file__).parents[1] / "tests"
    folder = Path(os.environ.get("VSX_DATA", tests.parent / "../shared/data")) / "ba/crane_mast"
    files = [("dubrovnik-3-7", bundle_files.read_bal(tests / "third_party/dubrovnik-3-7-pre.txt"), 0.05)]
    if folder.exists():
        files.append(("crane_mast", bundle_files.read_colmap(folder), 0.2))
    else:
        print(f"{folder} is absent (set VSX_DATA): left out")
    for name, given, sigma_min_px in files:
        print(f"{name}: {len(given.poses)} cameras, {len(given.points)} points, {len(given.xy)} observations")
        reference = given.residual_px(60, sigma_min_px)
        print(f"  median residual as given {given.residual_px(0, sigma_min_px):.3f} px, adjusted {reference:.4f} px")
        for amount in (0.003, 0.01):
            before, after = [], []
            for seed in range(10):
                disturbed = given.disturbed(amount, amount, np.random.default_rng(seed))
                before.append(disturbed.residual_px(0, sigma_min_px))
                after.append(disturbed.residual_px(60, sigma_min_px))
            print(
                f"  disturbed by {1e3 * amount:.0f} mrad and {100 * amount:.1f} % of the scene, 10 times: "
                f"{np.median(before):.1f} px, back to {min(after):.4f} .. {max(after):.4f} px"
            )


def section_building() -> None:
    """The whole map of a drive around a building: total time, the longest part that cannot be interrupted, and the same
    after the last eight keyframes were moved as a local adjustment leaves them."""
    for frames, points in ((100, 12000), (300, 28000), (600, 40000)):
        problem = building(frames, points, 520)
        track = np.bincount(problem.point)
        print(
            f"{frames} keyframes, {len(problem.points)} points, {len(problem.xy)} observations, tracks of "
            f"{track.mean():.1f} (at most {track.max()})"
        )
        world, adjuster = driven_map(problem), BundleAdjuster(CAMERA, MOUNT, OdometryNoiseConfig())
        for what in ("from the start", "eight keyframes later"):
            before = problem.pose_error_m([k.T_world_cam.inverse() for k in world.keyframes])
            whole, longest, slices = timed_adjustment(adjuster, world, frames)
            after = problem.pose_error_m([k.T_world_cam.inverse() for k in world.keyframes])
            print(
                f"  {what}: {whole:.0f} ms in {slices} slices, the longest {longest:.0f} ms; "
                f"{1e3 * before:.1f} mm to {1e3 * after:.1f} mm"
            )
            rng = np.random.default_rng(1)
            for k in range(frames - 8, frames):
                moved = world.keyframes[k].T_world_cam @ SE3.exp(rng.normal(0, 1, 6) * 0.002)
                world.move_keyframe(k, moved)


def timed_adjustment(adjuster: BundleAdjuster, world: Map, frames: int) -> tuple[float, float, int]:
    """(total ms, longest ms between two moments at which it could have stopped, slices)."""
    begun = time.process_time()
    moments = [begun]

    def asked() -> bool:
        moments.append(time.process_time())
        return False

    adjuster.adjust(world, list(range(frames)), 10, asked)
    moments.append(time.process_time())
    return 1e3 * (moments[-1] - begun), 1e3 * float(np.diff(moments).max()), len(moments) - 2


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sections", nargs="*", metavar="SECTION", help="peer, files, building")
    todo = {"peer": section_peer, "files": section_files, "building": section_building}
    args = parser.parse_args()
    unknown = set(args.sections) - set(todo)
    if unknown:
        parser.error(f"there is no section {', '.join(sorted(unknown))}")
    ours(ring(4, 50, 150))
    for name in args.sections or todo:
        print(f"\n== {name} (load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores)", flush=True)
        todo[name]()
    sys.stdout.flush()


if __name__ == "__main__":
    main()

"""Figures 4 and 5 of the paper: what the dense planes make of the keyframes of a short exploration, and of its map."""

import dataclasses
from typing import Any

import numpy as np

from vsx_ros.arrays import FloatArray, IntArray
from vsx_ros.config import Config
from vsx_ros.dense.densify import DenseMap, Densifier
from vsx_ros.dense.planes import PlaneKind
from vsx_ros.errors import InputError
from vsx_ros.evaluation.figure4 import section as surface_section
from vsx_ros.evaluation.figure5 import Figure5
from vsx_ros.evaluation.figure5 import section as maps_section
from vsx_ros.evaluation.obstacles import seen_faces
from vsx_ros.evaluation.page import Section
from vsx_ros.experiments.exploration import run_whole
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.geometry.se3 import SE3
from vsx_ros.runs.lockstep import FastRun
from vsx_ros.runs.world import open_world
from vsx_ros.sim.truth import ground_truth_grid

_ALL_CELLS = 10**6
_ENOUGH_POINTS = 8
_NEAR_M, _FAR_M = 0.3, 5.0
_SQUARE = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])


def figure5(world: str, seed: int, limit_s: float) -> tuple[Section, dict[str, Any]]:
    """One exploration with dense mapping, its maps beside the truth, and their numbers."""
    run, facts = _explored(world, seed, limit_s)
    system, ground = run.system, Config().ground_map
    snapshot, true_poses = system.slam.snapshot(), {pose.stamp_ns: pose.T for pose in run.truth}
    truth = ground_truth_grid(
        run.world, ground.resolution_m, ground.obstacle_min_height_m, ground.obstacle_max_height_m
    )
    figure = Figure5(
        truth,
        seen_faces(truth, [true_poses[stamp] for stamp in snapshot.keyframe_stamps_ns.tolist()]),
        [("sparse points", system.ground.grid(snapshot, False)), ("dense planes", system.ground.grid(snapshot))],
        run.world.start_pose,
        f"{facts} Faces count that three keyframes saw within 3.5 m.",
    )
    qualities = {name: dataclasses.asdict(quality) for name, quality in figure.qualities().items()}
    return maps_section(figure), {"facts": figure.facts, **qualities}


def figure4(world: str, seed: int, limit_s: float) -> tuple[Section, dict[str, Any]]:
    """One exploration, the planes and the surface of its keyframes in the one that shows most planes, and their
    numbers. Raises InputError when no plane was found."""
    run, facts = _explored(world, seed, limit_s)
    snapshot, camera, config = run.system.slam.snapshot(), run.robot.camera_given, Config().dense
    dense = Densifier(camera, run.robot.T_base_cam_given, config, seed).update(snapshot, _ALL_CELLS)
    of_point = np.full(len(snapshot.points_world), -1)
    for plane in dense.planes:
        of_point[plane.points] = plane.id
    on_planes = of_point[snapshot.obs_point] >= 0
    if not on_planes.any():
        raise InputError(f"{facts} No plane was found; give more --time, or another --seed")
    seen = np.stack([snapshot.obs_keyframe, of_point[snapshot.obs_point]])[:, on_planes]
    pairs, counts = np.unique(seen, axis=1, return_counts=True)
    keyframe = int(np.bincount(pairs[0, counts >= _ENOUGH_POINTS], minlength=1).argmax())
    of_kind = {kind.value: sum(plane.kind is kind for plane in dense.planes) for kind in PlaneKind}
    numbers = {
        "points": len(of_point), "points_on_planes": int((of_point >= 0).sum()), "planes": of_kind,
        "surface_m2": len(dense.cells.plane) * config.cell_m**2,
    }  # fmt: skip
    words = (
        f"{facts} {numbers['points_on_planes']} of {numbers['points']} points lie on {len(dense.planes)} planes, of "
        f"which, without the floor, {numbers['surface_m2']:.0f} m2 are surface. A colour is a plane; red is none."
    )
    shown = snapshot.obs_keyframe == keyframe
    cells, planes = _cells_before(camera, snapshot.T_world_cams[keyframe], dense, config.cell_m)
    points = of_point[snapshot.obs_point[shown]]
    section = surface_section(snapshot.images[keyframe], snapshot.obs_uv[shown], points, cells, planes, words)
    return section, {"facts": words, **numbers}


def _explored(world: str, seed: int, limit_s: float) -> tuple[FastRun, str]:
    """The run, and what it was in words."""
    run = FastRun(open_world(world, seed), seed, "fov", Config())
    reason = run_whole(run, limit_s)
    keyframes = len(run.system.slam.snapshot().keyframe_ids)
    return run, f"{world}, seed {seed}: {keyframes} keyframes, {run.robot.truth.path_length_m:.1f} m; {reason}."


def _cells_before(
    camera: PinholeCamera, T_world_cam: SE3, dense: DenseMap, size_m: float
) -> tuple[FloatArray, IntArray]:
    """(M, 4, 2) pixels of the corners of cells before a camera, the farthest first, and their planes (M,)."""
    corners = np.zeros((len(dense.cells.plane), 4, 3))
    for plane in dense.planes:
        mine = dense.cells.plane == plane.id
        coordinates = (dense.cells.cell[mine, None] + _SQUARE) * size_m
        corners[mine] = plane.points_at(coordinates.reshape(-1, 2)).reshape(-1, 4, 3)
    local = (T_world_cam.inverse() @ corners.reshape(-1, 3)).reshape(-1, 4, 3)
    near = np.flatnonzero((local[..., 2].min(axis=1) > _NEAR_M) & (local[..., 2].max(axis=1) < _FAR_M))
    near = near[np.argsort(-local[near, :, 2].mean(axis=1))]
    uv = camera.project(local[near].reshape(-1, 3)).reshape(-1, 4, 2)
    inside = ((uv > 0) & (uv < (camera.width, camera.height))).all(axis=(1, 2))
    return uv[inside], dense.cells.plane[near[inside]]

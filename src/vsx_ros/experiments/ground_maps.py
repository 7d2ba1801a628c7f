"""Figures 4 and 5 of the paper: the dense planes in a keyframe of a short exploration, and in its map."""

from collections.abc import Mapping
from typing import Any

import cv2
import numpy as np

from vsx_ros.arrays import BoolArray, FloatArray, GrayImage, IntArray, Pixels
from vsx_ros.config import Config
from vsx_ros.dense.densify import DenseMap, Densifier
from vsx_ros.dense.planes import PlaneKind
from vsx_ros.errors import InputError
from vsx_ros.evaluation.map_quality import map_on_truth_picture, obstacle_quality, seen_faces, truth_picture
from vsx_ros.evaluation.page import Section, figures, paragraph, table
from vsx_ros.evaluation.sheet import png_url
from vsx_ros.experiments.exploration import run_whole
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3
from vsx_ros.occupancy.grid import OccupancyGrid
from vsx_ros.runs.lockstep import FastRun
from vsx_ros.runs.world import open_world
from vsx_ros.sim.truth import ground_truth_grid

_ALL_CELLS = 10**6  # an unlimited budget
_ENOUGH_POINTS = 8  # of a plane in a keyframe, to count it when the keyframe is chosen
_NEAR_M, _FAR_M = 0.3, 5.0  # from the camera; only cells between are drawn
_SQUARE = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])  # corners of a cell
_ROWS = (
    ("f1", "F1 of obstacles at 10 cm", ".3f"),
    ("precision", "occupied cells that are obstacles", ".3f"),
    ("recall", "seen faces that are there (the rest are gaps in the boundary)", ".3f"),
    ("surface_free", "seen faces called free", ".4f"),
    ("free_inside", "free cells over 10 cm inside an obstacle", ".4f"),
    ("gaps_free", "what is known of gaps 0.4 to 0.8 m wide that is free", ".3f"),
    ("phantom_m2", "phantom obstacles on free floor [m2]", ".4f"),
)


def figure4(world: str, seed: int, limit_s: float) -> tuple[Section, dict[str, Any]]:
    """Planes and surface of one exploration, drawn in the keyframe that shows most planes, and their numbers. Raises
    InputError when no plane was found."""
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
    surface = _cells_before(camera, snapshot.T_world_cams[keyframe], dense, config.cell_m)
    points = of_point[snapshot.obs_point[shown]]
    pictures = _plane_pictures(snapshot.images[keyframe], snapshot.obs_uv[shown], points, *surface)
    body = paragraph(words) + figures(pictures)
    return Section("Figure 4: from points to planes to surface", body), {"facts": words, **numbers}


def _cells_before(
    camera: PinholeCamera, T_world_cam: SE3, dense: DenseMap, size_m: float
) -> tuple[FloatArray, IntArray]:
    """(M, 4, 2) pixels of the corners of the cells in front of a camera, farthest first, and their planes (M,)."""
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


def _plane_pictures(
    image: GrayImage, points: Pixels, planes: IntArray, cells: FloatArray, cell_planes: IntArray
) -> list[tuple[str, str]]:
    """points (N, 2): pixels of the map points found in the image. planes (N,): plane of each, -1 for none. cells (M, 4,
    2): corners of the surface cells, farthest first. cell_planes (M,): their planes."""
    of_plane = {plane: points[planes == plane] for plane in np.unique(planes).tolist()}
    hulls = [
        _area(plane, cv2.convexHull(own.astype(np.float32))[:, 0], 0.35)
        for plane, own in of_plane.items()
        if plane >= 0 and len(own) > 2
    ]
    areas = [_area(plane, corners, 0.75) for plane, corners in zip(cell_planes.tolist(), cells)]
    return [
        ("(a) a keyframe", _over(image, [])),
        ("(b) map points found in it", _over(image, [_dots(-1, points)])),
        ("(c) planes by J-linkage", _over(image, hulls + [_dots(*item) for item in of_plane.items()])),
        ("(d) what of them is surface, by points and photo-consistency", _over(image, areas)),
    ]


def _over(image: GrayImage, parts: list[str]) -> str:
    """Drawings over the image, which is paler if there are any."""
    height, width = image.shape
    picture = f'<image width="{width}" height="{height}" opacity="{0.6 if parts else 1}" href="{png_url(image)}"/>'
    return f'<svg viewBox="0 0 {width} {height}" role="img">{picture}{"".join(parts)}</svg>'


def _area(plane: int, corners: FloatArray, opacity: float) -> str:
    points = " ".join(f"{u:.1f},{v:.1f}" for u, v in corners)
    return f'<polygon points="{points}" fill="{_colour(plane)}" fill-opacity="{opacity}"/>'


def _dots(plane: int, pixels: Pixels) -> str:
    path = "".join(f"M{u:.1f},{v:.1f}h0" for u, v in pixels)
    return f'<path class="dots" style="stroke:{_colour(plane)};opacity:1" d="{path}"/>'


def _colour(plane: int) -> str:
    """A different colour for each plane, red for none."""
    return f"hsl({40 + 101 * plane % 280} 75% 45%)" if plane >= 0 else "#c83232"


def figure5(world: str, seed: int, limit_s: float) -> tuple[Section, dict[str, Any]]:
    """The maps of one exploration with dense mapping beside the truth, and their numbers."""
    run, facts = _explored(world, seed, limit_s)
    ground, snapshot = run.system.ground, run.system.slam.snapshot()
    true_poses, config = {pose.stamp_ns: pose.T for pose in run.truth}, Config().ground_map
    band = config.obstacle_min_height_m, config.obstacle_max_height_m
    truth = ground_truth_grid(run.world, config.resolution_m, *band)
    faces = seen_faces(truth, [true_poses[stamp] for stamp in snapshot.keyframe_stamps_ns.tolist()])
    grids = {"sparse points": ground.grid(snapshot, False), "dense planes": ground.grid(snapshot)}
    facts += " Faces count that three keyframes saw within 3.5 m."
    return maps_beside_truth(truth, faces, grids, run.world.start_pose, facts)


def maps_beside_truth(
    truth: OccupancyGrid, faces: BoolArray, grids: Mapping[str, OccupancyGrid], T_truth_map: SE2, facts: str
) -> tuple[Section, dict[str, Any]]:
    """Figure 5 and its numbers. faces (H, W): of ``seen_faces``. T_truth_map: true pose of the grids' origin. facts:
    the origin of the data, in words."""
    qualities = {name: obstacle_quality(grid, truth, faces, T_truth_map) for name, grid in grids.items()}
    numbers = {name: quality._asdict() for name, quality in qualities.items()}

    def shown(value: float | None, form: str) -> str:
        return "unknown" if value is None else format(value, form)

    rows = [[words, *(shown(of[key], form) for of in numbers.values())] for key, words, form in _ROWS]
    images = {"truth: faces that were seen": truth_picture(truth, faces)}
    images |= {name: map_on_truth_picture(grid, truth, faces, T_truth_map) for name, grid in grids.items()}
    pictures = [
        (name, f'<img width="{3 * image.shape[1]}" style="image-rendering:pixelated" alt="" src="{png_url(image)}">')
        for name, image in images.items()
    ]
    legend = "Black: obstacles found. Orange: faces seen but missing. Red: phantom obstacles. White: free."
    body = paragraph(facts) + figures(pictures) + paragraph(legend) + table(["", *grids], rows)
    return Section("Figure 5: ground map, sparse, dense, truth", body), {"facts": facts, **numbers}


def _explored(world: str, seed: int, limit_s: float) -> tuple[FastRun, str]:
    """The run, and its description in words."""
    run = FastRun(open_world(world, seed), seed, "fov", Config())
    reason = run_whole(run, limit_s)
    keyframes = len(run.system.slam.snapshot().keyframe_ids)
    return run, f"{world}, seed {seed}: {keyframes} keyframes, {run.robot.truth.path_length_m:.1f} m; {reason}."

"""Compile kernels once, on tiny arrays: at node start, never in a callback."""

import sys
from collections.abc import Callable

import numpy as np

from vsx_ros.kernels import geometry
from vsx_ros.kernels.dense import floor_contact, jlinkage, plane_choice, plane_fits, planes, surface_cells
from vsx_ros.kernels.dense.view_choice import Views
from vsx_ros.kernels.occupancy import basins, clearance, ground_cells, ground_map, visibility
from vsx_ros.kernels.planning import curves, flood, lattice, motions, pockets, reeds_shepp, shortcuts
from vsx_ros.kernels.sim import raycast_pixels, raycast_render
from vsx_ros.kernels.sim.raycast_cull import Scene, plane_forms
from vsx_ros.kernels.sim.raycast_shade import TILE
from vsx_ros.kernels.slam import bundle, epipolar, pose, pose_graph
from vsx_ros.kernels.slam.factors import Factors, no_floor
from vsx_ros.kernels.slam.schur import BundleObservations
from vsx_ros.kernels.vision import alignment, fast, search
from vsx_ros.kernels.vision.patches import Target


def warm_up(*groups: str) -> None:
    """Call the kernels of these ``GROUPS``, by default of all, with the argument types they are used with; seconds to a
    minute on a fresh checkout, then from disk."""
    for group in groups or GROUPS:
        for call in GROUPS[group]:
            call()


def _planes() -> None:
    world, one, seen = np.array([[2.0, 0.0, 0.3]]), np.zeros(1, np.int64), np.zeros(1, np.int32)
    _, rays, _ = planes.point_information(world, np.zeros((1, 3)), seen, seen, np.ones(1))
    points = planes.ObservedPoints(one, world, np.eye(3)[None].copy(), rays, np.ones(1), np.ones(1))
    wall, noise = np.array([-1.0, 0.0, 0.0, -2.0]), planes.Noise(0.01, 2.5, 0.1)
    planes.deviations(points, one, wall, noise)
    planes.residuals(points, one, wall)
    axes, boxes = plane_fits.in_plane_axes(wall[:3])[None], np.array([[np.zeros(2), np.ones(2)]])
    plane_choice.best_planes(points, wall[None], axes, boxes, 1, one, noise)
    plane_choice.beside(world, np.eye(3)[:2], np.zeros(2), np.ones(2))
    plane_fits.fit_plane(points, one, wall[:3], 0, 0.01, 5.0, 4)
    planes.first_accepted(points, one, one[None], np.ones((1, 1)), 2, 0.8, 0.1)
    jlinkage.agglomerate(planes.plane_preferences(points, wall[None], noise))


def _surfaces() -> None:
    eye, place, one = np.zeros((1, 3)), np.array([[0.0, 0.0, 1.0]]), np.zeros(1, np.int64)
    pixels, table = np.zeros((1, 64), np.uint8), np.array([[0, 8, 8]] * surface_cells.LEVELS)
    views = Views(one, np.eye(3)[None], eye, eye, one, pixels, table, np.array([8.0, 8.0, 3.5, 3.5]))
    frame = np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]])
    limits = (0.4, 6.0, 0.2, 0.999, 0.9, 0.9999, 0.01)
    surface_cells.judge_cells(views, frame, place, 0.06, limits, (1.0, 0.5), np.array([0.8, 1.2]))
    behind, votes, seen = np.array([0.15, 0.08]), np.zeros((2, 2), np.int64), np.zeros(1, np.int32)
    surface_cells.count_passing(frame, -0.5, eye, place, seen, seen, behind, np.zeros(2, np.int64), 0.08, votes)
    strips, contact = (0.025, 0.01, 0.05, 0.02, 0.08), (0.4, 6.0, 0.2, 5.0, 24)
    floor_contact.contact_steps(views, place, frame[2], frame[0], strips, np.zeros(5), contact)


def _ground_map() -> None:
    positions, headings = np.zeros((1, 3)), np.array([[1.0, 0.0]])
    points, one, seen = np.array([[1.0, 0.0, 0.3]]), np.zeros(1, np.int64), np.zeros(1, np.int32)
    parallax = ground_map.point_parallax(positions, points, seen, seen)
    heights, ranges = (0.06, 0.6, 0.45, 1.0, 0.01), (6.0, 0.001, 0.1, 0.025, 2.0)
    scans = ground_map.polar_scans(positions, headings, points, parallax, seen, seen, 8, heights, ranges)
    ground_map.bridge_gaps(scans.free, scans.begin, 2, 0.1)
    ground_cells.scan_corners(scans, points, seen)
    surfaces, lattice = ground_map.Surfaces(points, one, np.zeros(1)), ground_cells.Lattice(4, 4, 0.05, 0.0, 0.0)
    ground_map.meet_surfaces(scans, surfaces, np.ones(1, np.bool_), (0.04, 2.0, 0.05), (0.15, 6.0, 0.45))
    passed = ground_cells.cover_discs(np.zeros((1, 2)), np.zeros(1, np.int64), 0.2, lattice)
    ground_cells.newer_than(points, seen, seen, passed, lattice)
    ground_cells.count_free(scans, lattice)
    ground_cells.count_hits(points, seen, scans.hit, 3, lattice)
    ground_cells.height_range(points, seen, scans.over, 3, lattice)
    basins.flood_basins(np.ones((2, 2)), np.arange(4), 0.7)


def _tracking() -> None:
    camera = np.array([100.0, 100.0, 31.5, 31.5, *np.zeros(5), 10.0, 64.0, 64.0, *np.zeros(10), 10.0])
    target = _image()
    templates = np.zeros((1, 24, 24), np.uint8)
    eye, zero = np.eye(3), np.zeros(3)
    # Poses are read-only arrays, which numba treats as another type.
    eye.flags.writeable = zero.flags.writeable = False
    points = np.array([[0.0, 0.0, 1.0]])
    basis = np.array([[0.01, 0.0, 0.0, 0.01]])
    one = np.zeros(1, np.int64)
    geometry.unproject_pixels(camera, np.zeros((1, 2)))
    geometry.project_points(camera, np.zeros((1, 2)))
    geometry.ideal_pixels(camera, np.zeros((1, 2)), np.ones(1))
    geometry.project_rows(camera, eye, zero, points, one, 8.0)
    of_point, R_world_cam, centres = np.zeros((1, 5), np.int64), np.zeros((1, 3, 3)), np.zeros((1, 3))
    rows, level, uv, warp, chosen = search.predict(
        camera, eye, zero, points, one, of_point, one, basis, R_world_cam, centres, 8.0
    )
    warped, usable = search.warp_templates(templates, np.zeros((1, 2)), chosen, warp)
    bounds = np.array([[0.1, 1.0]])
    epipolar.search_rays(camera, eye, zero, np.zeros((1, 2)), basis, templates, bounds, target)
    small = np.zeros((30, 40), np.float32)
    alignment.align_small(small, small, 2)
    fast.fast_corners(np.zeros((96, 128), np.uint8), 10)
    found, uv = search.search(target, warped, usable, level, uv, 10.0, 2)
    pose.optimize_pose(camera, eye, zero, points, rows, uv, level, found, np.zeros(6), 1, 2, 0.4, 0.7)


def _mapping() -> None:
    K, no_shift = np.array([100.0, 100.0, 31.5, 31.5]), np.zeros((1, 3))
    pair, one = np.array([np.eye(3), np.eye(3)]), np.zeros(1, np.int64)
    way = np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0]])
    seen = BundleObservations(np.array([0, 2]), np.zeros(2, np.int64), np.array([0, 1]), np.zeros((2, 2)), np.ones(2))
    factors = Factors(one, one + 1, pair[:1], no_shift, np.eye(6)[None])
    free, points = np.array([-1, 0]), np.array([[0.0, 0.0, 1.0]])
    bundle.adjust(K, pair, way, free, points, seen, factors, no_floor(), 2, 0.4, bundle.START)


def _loops() -> None:
    pair, one = np.array([np.eye(3), np.eye(3)]), np.zeros(1, np.int64)
    to_each = np.eye(pose_graph.NODE_DOF)[None]
    edges = pose_graph.Edges(one, one + 1, pair[:1], np.zeros((1, 3)), np.ones(1), to_each)
    pose_graph.optimize_graph(pair, np.zeros((2, 3)), np.ones(2), np.array([True, False]), edges, False, 1)
    pose_graph.count_shared(one, one + 1, 1)


def _planning() -> None:
    blocked = np.ones((12, 12), np.bool_)
    blocked[1:-1, 1:-1] = False
    field = clearance.DistanceField(clearance.signed_distance(blocked, 4) * 0.1, 0.1, 0.0, 0.0)
    clearance.interpolate_many(field, np.full((1, 2), 0.5))
    clearance.gradient_many(field, np.full((1, 2), 0.5))
    clearance.least_on_curve(field, np.full((2, 5), 0.5), 1, 0.005)
    motions.arc_is_free(field, 0.5, 0.5, 0.0, 0.0, 0.1)
    start, goal = np.array([0.5, 0.5, 0.0]), np.array([0.7, 0.5, 0.0])
    curves.arc_table(0.5, 0.5, 0.0, 1.0, 0.1, 1, 2)
    nodes, knots = (np.ones((2, 10)), np.ones(2), np.ones(2), 2), (np.ones((2, 10)), np.ones(2), np.ones(2))
    curves.curve_table(start, 1.0, 1, np.ones(10), *nodes, *knots)
    pieces = np.zeros(1, np.int64), np.zeros(1), np.ones(1), np.ones(1, np.int64)
    curves.position_rows(*pieces, np.ones((4, 2, 10)), np.ones((4, 2)), *nodes[2:])
    remaining = clearance.wavefront(field.values >= 0.0, 5, 5) * 0.1
    table, arcs = motions.reeds_shepp_table(), motions.Lattice(24, 1, 0.1, 1000)
    table.flags.writeable = False
    search = lattice.lattice_search(field, start, 1.0, arcs, 1.5, goal, remaining, table)
    turns, lengths = lattice.lattice_way(*search[:3], search[4], search[3], goal, 1.0)
    lattice.reverse_run(lengths)
    shortcuts.way_cost(lengths, 0.1)
    pockets.best_exit(field, *search[:4], 1.0, 0.3, remaining, field)
    level, step = flood.flood(field, start, 1.0, arcs, 1.5)
    flood.flood_costs(level, step, 0.0, field, 0.1, 1.0, field.values >= 0.0, goal[None])
    shortcuts.shorten(field, start, turns, lengths, 1.0, 1.5, 0.1, np.uint64(1), 4)
    reeds_shepp.reeds_shepp_words(1.0, 1.0, 1.0)
    word = reeds_shepp.room_for(1)
    reeds_shepp.reeds_shepp_shortest(1.0, 1.0, 1.0, word)
    lattice.word_is_free(field, 0.5, 0.5, 0.0, word.turns[0], word.lengths[0], 1.0)


def _views() -> None:
    data, poses, places, bearings = np.zeros((4, 4), np.int8), np.zeros((1, 3)), np.zeros((1, 2)), np.zeros(8)
    data.flags.writeable = False
    grid = data, 0.1, 0.0, 0.0
    visibility.visible_landmarks(*grid, poses, places, 0.5, 0.5, 4.0)
    halves = visibility.count_half_looks(*grid, poses, 0.5, 4.0, 4)
    looks = visibility.Looks(halves, np.ones(3), np.ones((4, 4), np.bool_))
    visibility.unknown_area_by_bearing(data, looks, *grid[1:], places, bearings, 4.0, 1.0)


def _emulation() -> None:
    surfaces, places = np.ones((1, 5), np.float32), np.array([[0, 0, 0, 2, 2]], np.int32)
    tints, texels = np.ones((1, 4), np.float32), np.zeros(4, np.int32)
    corner, edges = np.array([[-1.0, -1.0, 2.0]]), 2.0 * np.eye(3)[None]
    scene = Scene(corner, edges[:, 0].copy(), edges[:, 1].copy(), surfaces, places, tints, texels, texels)
    forms, pool = plane_forms(scene, np.tile(np.eye(3), (1, 2, 1, 1)), np.zeros((1, 2, 3)))
    rays, picture = np.zeros((TILE + 3, TILE + 3), np.float32), np.zeros((TILE, TILE), np.float32)
    view = raycast_pixels.View(scene, forms, rays, rays, False)
    none = np.zeros((0, 0), np.float32)
    raycast_render.render_tile_rows(0, 1, view, pool, np.zeros((1, 1, 4)), picture, none, none.astype(np.int32))
    gains = np.float32(1.0), np.float32(0.0), np.float32(0.0)
    starts, response = np.zeros(TILE, np.int64), np.zeros(4096, np.uint8)
    raycast_pixels.expose(picture, picture, *gains, rays[0], starts, response, np.zeros((TILE, TILE), np.uint8))


def _image() -> Target:
    """A black image without corners."""
    sides = np.array([64, 32, 16, 8])
    table = np.stack([np.cumsum(sides**2) - sides**2, sides, sides, np.cumsum(sides + 1) - sides - 1], axis=1)
    pixels, row_table = np.zeros((sides**2).sum(), np.uint8), np.zeros((sides + 1).sum(), np.int64)
    return Target(pixels, table, np.zeros((0, 2), np.int32), row_table)


GROUPS: dict[str, tuple[Callable[[], None], ...]] = {
    "mapping": (_mapping,),
    "tracking": (_tracking,),
    "planning": (_planning,),
    "surfaces": (_planes, _surfaces),
    "loops": (_loops,),
    "emulation": (_emulation,),
    "ground": (_ground_map, _views),
}
"""By what uses the kernels. Groups share some; each compiles all that it needs."""


if __name__ == "__main__":
    for name in sys.argv[1:]:
        warm_up(name)
        sys.stdout.write(f"{name}\n")
        sys.stdout.flush()

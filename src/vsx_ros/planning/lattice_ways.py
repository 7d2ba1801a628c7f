"""Searches for a way of arcs and lines through the map: over a coarse lattice, and a fine one where that finds none.

A start or goal may lie in a pocket: a place so narrow that no arc of the coarse lattice fits. The way out of it is
searched first, over a fine lattice that covers only what is near."""

import functools
import math

import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import Float32Array, FloatArray, IntArray
from vsx_ros.geometry.se2 import SE2
from vsx_ros.kernels.occupancy.clearance import DistanceField
from vsx_ros.kernels.planning.lattice import lattice_search, lattice_way
from vsx_ros.kernels.planning.motions import Lattice, reeds_shepp_table
from vsx_ros.kernels.planning.pockets import best_exit
from vsx_ros.occupancy.distance import joined_distance
from vsx_ros.planning.coarse_path import ArcBounds, CoarsePath

OCTILE = 0.924  # A straight line is at least this share of the 8-connected path along it
_ARC_M = 0.27  # length of an arc of the lattice, if that gives 16 to 32 headings; about two cells
_CELL_M = 0.1  # of the lattice
# Most states of each search, to limit memory and time; fewer than the last number mean a pocket.
_COARSE_STATES, _BACK_STATES, _FINE_STATES, _FEW_STATES = 5_000_000, 40_000, 120_000, 200
_SOON_STATES, _SHUT_IN_STATES = 20_000, 2_000  # when a goal is looked at that is not found yet; fewer mean a dead end
_POCKET_M, _FINENESS = 4.0, (2, 4)  # how far around a pocket its lattice reaches; by how much that is finer, in turn


@functools.cache
def word_table() -> Float32Array:
    """The lengths of shortest words, which guide the search; computed once, as they are the same for every phi."""
    table = reeds_shepp_table()
    table.flags.writeable = False
    return table


def coarse_lattice(phi: float) -> Lattice:
    """Arcs of about 0.27 m."""
    headings = int(min(max(round(2.0 * math.pi / (phi * _ARC_M)), 16), 32))
    bins = max(1, math.ceil(1.6 * _CELL_M * phi * headings / (2.0 * math.pi)))
    return Lattice(headings, bins, _CELL_M, _COARSE_STATES)


def _finer(lattice: Lattice, times: int, most_states: int) -> Lattice:
    """The lattice with arcs, cells and bins of headings smaller by a factor."""
    return Lattice(times * lattice.headings, lattice.bins, lattice.cell_m / times, most_states)


def search(start: SE2, goal: SE2, bounds: ArcBounds, remaining: FloatArray) -> CoarsePath | None:
    """A path over a lattice; tries from the start, from the goal, and with arcs half as long. None if there is none.

    remaining (H, W): ``travel_distance`` from the goal."""
    way = _past_pockets(start, goal, bounds, remaining)
    if way is not None:
        return way
    coarse = coarse_lattice(bounds.phi)
    fine = _finer(coarse, 2, _FINE_STATES)  # for narrow places
    way, is_all = _tried(start, goal, bounds, remaining, coarse._replace(most_states=_SOON_STATES))
    # A dead end that no arcs lead into shows at once from the goal; from the start only when all the map is searched.
    few = coarse._replace(most_states=_SHUT_IN_STATES)
    if not is_all and (way is not None or not _is_shut_in(_about_turn(goal), _about_turn(start), bounds, few)):
        way = search_lattice(start, goal, bounds, remaining, coarse)
    if way is None and is_stuck(start, goal, bounds, coarse):
        way = search_lattice_back(start, goal, bounds, coarse._replace(most_states=_BACK_STATES))
    if way is None and not is_stuck(_about_turn(goal), _about_turn(start), bounds, fine):
        way = search_lattice(start, goal, bounds, remaining, fine)
        way = way or search_lattice_back(start, goal, bounds, fine)
    return way


def _past_pockets(start: SE2, goal: SE2, bounds: ArcBounds, remaining: FloatArray) -> CoarsePath | None:
    """The way out of the pocket of the start, over the coarse lattice, and into that of the goal; None without one."""
    coarse = coarse_lattice(bounds.phi)
    first = way_out_of_pocket(start, goal, bounds, remaining) if is_stuck(start, goal, bounds, coarse) else None
    last = None
    if is_stuck(_about_turn(goal), _about_turn(start), bounds, coarse):
        back = joined_distance(bounds.margin, (start.x, start.y))
        last = way_out_of_pocket(_about_turn(goal), _about_turn(start), bounds, back)
    if first is None and last is None:
        return None
    begin = start if first is None else first.arcs(start)[-1].end
    end = goal if last is None else _about_turn(last.arcs(_about_turn(goal))[-1].end)
    if last is not None:
        remaining = joined_distance(bounds.margin, (end.x, end.y))
    middle = search_lattice(begin, end, bounds, remaining, coarse)
    if middle is None:
        return None
    parts = [part for part in (first, middle, None if last is None else last.driven_back()) if part is not None]
    turns, lengths = (np.concatenate(column) for column in zip(*((part.turns, part.lengths) for part in parts)))
    return CoarsePath(turns, lengths, bounds.phi)


def way_out_of_pocket(pose: SE2, target: SE2, bounds: ArcBounds, remaining: FloatArray) -> CoarsePath | None:
    """The way out of a pocket, over fine lattices around it, to where the arcs of the coarse one are free; None when
    there is none. remaining (H, W): ``travel_distance`` from the target."""
    margin, phi, _ = bounds
    coarse = coarse_lattice(phi)
    rows, columns = _around(margin, pose)
    near, ahead = _part(margin, rows, columns), np.ascontiguousarray(remaining[rows, columns])
    arc_m = coarse.bins * 2.0 * math.pi / coarse.headings / phi
    for times in _FINENESS:
        lattice = _finer(coarse, times, _FINE_STATES)
        here = bounds._replace(margin=near)
        poses, parents, motions, step, _ = _searched(pose, target, here, ahead, lattice)
        winner = best_exit(margin, poses, parents, motions, step, phi, arc_m, ahead, near)
        if winner >= 0:
            turns, lengths = lattice_way(poses, parents, motions, winner, step, poses[winner], phi)
            return CoarsePath(turns, lengths, phi).joined()
    return None


def _around(field: DistanceField, pose: SE2) -> tuple[slice, slice]:
    """The rows and columns of a field near a pose."""
    i, j = field.cell(pose.x, pose.y)
    reach = math.ceil(_POCKET_M / field.resolution)
    return slice(max(0, i - reach), max(0, i + reach + 1)), slice(max(0, j - reach), max(0, j + reach + 1))


def _part(field: DistanceField, rows: slice, columns: slice) -> DistanceField:
    """Some rows and columns of a field."""
    x, y = field.origin_x + columns.start * field.resolution, field.origin_y + rows.start * field.resolution
    return DistanceField(np.ascontiguousarray(field.values[rows, columns]), field.resolution, x, y)


def search_lattice(
    start: SE2, goal: SE2, bounds: ArcBounds, remaining: FloatArray, lattice: Lattice
) -> CoarsePath | None:
    """The cheapest path over the lattice. A Reeds-Shepp word ends it exactly on the goal. None when there is none."""
    return _tried(start, goal, bounds, remaining, lattice)[0]


def _tried(
    start: SE2, goal: SE2, bounds: ArcBounds, remaining: FloatArray, lattice: Lattice
) -> tuple[CoarsePath | None, bool]:
    """As ``search_lattice``, and whether the lattice's number of states was enough."""
    poses, parents, motions, step, winner = _searched(start, goal, bounds, remaining, lattice)
    is_all = len(poses) < lattice.most_states
    if winner < 0:
        return None, is_all
    turns, lengths = lattice_way(poses, parents, motions, winner, step, goal.as_array(), bounds.phi)
    return CoarsePath(turns, lengths, bounds.phi), is_all


def search_lattice_back(start: SE2, goal: SE2, bounds: ArcBounds, lattice: Lattice) -> CoarsePath | None:
    """As ``search_lattice``, but from the goal: the word ends on the start. For starts without room for an arc."""
    remaining = joined_distance(bounds.margin, (start.x, start.y))
    way = search_lattice(_about_turn(goal), _about_turn(start), bounds, remaining, lattice)
    return None if way is None else way.driven_back()


def _about_turn(pose: SE2) -> SE2:
    """The pose turned by 180 degrees."""
    return SE2(pose.x, pose.y, pose.theta + math.pi)


def is_stuck(pose: SE2, target: SE2, bounds: ArcBounds, lattice: Lattice) -> bool:
    """Whether the arcs of a lattice reach only a few states near a pose, and not the target."""
    near = _part(bounds.margin, *_around(bounds.margin, pose))
    return _is_shut_in(pose, target, bounds._replace(margin=near), lattice._replace(most_states=_FEW_STATES))


def _is_shut_in(pose: SE2, target: SE2, bounds: ArcBounds, lattice: Lattice) -> bool:
    """Whether the arcs of a lattice reach fewer than its most states from a pose, and not the target."""
    poses, *_, winner = _searched(pose, target, bounds, np.zeros(bounds.margin.values.shape), lattice)
    return winner < 0 and len(poses) < lattice.most_states


def _searched(
    start: SE2, goal: SE2, bounds: ArcBounds, remaining: FloatArray, lattice: Lattice
) -> tuple[FloatArray, IntArray, NDArray[np.int8], float, int]:
    margin, phi, limit = bounds
    hopes = np.where(np.isfinite(remaining), OCTILE * remaining, 1e6)
    return lattice_search(margin, start.as_array(), phi, lattice, limit, goal.as_array(), hopes, word_table())

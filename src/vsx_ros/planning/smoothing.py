"""From a skeleton of arcs and lines to paths that the base can drive: with stops, and smooth as far as there is one."""

from __future__ import annotations

import math

from vsx_ros.geometry.se2 import SE2
from vsx_ros.planning import corridor_qp
from vsx_ros.planning.coarse_path import CoarsePath
from vsx_ros.planning.corridor import Corridor
from vsx_ros.planning.path import Path, certified
from vsx_ros.planning.pieces import Piece

_STRAIGHTS_M = (math.inf, 0.5)


def smoothed(coarse: CoarsePath, start: SE2, goal: SE2, phi_rad_m: float, corridor: Corridor) -> list[Path]:
    """The coarse path, with stops where its curvature jumps, and its smooth version as far as there is one."""
    paths = [certified(start, goal, coarse.pieces(start), "arcs and lines")]
    whole = _fitted(coarse, start, goal, phi_rad_m, corridor)
    if whole is not None:
        return [*paths, whole]
    pieces = _in_parts(coarse, start, phi_rad_m, corridor)
    return [*paths, certified(start, goal, pieces, "Bernstein coefficients; arcs and lines")]


def _in_parts(coarse: CoarsePath, start: SE2, phi_rad_m: float, corridor: Corridor) -> tuple[Piece, ...]:
    """A way that cannot be fitted as a whole, in two halves, and these again: the base stops in between.

    It is cut where it stops anyway, as long as there are such places.
    """
    pieces: tuple[Piece, ...] = ()
    at = start
    for part in coarse.parted():
        arcs = part.pieces(at)
        if len(arcs) > 1:  # one arc from rest to rest has nothing to smooth
            smooth = _fitted(part, at, arcs[-1].end, phi_rad_m, corridor)
            pieces += smooth.pieces if smooth is not None else _in_parts(part, at, phi_rad_m, corridor)
        else:
            pieces += arcs
        at = arcs[-1].end
    return pieces


def _fitted(coarse: CoarsePath, start: SE2, goal: SE2, phi_rad_m: float, corridor: Corridor) -> Path | None:
    """The smooth version of a way, with its long straight lines whole or cut."""
    for longest_straight_m in _STRAIGHTS_M:
        halved, cuts = coarse.halved(longest_straight_m)
        smooth = corridor_qp.smooth(halved, cuts, start, goal, phi_rad_m, corridor)
        if smooth is not None:
            return smooth
    return None

"""An emulated dock: which of its infrared beams fall on a base's receivers, and whether its contacts touch the base.

Frame of the dock: origin at the emitters, x out of the dock, y to its own left. All beams begin at the origin.

Sources: Yujin Robot, Kobuki "Docking Stations" and kobuki_dock_drive (three fields, each near and far, and which
receiver sees which); iRobot's own simulator create3_sim, standard_dock.urdf.xacro (angles and ranges of the home base)
and its issue 93 (what the receivers see). Angles and ranges of a Kobuki's fields are not published: assumed to fill the
2 m x 5 m that its documentation names; ``varied`` makes docks with other ones."""

import math
import random
from collections.abc import Sequence
from typing import NamedTuple

from vsx_hw.readings import DockBeam

REFLECTED = 0.5  # share of the range that is left after a wall: a quarter of the light
EDGE_RAD, EDGE_SHARE = math.radians(1.0), 0.03  # standard deviation of a beam's edge and range, from frame to frame
DROPOUT, GHOST = 0.05, 0.001  # share of the frames in which a receiver hears nothing, or one wrong beam

Segment = tuple[float, float, float, float]  # x, y of both ends [m]
Point = tuple[float, float]


class Beam(NamedTuple):
    """A sector of light from the origin: its middle and half its width [rad], and its range [m]."""

    bit: DockBeam
    middle_rad: float
    half_rad: float
    range_m: float


class Receiver(NamedTuple):
    """On a base: distance ahead of its centre [m], viewing direction and half its field of view [rad]."""

    ahead_m: float
    middle_rad: float
    half_rad: float


class Dock(NamedTuple):
    """One kind of dock. A base is seated when its centre is ``seat_m`` before the emitters, at most so far beside the
    axis [m] and so askew [rad], and at most ``SEAT_SLACK_M`` farther out."""

    beams: tuple[Beam, ...]
    seat_m: float
    beside_m: float
    askew_rad: float


SEAT_SLACK_M = 0.006  # what the contacts' springs allow
_SIDE, _WIDE, _NARROW = math.radians(32.0), math.radians(25.0), math.radians(9.0)
_NEAR_M, _FAR_M = 0.8, 2.5
KOBUKI_DOCK = Dock(
    (
        Beam(DockBeam.NEAR_LEFT, _SIDE, _WIDE, _NEAR_M), Beam(DockBeam.LEFT, _SIDE, _WIDE, _FAR_M),
        Beam(DockBeam.NEAR_CENTER, 0.0, _NARROW, _NEAR_M), Beam(DockBeam.CENTER, 0.0, _NARROW, _FAR_M),
        Beam(DockBeam.NEAR_RIGHT, -_SIDE, _WIDE, _NEAR_M), Beam(DockBeam.RIGHT, -_SIDE, _WIDE, _FAR_M),
    ),
    seat_m=0.21, beside_m=0.018, askew_rad=math.radians(9.0),
)  # fmt: skip
_BUOY, _APERTURE = math.radians(10.0), math.radians(15.0)
HOME_BASE = Dock(
    (
        Beam(DockBeam.LEFT, _BUOY, _APERTURE, 1.0), Beam(DockBeam.RIGHT, -_BUOY, _APERTURE, 1.0),
        Beam(DockBeam.HALO, 0.0, math.pi, 0.61),
    ),
    seat_m=0.21, beside_m=0.022, askew_rad=math.radians(10.0),
)  # fmt: skip
KOBUKI_RECEIVERS = tuple(Receiver(0.16, math.radians(deg), math.radians(45.0)) for deg in (-60.0, 0.0, 60.0))
"""Right, centre, left. kobuki_dock_drive expects the dock in a side receiver when the base drives across its axis."""
OMNI = Receiver(0.14, 0.0, math.radians(110.0))  # of a Create, above the middle of its bumper
CREATE_1_RECEIVERS = (OMNI,)
CREATE_2_RECEIVERS = (Receiver(0.16, math.radians(-30.0), math.radians(45.0)), OMNI,
                      Receiver(0.16, math.radians(30.0), math.radians(45.0)))  # fmt: skip


class BaseAtDock(NamedTuple):
    """What a plant knows of the dock: the pose of the base in its frame, walls there, and whether it has power.

    beams: how this dock's beams differ (width and range, as factors)."""

    x_m: float
    y_m: float
    heading_rad: float
    walls: tuple[Segment, ...] = ()
    powered: bool = True
    widths: float = 1.0
    ranges: float = 1.0


def is_seated(dock: Dock, at: BaseAtDock | None) -> bool:
    """Whether the charging contacts touch."""
    if at is None or at.x_m > dock.seat_m + SEAT_SLACK_M:
        return False
    askew = abs(math.remainder(at.heading_rad - math.pi, math.tau))
    return abs(at.y_m) <= dock.beside_m and askew <= dock.askew_rad


def light(dock: Dock, receivers: Sequence[Receiver], at: BaseAtDock | None, rng: random.Random) -> tuple[DockBeam, ...]:
    """The beams on each receiver in one frame: direct, or off one wall. Drawn from rng: edges, dropouts, ghosts."""
    dark = (DockBeam.NONE,) * len(receivers)
    if at is None or not at.powered:
        return dark
    edge_rad, edge_share = rng.gauss(0.0, EDGE_RAD), 1.0 + rng.gauss(0.0, EDGE_SHARE)
    seen = []
    for receiver in receivers:
        if rng.random() < DROPOUT:
            seen.append(DockBeam.NONE)
            continue
        found = DockBeam.NONE
        for azimuth, distance_m in _arrivals(receiver, at):
            for beam in dock.beams:
                off = abs(math.remainder(azimuth - beam.middle_rad, math.tau))
                wide = off <= beam.half_rad * at.widths + edge_rad
                if wide and distance_m <= beam.range_m * at.ranges * edge_share:
                    found |= beam.bit
        if rng.random() < GHOST:
            found |= rng.choice(dock.beams).bit
        seen.append(found)
    return tuple(seen)


def _arrivals(receiver: Receiver, at: BaseAtDock) -> list[tuple[float, float]]:
    """(azimuth at the dock [rad], distance it counts as [m]) of each way of the light into the receiver."""
    heading = at.heading_rad
    place = at.x_m + receiver.ahead_m * math.cos(heading), at.y_m + receiver.ahead_m * math.sin(heading)
    ways = []
    if _is_seen(receiver, heading, place, (0.0, 0.0)) and not _is_blocked((0.0, 0.0), place, at.walls, None):
        ways.append((math.atan2(place[1], place[0]), math.hypot(*place)))
    for wall in at.walls:
        image = _mirrored(place, wall)
        spot = _crossing((0.0, 0.0), image, wall)
        if spot is None or not _is_seen(receiver, heading, place, spot):
            continue
        if not (_is_blocked((0.0, 0.0), spot, at.walls, wall) or _is_blocked(spot, place, at.walls, wall)):
            ways.append((math.atan2(image[1], image[0]), math.hypot(*image) / REFLECTED))
    return ways


def _is_seen(receiver: Receiver, heading: float, place: Point, source: Point) -> bool:
    bearing = math.atan2(source[1] - place[1], source[0] - place[0])
    return abs(math.remainder(bearing - heading - receiver.middle_rad, math.tau)) <= receiver.half_rad


def _is_blocked(a: Point, b: Point, walls: Sequence[Segment], but: Segment | None) -> bool:
    return any(wall is not but and _crossing(a, b, wall) is not None for wall in walls)


def _mirrored(p: Point, wall: Segment) -> Point:
    """The point behind the (endless) wall."""
    x1, y1, x2, y2 = wall
    dx, dy = x2 - x1, y2 - y1
    k = 2.0 * ((p[0] - x1) * dy - (p[1] - y1) * dx) / max(dx * dx + dy * dy, 1e-12)
    return p[0] - k * dy, p[1] + k * dx


def _crossing(a: Point, b: Point, wall: Segment) -> Point | None:
    """Where the way from a to b crosses the wall, ends of the way excluded."""
    x1, y1, x2, y2 = wall
    (ax, ay), ux, uy, vx, vy = a, b[0] - a[0], b[1] - a[1], x2 - x1, y2 - y1
    across = ux * vy - uy * vx
    if abs(across) < 1e-12:
        return None
    along = ((x1 - ax) * vy - (y1 - ay) * vx) / across
    beside = ((x1 - ax) * uy - (y1 - ay) * ux) / across
    return (ax + along * ux, ay + along * uy) if 1e-6 < along < 1.0 - 1e-6 and 0.0 <= beside <= 1.0 else None

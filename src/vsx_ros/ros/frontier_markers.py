"""Frontiers and views for rviz, in the style of explore_lite: blue borders, green balls as big as they are useful."""

from __future__ import annotations

from collections.abc import Sequence

import rospy
from geometry_msgs.msg import Point, Vector3
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from vsx_ros.exploration.frontiers import Frontier
from vsx_ros.exploration.utility import View
from vsx_ros.geometry.se2 import SE2
from vsx_ros.occupancy.grid import OccupancyGrid
from vsx_ros.ros import convert

_BLUE = ColorRGBA(0.0, 0.0, 1.0, 1.0)
_GREEN = ColorRGBA(0.0, 1.0, 0.0, 1.0)
_WHITE = ColorRGBA(1.0, 1.0, 1.0, 1.0)
_SHOWN_VIEWS = 10
_BIGGEST_BALL_M = 0.3
_TEXT_M = 0.15
_LIFETIME_S = 10.0


def frontier_markers(
    grid: OccupancyGrid, frontiers: Sequence[Frontier], views: Sequence[View], frame_id: str, stamp_ns: int
) -> MarkerArray:
    """One marker of points a frontier; for the best views a ball, and v, d (the stop included) and U in words."""
    shown = views[:_SHOWN_VIEWS]
    best = max((view.utility for view in shown), default=1.0)
    markers = [_clear(frame_id, stamp_ns)]
    for number, frontier in enumerate(frontiers):
        marker = _marker("frontiers", number, Marker.POINTS, _BLUE, (frame_id, stamp_ns))
        marker.scale = Vector3(grid.resolution, grid.resolution, grid.resolution)
        marker.points = [Point(x, y, 0.0) for x, y in grid.centres(frontier.cells).tolist()]
        markers.append(marker)
    for number, view in enumerate(shown):
        size = _BIGGEST_BALL_M * max(0.1, view.utility / best)
        ball = _marker("views", number, Marker.SPHERE, _GREEN, (frame_id, stamp_ns), view.pose)
        ball.scale = Vector3(size, size, size)
        text = _marker("utilities", number, Marker.TEXT_VIEW_FACING, _WHITE, (frame_id, stamp_ns), view.pose)
        text.scale.z = _TEXT_M
        way_m = view.gain_m2 / view.utility if view.utility > 0.0 else view.distance_m
        text.text = f"v {view.gain_m2:.1f} m2, d {way_m:.1f} m, U {view.utility:.2f}"
        markers += [ball, text]
    return MarkerArray(markers)


def _clear(frame_id: str, stamp_ns: int) -> Marker:
    return Marker(header=convert.header(frame_id, stamp_ns), action=Marker.DELETEALL)


def _marker(
    namespace: str, number: int, kind: int, color: ColorRGBA, where: tuple[str, int], pose: SE2 | None = None
) -> Marker:
    marker = Marker(header=convert.header(*where), ns=namespace, id=number, type=kind, action=Marker.ADD)
    marker.pose = convert.pose_msg(pose or SE2())
    marker.color = color
    marker.lifetime = rospy.Duration.from_sec(_LIFETIME_S)
    return marker

"""Named outlines on the floor as markers, for zones and rooms."""

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

from geometry_msgs.msg import Point, Vector3
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from vsx_ros.geometry.se2 import SE2
from vsx_ros.ros import convert, headers, topics

_LINE_M, _TEXT_M = 0.03, 0.15  # width of borders, height of names


class Outline(NamedTuple):
    """points: corners in the map [m]. closed: the last corner is joined with the first. place: x, y [m] of the name."""

    name: str
    points: Sequence[tuple[float, float]]
    closed: bool
    color: ColorRGBA
    place: tuple[float, float]


def outline_markers(namespace: str, outlines: Iterable[Outline], stamp_ns: int) -> MarkerArray:
    """Border and name of each; earlier ones are deleted."""
    header, no_turn = headers.header(topics.MAP_FRAME, stamp_ns), convert.pose_msg(SE2())
    markers = [Marker(header=header, action=Marker.DELETEALL)]
    for number, outline in enumerate(outlines):
        about: dict[str, Any] = {"header": header, "id": number, "action": Marker.ADD, "color": outline.color}
        border = Marker(ns=namespace, type=Marker.LINE_STRIP, pose=no_turn, scale=Vector3(_LINE_M, 0.0, 0.0), **about)
        corners = [*outline.points, *(outline.points[:1] if outline.closed else [])]
        border.points = [Point(x, y, 0.0) for x, y in corners]
        place, size = convert.pose_msg(SE2(*outline.place, 0.0)), Vector3(0.0, 0.0, _TEXT_M)
        kind = Marker.TEXT_VIEW_FACING
        name = Marker(ns=f"{namespace} names", type=kind, pose=place, scale=size, text=outline.name, **about)
        markers += [border, name]
    return MarkerArray(markers)

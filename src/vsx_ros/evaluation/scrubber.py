"""Any second of a run in its report: camera picture, map and decision over a slider. Its page is scrubber.html."""

import json
import math
from base64 import b64encode
from collections.abc import Iterator, Sequence
from importlib import resources
from typing import Any, TypeVar

import numpy as np

from vsx_ros.evaluation import svg
from vsx_ros.evaluation.page import paragraph
from vsx_ros.evaluation.report_data import ReportData
from vsx_ros.evaluation.run_time import length_s
from vsx_ros.evaluation.sheet import Sheet, Window, window_around, window_of
from vsx_ros.geometry.se3 import SE3
from vsx_ros.slam.state import TrackingState

_STEP_S = 0.1  # between places of the robot
_MOST_PLACES = 4000  # of a long run
_SMALLEST_PX = 7.0  # radius of the robot
_Pose = tuple[float, float, float]
_Row = TypeVar("_Row", bound=tuple[Any, ...])  # begins with its stamp [ns]


def scrubber(data: ReportData) -> str:
    """The slider and what it shows, as HTML; empty if nothing was to be kept for it."""
    if not data.pictures and not data.maps:
        return paragraph(data.moments_trouble) if data.moments_trouble else ""
    poses = {stamp_ns: _place(T, data) for stamp_ns, T in data.estimate}
    sheet = Sheet.fitting(_window(data, list(poses.values())), svg.FIGURE_PX)
    page = resources.files(__package__).joinpath("scrubber.html").read_text(encoding="utf-8")
    return page.replace("<!--map-->", _map(data, sheet)).replace("<!--run-->", _json(_run(data, sheet, poses)))


def _place(T_world_cam: SE3, data: ReportData) -> _Pose:
    """x, y and heading on the map: of the base, or in a world without a floor of the camera, in the x-z plane."""
    if data.world_is_level:
        base = (T_world_cam @ data.T_base_cam.inverse()).to_se2()
        return base.x, base.y, base.theta
    looks, at = T_world_cam.rotation[:, 2], T_world_cam.translation
    return float(at[0]), float(at[2]), math.atan2(looks[2], looks[0])


def _window(data: ReportData, poses: Sequence[_Pose]) -> Window:
    corners = [corner.tolist() for corner in window_of(data.grid)] if data.grid is not None else []
    for seen in data.maps:
        corners += [seen.origin, tuple(np.add(seen.origin, seen.size))]
    return window_around([corners, poses])


def _map(data: ReportData, sheet: Sheet) -> str:
    """The map, on which the page draws. Without maps of the moments it shows that of the end."""
    radius_px = max(data.robot_radius_m * sheet.scale if data.world_is_level else 0.0, _SMALLEST_PX)
    ground = sheet.ground(data.grid) if data.grid is not None else ""
    if data.maps:
        ground = '<image preserveAspectRatio="none" style="image-rendering:pixelated"/>'
    robot = f'<g class="robot"><circle r="{radius_px:.1f}"/><path d="M0 0h{2.2 * radius_px:.1f}"/></g>'
    unit = "m" if data.world_is_level else "map units"
    way = '<polyline class="estimate"/>'
    return "".join([sheet.begin("map of this moment"), ground, way, robot, sheet.scale_bar(unit), "</svg>"])


def _run(data: ReportData, sheet: Sheet, poses: dict[int, _Pose]) -> dict[str, Any]:
    """What the page needs to know; its script says how it uses it. Times are seconds that the run had lasted."""

    def timed(rows: Sequence[_Row]) -> Iterator[tuple[float, _Row]]:
        return zip(data.lasted_s(row[0] for row in rows).round(3).tolist(), rows, strict=True)

    maps = []
    for second, seen in timed(data.maps):
        corner = sheet.place((seen.origin[0], seen.origin[1] + seen.size[1]))
        size = [round(metres * sheet.scale, 1) for metres in seen.size]
        maps.append([second, corner, *size, round(seen.known_area_m2, 1), b64encode(seen.png).decode()])
    told = sorted(event for event in data.events if event[2] != "keyframe")
    return {
        "length": round(length_s(data.during), 3),
        "pictures": [[second, b64encode(jpeg).decode()] for second, (_, jpeg) in timed(data.pictures)],
        "maps": maps,
        "frames": [[at, *_told(frame, poses.get(frame[0]), sheet)] for at, frame in timed(_some_frames(data))],
        "decisions": [[second, *event[2:]] for second, event in timed(told) if event[1] == "mission"],
        "others": [[second, *event[1:]] for second, event in timed(told) if event[1] != "mission"],
    }


def _told(frame: tuple[Any, ...], pose: _Pose | None, sheet: Sheet) -> list[Any]:
    """State, points found and searched; if its pose is known, place [px] and heading on the map [deg clockwise]."""
    words = {state.value: state.word for state in TrackingState}
    state, searched, found = frame[1:4]
    place = [] if pose is None else [sheet.place(pose), -round(math.degrees(pose[2]))]
    return [words.get(state, state), found, searched, *place]


def _some_frames(data: ReportData) -> list[tuple[Any, ...]]:
    """The first frame of each step."""
    step_ns = 1e9 * max(_STEP_S, length_s(data.during) / _MOST_PLACES)
    return list({int(frame[0] // step_ns): frame for frame in reversed(data.frames)}.values())[::-1]


def _json(tree: Any) -> str:
    """As text that ends no script."""
    return json.dumps(tree, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")

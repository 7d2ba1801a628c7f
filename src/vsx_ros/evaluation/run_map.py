"""The map of a run in its report: axes and a grid in metres, the way coloured by time, the goals in their order."""

import html
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from vsx_ros.arrays import FloatArray, Points2, Points3
from vsx_ros.errors import InputError
from vsx_ros.evaluation import svg
from vsx_ros.evaluation.report_data import ReportData
from vsx_ros.evaluation.sheet import Sheet, window_around, window_of
from vsx_ros.evaluation.trajectory import align, associate

_FLOOR_M = 0.06  # lower points are floor and hide the map; as ground_map.obstacle_min_height_m
_TICK_PX = 64.0  # least between two lines of the grid
_COLOURS = np.array([(31, 95, 214), (150, 45, 170), (217, 72, 15)])  # RGB of the way, from begin to end
_PIECES = 60  # of the way, each in its colour
_MOST_POINTS = 3000  # of the way
_HIGH_PX, _DIGIT_PX = 13.0, 9.0  # of a goal's number
_AROUND = np.array([
    (away_px * math.cos(k * math.pi / 4), away_px * math.sin(k * math.pi / 4))
    for away_px in (14.0, 20.0, 28.0, 40.0)
    for k in (0, 7, 1, 4, 5, 3, 6, 2)
])  # fmt: skip
"""(32, 2) where the number may stand, from its goal [px], the best place first."""
_DOT_PX = 4.0  # radius of a goal
_LEAST_SHARE = 0.7  # of its width, to which a map may shrink on a phone before it is panned: its words can be read
_LOOK_PX = 12.0  # of the stroke that shows where a view looks

MAP_STYLE = """
svg.run .metres{stroke:#1d2329;opacity:.14}
svg.run .tick,svg.run .axis{fill:#343d46;paint-order:stroke;stroke:#c4c9ce;stroke-width:4px;stroke-linejoin:round}
svg.run .axis{font-weight:600}svg.run .goal text{fill:#1d2329;font:700 14px system-ui,sans-serif;paint-order:stroke;
stroke:#fff;stroke-width:3.5px;stroke-linejoin:round}.goal path{stroke:#1d2329;stroke-width:2}
.goal circle{fill:#1d2329;stroke:#fff;stroke-width:1}
svg.run polyline.truth{stroke-width:6;stroke-dasharray:none;opacity:.45}
.key.time::before{width:70px;height:6px}
@media(max-width:700px){svg.run{min-width:var(--least)}}
"""


def map_picture(data: ReportData) -> str:
    """The map from above with trajectory, truth, points and goals."""
    columns = (0, 1) if data.world_is_level else (0, 2)

    def flat(points: Points3) -> Points2:
        return np.asarray(points, float).reshape(-1, 3)[:, columns]

    estimate = np.array([pose.T.translation for pose in data.estimate]).reshape(-1, 3)
    if not len(estimate) and not len(data.points_world) and data.grid is None:
        begun = data.summary.get("initialized_at_s") is not None
        return f"<p>There is no map: it was {'given up' if begun else 'never started'}.</p>"
    way, truth = flat(estimate), flat(_truth_in_map(data))
    points = data.points_world if data.grid is None else data.points_world[data.points_world[:, 2] > _FLOOR_M]
    dots = flat(points)
    corners = [] if data.grid is None else [corner.tolist() for corner in window_of(data.grid)]
    inner = np.percentile(dots, [1, 99], axis=0).tolist() if len(dots) else []
    sheet = Sheet.fitting(window_around([corners, inner, way.tolist(), truth.tolist()]), svg.WIDTH)
    lasted = data.lasted_s(pose.stamp_ns for pose in data.estimate)
    drawn = [
        sheet.begin("map from above", "map run"), sheet.ground(data.grid) if data.grid is not None else "",
        _lines(sheet), sheet.dots(dots), sheet.way("truth", truth.tolist()), _coloured(sheet, way, lasted),
        *(sheet.mark(name, of[0].tolist()) for name, of in (("estimate", way), ("truth", truth)) if len(of)),
        _goals(sheet, data), _labels(sheet, data.world_is_level), "</svg>",
    ]  # fmt: skip
    least = f"--least:{_LEAST_SHARE * sheet.size[0]:.0f}px"
    return f'<div class="pan" style="{least}">{"".join(drawn)}</div>{_legend(data, lasted, has_truth=len(truth) > 0)}'


def _truth_in_map(data: ReportData) -> Points3:
    """(N, 3) true positions aligned to the estimate; empty if they cannot be compared."""
    try:
        pairs = associate(data.estimate, data.truth)
    except InputError:
        return np.zeros((0, 3))
    estimate, truth = (np.array([T.translation for T in poses]) for poses in zip(*pairs))
    alignment = align(truth, estimate, "yaw" if data.world_is_level else "sim3")
    return alignment.apply(np.array([pose.T.translation for pose in data.truth]))


def _legend(data: ReportData, lasted: FloatArray, *, has_truth: bool) -> str:
    keys = []
    if len(lasted):
        colours = ",".join(_colour(share) for share in (0.0, 0.25, 0.5, 0.75, 1.0))
        span = f"the way from {lasted[0]:.0f} s to {lasted[-1]:.0f} s"
        keys.append(f'<span class="key time" style="--c:linear-gradient(90deg,{colours})">{span}</span>')
    keys += ['<span class="key truth">truth, aligned</span>'] * has_truth
    keys += ['<span class="key points">map points</span>'] * (len(data.points_world) > 0)
    keys += ["<span>numbers: the goals in their order, and where they look</span>"] * (len(data.goals) > 0)
    keys += ["<span>no odometry, hence no scale</span>"] * (not data.world_is_level)
    return f'<p class="legend">{"".join(keys)}</p>'


def _colour(share: float) -> str:
    """The colour of a share of the run's time."""
    place = min(max(share, 0.0), 1.0) * (len(_COLOURS) - 1)
    rgb = (np.interp(place, range(len(_COLOURS)), channel) for channel in _COLOURS.T)
    return "#" + "".join(f"{round(float(value)):02x}" for value in rgb)


def _coloured(sheet: Sheet, way: Points2, lasted: FloatArray) -> str:
    """The way in pieces of equal time; each ends where the next one begins."""
    if not len(way):
        return ""
    kept = np.unique([*range(0, len(way), 1 + len(way) // _MOST_POINTS), len(way) - 1])
    way, lasted = way[kept], lasted[kept]
    share = (lasted - lasted[0]) / (float(np.ptp(lasted)) or 1.0)
    piece = np.clip((share * _PIECES).astype(int), 0, _PIECES - 1)
    starts = [0, *(np.flatnonzero(np.diff(piece)) + 1).tolist()]
    return "".join(
        sheet.way("estimate", way[a : b + 1].tolist(), _colour((piece[a] + 0.5) / _PIECES))
        for a, b in zip(starts, [*starts[1:], len(way) - 1])
    )


class _Ticks(NamedTuple):
    """Round values of both axes and their places on the sheet [px]."""

    x: list[tuple[float, float]]
    y: list[tuple[float, float]]

    @staticmethod
    def of(sheet: Sheet) -> "_Ticks":
        """The same step for both axes: the least round one whose lines are ``_TICK_PX`` apart."""
        least = _TICK_PX / sheet.scale
        magnitude = 10.0 ** math.floor(math.log10(least))
        step = next(m * magnitude for m in (1, 2, 5, 10) if m * magnitude >= least * 0.999)

        def between(low: float, high: float) -> list[float]:
            return [k * step for k in range(math.ceil(low / step), math.floor(high / step) + 1)]

        (x0, y0), (x1, y1) = sheet.low, sheet.high
        return _Ticks([(x, sheet.at((x, y0))[0]) for x in between(x0, x1)],
                      [(y, sheet.at((x0, y))[1]) for y in between(y0, y1)])  # fmt: skip


def _lines(sheet: Sheet) -> str:
    ticks, (width, height) = _Ticks.of(sheet), sheet.size
    ways = [f"M{px:.1f} 0V{height:.1f}" for _, px in ticks.x] + [f"M0 {px:.1f}H{width:.1f}" for _, px in ticks.y]
    return f'<path class="metres" d="{"".join(ways)}"/>'


def _labels(sheet: Sheet, is_level: bool) -> str:
    """The numbers of the ticks at the edges, and the axes' names in their corners."""
    ticks, (width, height) = _Ticks.of(sheet), sheet.size
    names = ("x [m]", "y [m]") if is_level else ("x [map units]", "z [map units]")
    edge = 12.0 + 8.0 * len(names[0])  # the room of the name
    parts = [f'<text class="tick" x="{px:.1f}" y="{height - 6:.1f}" text-anchor="middle">{value:g}</text>'
             for value, px in ticks.x if 44.0 < px < width - edge]  # fmt: skip
    parts += [f'<text class="tick" x="5" y="{px + 4:.1f}">{value:g}</text>'
              for value, px in ticks.y if 34.0 < px < height - 26.0]  # fmt: skip
    parts.append(f'<text class="axis" x="{width - 6:.1f}" y="{height - 6:.1f}" text-anchor="end">{names[0]}</text>')
    return "".join([*parts, f'<text class="axis" x="5" y="16">{names[1]}</text>'])


def _goals(sheet: Sheet, data: ReportData) -> str:
    """Each goal on the sheet: a dot, where it looks, and its number beside it."""
    width, height = sheet.size
    lasted = data.lasted_s(goal.stamp_ns for goal in data.goals).tolist()
    numbered = [(k, goal, sheet.at((goal.pose.x, goal.pose.y))) for k, goal in enumerate(data.goals, start=1)]
    shown = [(k, goal, at) for k, goal, at in numbered if 0.0 <= at[0] <= width and 0.0 <= at[1] <= height]
    labels = _beside([at for _, _, at in shown], [_DIGIT_PX * len(str(k)) for k, _, _ in shown])
    drawn = []
    for (number, goal, (x, y)), label in zip(shown, labels, strict=True):
        at = f"{number} at {lasted[number - 1]:.1f} s: {goal.words}"
        looks = x + _LOOK_PX * math.cos(goal.pose.theta), y - _LOOK_PX * math.sin(goal.pose.theta)
        text = "" if label is None else f'<text x="{label[0]:.1f}" y="{label[1]:.1f}">{number}</text>'
        drawn.append(
            f'<g class="goal"><title>{html.escape(at)}</title><circle cx="{x:.1f}" cy="{y:.1f}" r="3.5"/>'
            f'<path d="M{x:.1f} {y:.1f}L{looks[0]:.1f} {looks[1]:.1f}"/>{text}</g>'
        )
    return "".join(drawn)


def _beside(places: Sequence[tuple[float, float]], widths: Sequence[float]) -> list[tuple[float, float] | None]:
    """Left end and baseline [px] of a label of this width beside each place, as near as possible without hiding another
    place or label; None where there is no room."""
    low = np.array([(x - _DOT_PX, y - _DOT_PX) for x, y in places]).reshape(-1, 2)
    high = low + 2.0 * _DOT_PX
    labels: list[tuple[float, float] | None] = []
    for place, wide in zip(places, widths, strict=True):
        first = place + _AROUND - 0.5 * np.array([wide, _HIGH_PX])
        last = first + np.array([wide, _HIGH_PX])
        hides = ((first[:, None] < high) & (low < last[:, None])).all(axis=2).any(axis=1)
        if hides.all():
            labels.append(None)
            continue
        free = int(np.argmin(hides))
        low, high = np.vstack([low, first[free]]), np.vstack([high, last[free]])
        labels.append((float(first[free, 0]), float(last[free, 1]) - 0.15 * _HIGH_PX))
    return labels

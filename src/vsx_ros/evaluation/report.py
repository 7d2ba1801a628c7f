"""report.html: what happened in a run and why it ended, on one self-contained page."""

import html
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from vsx_ros.evaluation import svg
from vsx_ros.evaluation.events import collapsed, rows
from vsx_ros.evaluation.page import document, figures, png_figure, table
from vsx_ros.evaluation.report_data import ReportData
from vsx_ros.evaluation.run_map import MAP_STYLE, map_picture
from vsx_ros.evaluation.scrubber import scrubber
from vsx_ros.occupancy.rooms import Room
from vsx_ros.slam.state import TrackingState

_MAX_EVENTS = 400  # rows; the file has all of them
_SMALL = 450.0, 210.0  # px, of a diagram beside another
_FASTEST_MS = 0.1  # least of the axis; a quicker frame was refused


def render(data: ReportData) -> str:
    """The page."""
    body = [
        f"<h1>{html.escape(title := str(data.summary.get('world') or 'run'))}</h1>",
        _ending(data.summary),
        _origin(data),
        png_figure("the newest keyframe", data.picture_png),
        _figures(data.summary),
        section("Second by second", scrubber(data)),
        section("Map and trajectory", map_picture(data)),
        section("Known area", known_area(data)),
        section("Goals", goal_table(data)),
        section("Rooms", room_table(data.rooms)),
        section("Tracking over time", timeline(data)),
        section("Events", _events(data)),
        section("All numbers", _folded("summary.json", data.summary)),
        section("How to repeat it", _repeat(data)),
    ]
    return document(title, "".join(body), STYLE + MAP_STYLE)


def section(title: str, content: str) -> str:
    """A part of a page; empty if there is no content."""
    return f"<section><h2>{title}</h2>{content}</section>" if content else ""


def _ending(summary: Mapping[str, Any]) -> str:
    reason = str(summary.get("stop_reason") or "the run did not say why it ended")
    kind = {True: "fine", False: "bad", None: "unknown"}[summary.get("ended_well")]
    return f'<p class="ending {kind}">{html.escape(reason)}</p>'


def _origin(data: ReportData) -> str:
    """World, seed, date and command."""
    named = [("world", data.summary.get("world")), ("seed", data.summary.get("seed")), ("date", data.facts.get("date"))]
    known = html.escape(", ".join(f"{name} {value}" for name, value in named if value is not None))
    return f'<p class="legend">{known}</p>{command(data)}'


def _figures(summary: Mapping[str, Any]) -> str:
    """The most important numbers; unknown ones are left out."""

    def share(key: str) -> str | None:
        return f"{100 * summary[key]:.1f} %" if summary.get(key) is not None else None

    def number(key: str, form: str, unit: str) -> str | None:
        return f"{summary[key]:{form}} {unit}".strip() if summary.get(key) is not None else None

    tracked = summary.get("frames_tracked"), summary.get("frames")
    tiles = [
        ("frames tracked", f"{tracked[0]} of {tracked[1]}" if None not in tracked else None),
        ("points found (U1)", share("u1")),
        ("a point is tracked (U2)", number("u2_frames", ".0f", "frames")),
        ("breaks", number("breaks", "d", "")),
        ("jumps of odometry", number("odometry_jumps", "d", "") if summary.get("odometry_jumps") else None),
        ("coverage", share("coverage")),
        ("collisions", number("collisions", "d", "")),
        ("ATE, live poses", number("ate_rmse_m", ".3f", "m")),
        ("ATE, final poses", number("ate_final_rmse_m", ".3f", "m")),
        ("ATE, live, scale-free", number("ate_rmse_sim3_m", ".4f", "m")),
        ("ATE, final, scale-free", number("ate_final_rmse_sim3_m", ".4f", "m")),
        ("scale error", share("scale_error")),
        ("path", number("path_length_m", ".1f", "m")),
        ("duration", number("duration_s", ".1f", "s")),
        ("keyframes", number("keyframes", "d", "")),
        ("map points", number("map_points", "d", "")),
        ("per frame", number("track_ms_median", ".1f", "ms")),
    ]
    shown = "".join(f"<div><b>{value}</b><span>{name}</span></div>" for name, value in tiles if value is not None)
    return f'<div class="tiles">{shown}</div>'


def known_area(data: ReportData) -> str:
    """What was known of the place over time and over the way; with the truth, the share of it that was right."""
    if not data.progress:
        return ""
    times, metres, areas = (np.array(column, float) for column in list(zip(*data.progress))[1:4])
    rows = [row for row in data.progress if row.coverage_correct is not None]
    curves = [("known area [m2]", times, metres, areas, svg.top(areas))]
    if rows:
        right = np.array([[row.elapsed_s, row.driven_m, row.coverage_correct] for row in rows], float)
        curves.append(("known and right, as a share of what can be seen,", *right.T, 1.0))
    pictures = [
        (f"{name} over {of}", svg.plot([("curve", x, y)], name, top, unit=unit, size=_SMALL))
        for name, seconds, way, y, top in curves
        for of, unit, x in (("time", "s", seconds), ("the way driven", "m", way))
    ]
    return figures(pictures)


def goal_table(data: ReportData) -> str:
    """The views driven to, by their numbers on the map, and why each was left."""
    rows = []
    lasted = data.lasted_s(goal.stamp_ns for goal in data.goals).tolist()
    for number, (goal, at_s) in enumerate(zip(data.goals[:_MAX_EVENTS], lasted), start=1):
        why = f"<details><summary>{html.escape(goal.words)}</summary>{html.escape(goal.figures)}</details>"
        left = f'<div class="left">left: {html.escape(goal.left)}</div>' if goal.left else ""
        rows.append(f"<tr><td>{number}</td><td>{at_s:.1f} s</td><td>{why}{left}</td></tr>")
    head = "".join(f"<th>{name}</th>" for name in ("goal", "at", "why it was chosen and left"))
    return f'<table class="goals"><tr>{head}</tr>{"".join(rows)}</table>{_left_out(data.goals)}' if rows else ""


def room_table(rooms: Sequence[Room]) -> str:
    """How much of each room is known."""
    cells = [(str(r.number), r.name, f"{r.area_m2:.1f} m2", f"{100 * r.known_ratio:.0f} %") for r in rooms]
    return table(["number", "room", "free ground", "known of its extent"], cells)


def timeline(data: ReportData) -> str:
    """States, share of found points, how long points are tracked and time per frame over time."""
    if not data.frames:
        return ""
    seconds = data.lasted_s(frame[0] for frame in data.frames)
    ratio = np.array([frame[3] / frame[2] if frame[2] else np.nan for frame in data.frames])
    times, lives = (np.array([frame[column] for frame in data.frames], float) for column in (5, 6))  # None is NaN
    told = [event for event in data.events if event[2] != "keyframe"]
    lasted = data.lasted_s(event[0] for event in told).tolist()
    words = {state.value: state.word for state in TrackingState}
    states = [words.get(frame[1], frame[1]) for frame in data.frames]
    keys = "".join(
        f'<span class="key" style="--c:{svg.state_color(state)}">{html.escape(state)}</span>'
        for state in dict.fromkeys(states)
    )
    marks = [(at_s, *event[2:]) for at_s, event in zip(lasted, told, strict=True) if at_s <= float(seconds[-1])]
    parts = [svg.state_band(seconds, states, marks), f'<p class="legend">{keys}<span>&#9662; event</span></p>']
    if np.isfinite(ratio).any():
        good, lost = f"{TrackingState.GOOD.word} above", f"{TrackingState.LOST.word} below"
        levels = [(data.good_ratio, good), (data.lost_ratio, lost)]
        parts.append("<h3>share of the searched points that were found; its mean is U1</h3>")
        parts.append(svg.plot([("curve", seconds, ratio)], "found / searched", marks=levels))
    if np.isfinite(lives).any():
        parts.append("<h3>frames in which a point was tracked, the mean so far; it ends at U2</h3>")
        parts.append(svg.plot([("curve", seconds, lives)], "U2 so far [frames]", svg.top(lives)))
    if np.isfinite(times).any():
        scale = svg.decades(max(float(np.nanpercentile(times, 1.0)), _FASTEST_MS), float(np.nanmax(times)))
        parts.append("<h3>time per frame [ms]; in lock-step mapping and planning are part of it</h3>")
        parts.append(svg.plot([("curve", seconds, times)], "ms per frame", scale[-1], bottom=scale[0]))
    return f'<div class="pan">{"".join(parts)}</div>'


def _events(data: ReportData) -> str:
    """Their words; the figures of choices are in the table of goals."""
    told = collapsed([(*event[:3], event[3].partition(" [")[0]) for event in data.events if event[2] != "keyframe"])
    return table(["at", "who", "state", "why"], rows(told[:_MAX_EVENTS], data.lasted_s)) + _left_out(told)


def _left_out(rows_of: Sequence[object]) -> str:
    return f"<p>... and {len(rows_of) - _MAX_EVENTS} more in events.jsonl</p>" if len(rows_of) > _MAX_EVENTS else ""


def _folded(name: str, values: Mapping[str, Any]) -> str:
    """A table of names and values, folded."""
    rows = "".join(f"<tr><td>{html.escape(key)}</td><td>{shown(value)}</td></tr>" for key, value in values.items())
    return f"<details><summary>{name}</summary><table>{rows}</table></details>"


def shown(value: Any) -> str:
    """A value of a summary, as HTML."""
    if value is None:
        return "<i>unknown</i>"
    return html.escape(f"{value:.5g}" if isinstance(value, float) else str(value))


def command(data: ReportData) -> str:
    """The command of the run, as HTML."""
    return f"<pre>{html.escape(str(data.facts.get('command', '')))}</pre>"


def versions(data: ReportData) -> dict[str, str]:
    """Versions of the packages that the run used."""
    of = data.facts.get("versions")
    return {str(name): str(version) for name, version in of.items()} if isinstance(of, Mapping) else {}


def _repeat(data: ReportData) -> str:
    parameters = f"<details><summary>configuration</summary><pre>{html.escape(data.config_yaml)}</pre></details>"
    return _folded("versions", versions(data)) + parameters


STYLE = """
main{max-width:940px}h3{font-size:13px;font-weight:500;color:var(--soft);margin:14px 0 0}
.ending{font-size:17px;margin:0 0 20px;padding:10px 14px;border-left:5px solid;background:var(--tile);border-radius:4px}
.fine{border-color:var(--green)}.bad{border-color:var(--red)}
.tiles{display:grid;grid-template-columns:repeat(auto-fill,minmax(150px,1fr));gap:10px}
.tiles div{background:var(--tile);border-radius:6px;padding:10px 12px}
.tiles b{display:block;font-size:19px;font-variant-numeric:tabular-nums;white-space:nowrap}
.tiles span{color:var(--soft);font-size:13px}
line.mark{stroke:var(--red);stroke-dasharray:5 4;opacity:.6}.curve{stroke:var(--blue)}.event{fill:var(--ink)}
polyline.estimate{stroke:var(--blue);stroke-width:2.5}circle.estimate{fill:var(--blue)}
polyline.truth{stroke:var(--green);stroke-dasharray:6 4}circle.truth{fill:var(--green)}
.dots{stroke:var(--soft);stroke-width:2;stroke-linecap:round;opacity:.45}
.legend{color:var(--soft);font-size:13px;margin:6px 0}.legend span{margin-right:18px}
.key::before{content:"";display:inline-block;width:18px;height:4px;margin-right:6px;vertical-align:middle;
background:var(--c)}
.key.estimate{--c:#1f6fd6}.key.truth{--c:#12855a}.key.points{--c:#4d5964}
.seen{margin:0 0 16px;max-width:480px}.seen img{width:100%;border-radius:6px}
figcaption{color:var(--soft);font-size:13px}
table{width:100%}td:first-child{white-space:nowrap}summary{cursor:pointer;color:var(--blue);margin:8px 0}
i{color:var(--soft)}
.figures{display:grid;grid-template-columns:repeat(auto-fit,minmax(min(380px,100%),1fr));gap:8px 20px}
figure{margin:0;min-width:0}.goals td:nth-child(2){white-space:nowrap}.goals td:last-child{width:100%}
.goals summary{margin:0;color:var(--ink)}.left,.goals details{color:var(--soft)}
.pan{overflow-x:auto}@media(max-width:700px){.pan svg.plot{min-width:660px}}
"""

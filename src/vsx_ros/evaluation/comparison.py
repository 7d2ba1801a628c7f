"""Two runs on one page: differences of their numbers and settings, their maps and tracking side by side."""

import difflib
import html
from collections.abc import Callable
from typing import Any

from vsx_ros.evaluation.page import document
from vsx_ros.evaluation.report import STYLE, command, known_area, section, shown, timeline, versions
from vsx_ros.evaluation.report_data import ReportData
from vsx_ros.evaluation.run_map import MAP_STYLE, map_picture

Named = tuple[str, ReportData]

_MORE_IS_BETTER = {
    "frames_tracked", "u1", "u2_frames", "u2_seconds", "u2_metres", "visible_ratio", "coverage", "coverage_correct",
    "occupied_precision", "occupied_recall",
}  # fmt: skip
_LESS_IS_BETTER = {
    "frames_lost", "breaks", "track_ms_median", "track_ms_p99", "ate_rmse_m", "ate_rmse_sim3_m",
    "ate_final_rmse_m", "ate_final_rmse_sim3_m", "scale_error",
    "free_inside_obstacle", "collisions", "planned_vs_executed_rms_m", "plan_ms_median", "plan_ms_p99",
}  # fmt: skip
_NO_OPTIONS = "command", "date", "versions"
_SIDE = """
main{max-width:1500px}.sides{display:grid;grid-template-columns:repeat(2,minmax(0,1fr));gap:24px}
td,td:first-child,th{white-space:normal;overflow-wrap:anywhere}
@media(max-width:700px){.sides{grid-template-columns:minmax(0,1fr)}}
.better{color:var(--green)}.worse{color:var(--red)}
"""


def compare(a: Named, b: Named) -> str:
    """The page that compares the second run with the first."""
    title = f"{b[0]} against {a[0]}"
    body = [
        f"<h1>{html.escape(title)}</h1>",
        _side_by_side(a, b, lambda data: html.escape(str(data.summary.get("stop_reason") or "unknown"))),
        section("Numbers", _numbers(a, b)),
        section("Map and trajectory", _side_by_side(a, b, map_picture)),
        section("Known area", _side_by_side(a, b, known_area)),
        section("Tracking over time", _side_by_side(a, b, timeline)),
        section("Settings that differ", _settings(a, b)),
        section("How to repeat them", _side_by_side(a, b, command)),
    ]
    return document(title, "".join(body), STYLE + MAP_STYLE + _SIDE)


def change(key: str, before: Any, after: Any) -> tuple[str, str]:
    """The difference of two values in words, and "better", "worse" or neither (empty)."""
    numbers = all(isinstance(value, int | float) and not isinstance(value, bool) for value in (before, after))
    if key == "seed" or not numbers:
        return "", ""
    difference = after - before
    if difference == 0:
        return "same", ""
    share = f" ({100 * difference / abs(before):+.0f} %)" if before else ""
    gain = difference if key in _MORE_IS_BETTER else -difference if key in _LESS_IS_BETTER else 0.0
    return f"{difference:+.4g}{share}", "better" if gain > 0 else "worse" if gain < 0 else ""


def _numbers(a: Named, b: Named) -> str:
    rows = []
    for key in dict.fromkeys([*a[1].summary, *b[1].summary]):
        before, after = a[1].summary.get(key), b[1].summary.get(key)
        if before is None and after is None:
            continue
        words, verdict = change(key, before, after)
        cells = "".join(f"<td>{cell}</td>" for cell in (html.escape(key), shown(before), shown(after)))
        rows.append(f'<tr>{cells}<td class="{verdict}">{words}</td></tr>')
    head = "".join(f"<th>{html.escape(name)}</th>" for name in ("", a[0], b[0], "change"))
    return f"<table><tr>{head}</tr>{''.join(rows)}</table>"


def _settings(a: Named, b: Named) -> str:
    """The options of the runs, their parameters, by full name, and versions that differ."""
    before, after = (_options(data) + _parameters(data.config_yaml) for _, data in (a, b))
    changed = [line for line in difflib.ndiff(before, after) if line[:2] in ("- ", "+ ")]
    if not changed:
        return "<p>None: same options, same configuration, same versions.</p>"
    return f"<pre>{html.escape(chr(10).join(changed))}</pre>"


def _options(data: ReportData) -> list[str]:
    """World, seed, time and the like, and versions."""
    given = [f"{name}: {value}" for name, value in data.facts.items() if name not in _NO_OPTIONS]
    return given + [f"{name} {version}" for name, version in versions(data).items()]


def _parameters(config_yaml: str) -> list[str]:
    """One line per parameter, with the name for --set."""
    lines: list[str] = []
    branch: list[str] = []
    for line in config_yaml.splitlines():
        name, _, value = line.partition(":")
        if not name.strip() or name.lstrip().startswith("#"):
            continue
        branch[(len(line) - len(line.lstrip())) // 2 :] = [name.strip()]
        lines += [f"{'.'.join(branch)}:{value}"] if value.strip() else []
    return lines


def _side_by_side(a: Named, b: Named, drawn: Callable[[ReportData], str]) -> str:
    sides = "".join(f"<div><h3>{html.escape(name)}</h3>{drawn(data)}</div>" for name, data in (a, b))
    return f'<div class="sides">{sides}</div>'

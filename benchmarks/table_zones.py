"""The table of zones drawn before a driving robot."""

from collections.abc import Sequence
from statistics import median
from typing import Any

from vsx_ros.experiments.rows import Row


def zones(rows: Sequence[Row]) -> list[str]:
    """One line for each kind of zone: drawn ahead of the robot, and around it."""
    lines = [
        "| zone | runs | ahead: median, least | speed: median, most | outline inside | least gap | told | contacts |",
        "|---|---|---|---|---|---|---|---|",
    ]
    drawn = [row.result for row in rows if row.result["drawn"]]
    for kind in ("square", "triangle", "wall"):
        ahead = [run for run in drawn if run["kind"] == kind and run["ahead_m"] is not None]
        if ahead:
            far_cm = [100 * run["ahead_m"] for run in ahead]
            lines.append(f"| {kind} | {len(ahead)} | {median(far_cm):.0f}, {min(far_cm):.0f} cm | {_kept_out(ahead)} |")
    around = [run for run in drawn if run["ahead_m"] is None]
    if around:
        out_s = [run["out_s"] for run in around if run["out_s"] is not None]
        left = f"left by {len(out_s)}" + (f", after {median(out_s):.1f}, at most {max(out_s):.1f} s" if out_s else "")
        lines.append(f"| square around the robot | {len(around)} | {left} | {_kept_out(around)} |")
    never = len(rows) - len(drawn)
    return lines + (["", f"In {never} runs the base never drove ahead fast enough for a zone."] if never else [])


def _kept_out(runs: Sequence[dict[str, Any]]) -> str:
    speeds, least = [run["speed_m_s"] for run in runs], [run["least_m"] for run in runs if run["least_m"] is not None]
    inside = sum(gap_m < 0.0 for gap_m in least)
    gap = f"{100 * min(least):.1f} cm" if least else "-"
    told, contacts = sum(run["said"] for run in runs), sum(run["collisions"] for run in runs)
    return f"{median(speeds):.2f}, {max(speeds):.2f} m/s | {inside} | {gap} | {told} | {contacts}"

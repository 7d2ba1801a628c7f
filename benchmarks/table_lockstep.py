"""Tables of single questions put to the whole system in lock-step."""

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


def charging(rows: Sequence[Row]) -> list[str]:
    """One line for each run."""
    lines = [
        "| world | battery | minutes | way | charges | failed | least left | known, right | ATE | contacts | its end |",
        "|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        of = row.result
        lines.append(
            f"| {row.asked['world']} {row.asked['seed']} | {row.asked['pace']:g} x | {of['minutes']:.0f} "
            f"| {of['driven_m']:.0f} m | {of['charges']} | {of['failures']} | {100 * of['least_ratio']:.0f} % "
            f"| {100 * of['coverage']:.0f} % | {100 * of['ate_m']:.1f} cm | {of['touches']} | {of['stop_reason']} |"
        )
    return lines


def put_down(rows: Sequence[Row]) -> list[str]:
    """One line for each room ahead at the start."""
    lines = [
        "| free ahead | starts | a map | until then: median, longest | half known | contacts | at more than 0.1 m/s |",
        "|---|---|---|---|---|---|---|",
    ]
    for least_m, most_m in ((0.0, 0.3), (0.3, 0.7), (0.7, 9.0)):
        of = [row.result for row in rows if least_m <= row.result["free_ahead_m"] < most_m]
        if of:
            begun = [run["started_s"] for run in of if run["started_s"] is not None]
            seconds = f"{median(begun):.0f}, {max(begun):.0f} s" if begun else "-"
            name = f"{least_m:g} to {most_m:g} m" if most_m < 9.0 else f"{least_m:g} m or more"
            counts = " | ".join(str(sum(run[key] for run in of)) for key in ("reached", "contacts", "hard"))
            lines.append(f"| {name} | {len(of)} | {len(begun)} | {seconds} | {counts} |")
    return lines

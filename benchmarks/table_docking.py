"""The tables of docking and of exploring on batteries."""

from collections.abc import Sequence
from statistics import median
from typing import Any

from table_exploration import header, shown

from vsx_ros.experiments.rows import Row


def docking(rows: Sequence[Row]) -> list[str]:
    """One line for each base, with the dock in its place and shifted."""
    lines = header(
        ("base", "dock", "docked", "at the first try", "left it again", "touched a wall", "seconds: median, longest")
    )
    for base in ("kobuki", "create", "create2"):
        for shifted in (False, True):
            of = [row.result for row in rows if (row.asked["base"], row.asked["shifted"]) == (base, shifted)]
            if of:
                lines.append(f"| {base} | {'20 cm and 20 deg off' if shifted else 'as remembered'} | {_cells(of)} |")
    return lines


def _cells(results: Sequence[dict[str, Any]]) -> str:
    docked = [result for result in results if result["docked"]]
    seconds = [result["seconds"] for result in docked] or [float("nan")]
    first, left = sum(not result["tries"] for result in docked), sum(result["left"] for result in docked)
    touched = sum(result["touches"] > 0 for result in results)
    times = f"{median(seconds):.0f}, {max(seconds):.0f}"
    return f"{len(docked)} of {len(results)} | {first} | {left} | {touched} | {times}"


def charging(rows: Sequence[Row]) -> list[str]:
    """One line for each run."""
    lines = header(
        ("world", "minutes", "way [m]", "known and right [%]", "charged", "not docked", "least charge [%]", "contacts",
         "ATE [cm]", "ended by")
    )  # fmt: skip
    for row in rows:
        did = row.result
        coverage, ate_m = did["coverage"], did["ate_m"]
        cells = (
            f"{row.asked['world']} {row.asked['seed']}", shown(did["minutes"], ".0f"), shown(did["driven_m"], ".0f"),
            shown(coverage and 100.0 * coverage, ".0f"), did["charges"], did["failures"],
            shown(100.0 * did["least_ratio"], ".0f"), did["touches"], shown(ate_m and 100.0 * ate_m, ".1f"),
            did["stop_reason"],
        )  # fmt: skip
        lines.append(f"| {' | '.join(map(str, cells))} |")
    return lines

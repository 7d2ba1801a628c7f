"""Tables of faults from their rows: how long the wheels turned."""

from __future__ import annotations

import statistics
from collections.abc import Iterator, Sequence
from typing import Any

from vsx_ros.cli.experiments.rows import Row


def nodes(rows: Sequence[Row]) -> list[str]:
    """Killed, hung or stopped; turned_s is -1 where the wheels did not stop."""
    lines = ["| node | what happened to it | wheels turned: median | most | repetitions |", "|---|---|---|---|---|"]
    for (node, how), results in _parts(rows, "node", "how"):
        turned = [result["turned_s"] for result in results]
        worst = "did not stop" if min(turned) < 0 else f"{max(turned):.3f} s"
        lines.append(f"| {node} | {how} | {statistics.median(turned):.3f} s | {worst} | {len(turned)} |")
    return lines


def robots(rows: Sequence[Row]) -> list[str]:
    """The camera of an exploring robot."""
    lines = [
        "| fault of the camera | wheels turned (median, most of n) | what the robot says then | four seconds later |",
        "|---|---|---|---|",
    ]
    for (fault,), results in _parts(rows, "fault"):
        said = statistics.mode(f"{result['slam']}; {result['follower']}" for result in results)
        later = statistics.mode(result["later"].partition(": view at")[0] for result in results)
        lines.append(f"| {fault} | {_turned(results)} | {said} | {later} |")
    return lines


def bases(rows: Sequence[Row]) -> list[str]:
    """turned_s is -1 where the base drove on."""
    lines = ["| base | fault | wheels turned (median, most of n) | what the driver says |", "|---|---|---|---|"]
    for (base, fault), results in _parts(rows, "base", "fault"):
        lines.append(f"| {base} | {fault} | {_turned(results)} | {results[-1]['said']} |")
    return lines


def cameras(rows: Sequence[Row]) -> list[str]:
    """At the driver."""
    lines = ["| fault of the camera | two seconds at the driver |", "|---|---|"]
    for (fault,), results in _parts(rows, "fault"):
        lines.append(f"| {fault} | {results[-1]['arrived']} |")
    return lines


def _turned(results: list[dict[str, Any]]) -> str:
    times = [result["turned_s"] for result in results if result["turned_s"] >= 0.0]
    on = len(results) - len(times)
    turned = f"{statistics.median(times):.3f} s, {max(times):.3f} s of {len(times)}" if times else ""
    return (turned + (f" drives on ({on} of {len(results)})" if on else "")).strip()


def _parts(rows: Sequence[Row], *names: str) -> Iterator[tuple[tuple[str, ...], list[dict[str, Any]]]]:
    """In the order in which they came into the file."""
    parts: dict[tuple[str, ...], list[dict[str, Any]]] = {}
    for row in rows:
        parts.setdefault(tuple(row.asked[name] for name in names), []).append(row.result)
    yield from parts.items()

"""Whether a wheel does what it is told, by its way over a second."""

from __future__ import annotations

import math

from vsx_hw.command_trace import Span

FOLLOWS, RUNS_AWAY = 0.1, 1.5
"""Shares of the commanded way. A sound wheel, whose speed is controlled, makes 0.7 to 1.1 of it; one that is blocked or
whose encoder stands 0, one that counts each edge twice 2, one whose phases are swapped -1."""
WAY_M, SLACK_M = 0.02, 0.015
"""Slower wheels are not judged: friction may hold them. Slack: two reports of a Create 1 are rounded by 7 mm; as much
again for the roll after a command was lowered."""
BEGUN = 0.5
"""The least way told, by the longest lag, has this share of the most: the start-up is over."""

HELD = "does not follow the command"


def wheel_verdict(way_m: float, told: Span) -> str | None:
    """What is wrong with the way of a wheel, in words, empty if nothing; None where it cannot be judged: too slow, or
    not yet, or no longer."""
    least, most = sorted(told, key=abs)
    if abs(most) < WAY_M:
        return None
    if abs(way_m) > RUNS_AWAY * abs(most) + SLACK_M:
        return f"counts {abs(way_m):.2f} m for {abs(most):.2f} m told"
    if told[0] * told[1] <= 0.0 or abs(least) < max(WAY_M, BEGUN * abs(most)):
        return None
    return HELD if way_m * math.copysign(1.0, least) < FOLLOWS * abs(least) else ""

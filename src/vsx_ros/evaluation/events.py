"""Events of a run for people: repeats are collapsed."""

import re
from collections.abc import Sequence
from typing import NamedTuple

from vsx_ros.evaluation.run_time import Clock

Event = tuple[int, str, str, str]  # stamp_ns, source, state, reason
_NUMBER = re.compile(r"-?[0-9]+([.][0-9]+)?")
_LONGEST_CYCLE = 2  # events that follow each other again and again, as stale and following do


class Told(NamedTuple):
    """An event, how often in a row it came, and the stamp of the last time."""

    event: Event
    times: int
    last_ns: int


def collapsed(events: Sequence[Event]) -> list[Told]:
    """The events by time. Of a cycle of one or two that repeats, only the first ones are told, each with the number of
    its repeats. Reasons that differ in numbers alone count as the same."""
    ordered = sorted(events, key=lambda event: event[0])
    kinds = [(source, state, _NUMBER.sub("#", reason)) for _, source, state, reason in ordered]
    told: list[Told] = []
    at = 0
    while at < len(ordered):
        cycles = ((length, _repeats(kinds, at, length)) for length in range(1, _LONGEST_CYCLE + 1))
        cycle, times = max(cycles, key=lambda found: found[0] * found[1])
        if times == 1:
            cycle = 1
        last = at + cycle * (times - 1)
        told += [Told(ordered[at + k], times, ordered[last + k][0]) for k in range(cycle)]
        at += cycle * times
    return told


def rows(told: Sequence[Told], lasted_s: Clock) -> list[list[str]]:
    """Cells of a table: how long the run had lasted, source, state, reason."""
    first, last = lasted_s(one.event[0] for one in told), lasted_s(one.last_ns for one in told)
    cells = []
    for ((_, *words), times, _), at_s, last_s in zip(told, first.tolist(), last.tolist(), strict=True):
        again = f" ({times} times until {last_s:.1f} s)" if times > 1 else ""
        cells.append([f"{at_s:.1f} s", *words[:-1], words[-1] + again])
    return cells


def _repeats(kinds: Sequence[tuple[str, str, str]], at: int, cycle: int) -> int:
    """How often the next ``cycle`` kinds come in a row."""
    first, times = kinds[at : at + cycle], 1
    while len(first) == cycle and kinds[at + cycle * times : at + cycle * (times + 1)] == first:
        times += 1
    return times

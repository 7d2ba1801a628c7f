"""Events that repeat are told once, with how often."""

from vsx_ros.evaluation.events import Told, collapsed, rows
from vsx_ros.evaluation.run_time import elapsed_s, parts

SECOND = 10**9


def test_a_cycle_of_two_becomes_two_lines() -> None:
    states = ["stale", "following"] * 50
    events = [(k * SECOND, "navigation", state, f"pose is {k} ms old") for k, state in enumerate(states)]
    begin, end = (-1, "mission", "mapping", "go"), (200 * SECOND, "mission", "done", "explored")
    told = collapsed([end, *events, begin])
    assert [(one.event[2], one.times) for one in told] == [
        ("mapping", 1), ("stale", 50), ("following", 50), ("done", 1),
    ]  # fmt: skip
    assert told[1].last_ns == 98 * SECOND
    assert told[2].last_ns == 99 * SECOND


def test_equal_ones_in_a_row_become_one_and_others_stay() -> None:
    events = [(k, "slam", state, "") for k, state in enumerate("aaabca")]
    assert [(one.event[2], one.times) for one in collapsed(events)] == [("a", 3), ("b", 1), ("c", 1), ("a", 1)]
    assert collapsed([]) == []


def test_reasons_that_say_something_else_are_not_the_same() -> None:
    events = [(k, "mission", "mapping", reason) for k, reason in enumerate(["blocked", "lost", "blocked by 3 m"])]
    assert len(collapsed(events)) == 3


def test_a_row_tells_how_long_the_run_had_lasted() -> None:
    told = [Told((12 * SECOND, "slam", "lost", "dark"), 3, 95 * SECOND)]
    during = parts([10 * SECOND, 14 * SECOND, 90 * SECOND, 99 * SECOND])
    assert rows(told, lambda at: elapsed_s(at, during)) == [["2.0 s", "slam", "lost", "dark (3 times until 9.0 s)"]]

"""The time left is told only where it has proven right: synthetic explorations."""

import numpy as np
import pytest

from vsx_ros.exploration.time_left import Progress, TimeLeft, estimate, left_to_see, left_words, proven
from vsx_ros.exploration.utility import View
from vsx_ros.geometry.se2 import SE2

SECOND = 10**9


def told(known, left, until_s: float, every_s: float = 10.0) -> list[tuple[float, float | None]]:
    """(time, time left as told) at each choice of an exploration; known, left: m2 as functions of the time."""
    time_left, rows = TimeLeft(), []
    for at_s in np.arange(0.0, until_s, every_s).tolist():
        time_left.add(round(at_s * SECOND), known(at_s), left(at_s))
        rows.append((at_s, time_left.at(round(at_s * SECOND))))
    return rows


def test_at_a_steady_rate_all_that_is_told_is_right_and_most_is_told() -> None:
    rng = np.random.default_rng(0)
    rows = told(
        lambda t: 0.2 * t + rng.uniform(-0.3, 0.3), lambda t: 0.2 * (600.0 - t) * rng.uniform(0.95, 1.05), 590.0
    )
    right = [(at_s, left_s) for at_s, left_s in rows if left_s is not None]
    assert all(abs(left_s - (600.0 - at_s)) <= 0.3 * (600.0 - at_s) + 5.0 for at_s, left_s in right)
    assert 0.3 * len(rows) < len(right) < 0.9 * len(rows)
    assert right[0][0] >= 250.0  # half the time of what it tells


def test_nothing_is_told_while_more_comes_to_light_than_is_seen() -> None:
    """The ground that is left stays the same, as in a large building at first."""
    assert all(left_s is None for _, left_s in told(lambda t: 0.2 * t, lambda t: 20.0, 400.0))


def test_nothing_is_told_while_nothing_comes_to_light() -> None:
    assert all(left_s is None for _, left_s in told(lambda t: 30.0, lambda t: 20.0, 400.0))


def test_it_is_silent_when_the_rate_breaks_down_and_tells_again_later() -> None:
    """From 300 s on the robot sees ground at a third of the rate."""

    def known(t: float) -> float:
        return 0.3 * min(t, 300.0) + 0.1 * max(t - 300.0, 0.0)

    rows = dict(told(known, lambda t: 120.0 - known(t), 600.0))
    assert rows[290.0] == pytest.approx(110.0, abs=2.0)
    assert rows[360.0] is None
    assert rows[590.0] == pytest.approx(10.0, abs=3.0)


def test_a_pause_does_not_count_and_an_old_estimate_is_not_told() -> None:
    time_left = TimeLeft()
    for step in range(60):
        pause_s = 3000 if step >= 40 else 0
        now_ns = (10 * step + pause_s) * SECOND
        time_left.add(now_ns, 2.0 * step, 2.0 * (60 - step))
    assert time_left.at(now_ns) == pytest.approx(10.0, abs=3.0)
    assert time_left.at(now_ns + 8 * SECOND) == pytest.approx(2.0, abs=3.0)
    assert time_left.at(now_ns + 50 * SECOND) == 0.0
    assert time_left.at(now_ns + 61 * SECOND) is None


def test_without_a_history_nothing_is_told() -> None:
    assert proven([]) is None
    assert TimeLeft().at(0) is None
    assert estimate([], 0.0, 5.0, 5.0) is None
    assert estimate([Progress(0.0, 0.0, 9.0, None)], 60.0, 12.0, 6.0) == pytest.approx(30.0)


def test_views_of_the_same_place_count_once() -> None:
    def view(x: float, theta: float, gain_m2: float) -> View:
        return View(SE2(x, 0.0, theta), gain_m2=gain_m2, distance_m=1.0, landmarks=50, utility=gain_m2 / 3.0)

    assert left_to_see([], 3.0) == 0.0
    assert left_to_see([view(0.0, 0.0, 2.0), view(0.2, 0.1, 3.0), view(0.4, 0.0, 1.0)], 3.0) == 3.0
    assert left_to_see([view(0.0, 0.0, 2.0), view(0.0, np.pi, 3.0)], 3.0) == 5.0


@pytest.mark.parametrize(
    ("left_s", "words"),
    [(None, ""), (10.0, "less than a minute left"), (50.0, "about 1 minute left"), (250.0, "about 4 minutes left")],
)
def test_it_is_told_in_words(left_s: float | None, words: str) -> None:
    assert left_words(left_s) == words

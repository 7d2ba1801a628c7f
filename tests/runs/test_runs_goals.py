"""The views that a run has driven to, and why it left each."""

from vsx_ros.exploration.choice import Choice
from vsx_ros.exploration.utility import View
from vsx_ros.geometry.se2 import SE2
from vsx_ros.runs.goals import goals_of
from vsx_ros.runs.journal import RunEvent

SECOND = 1_000_000_000


def choice(x: float) -> str:
    view = View(SE2(x, 0.0, 0.0), gain_m2=4.0, distance_m=3.0, landmarks=60, utility=0.8)
    return Choice(view, view).words(2.0)


def events(*told: tuple[str, str]) -> list[RunEvent]:
    return [RunEvent(k * SECOND, source, "mapping", reason) for k, (source, reason) in enumerate(told)]


def test_goals_are_numbered_by_time_and_tell_why_they_were_left() -> None:
    told = events(
        ("mission", "first straight drive"),
        ("mission", choice(1.0)),
        ("navigation", "following"),
        ("mission", choice(2.0)),
        ("mission", "stopping: bumper pressed"),
        ("mission", "goal blacklisted for 30 s: bumper pressed"),
        ("mission", "goal blacklisted for 30 s: bumper pressed"),
        ("mission", "no view found (3 blacklisted) [figures]"),
        ("mission", "turning away"),
        ("mission", choice(3.0)),
    )
    goals = goals_of(told[::-1])
    assert [goal.pose.x for goal in goals] == [1.0, 2.0, 3.0]
    assert [goal.stamp_ns for goal in goals] == [SECOND, 3 * SECOND, 9 * SECOND]
    assert f"{goals[0].words} [{goals[0].figures}]" == choice(1.0)
    assert " [" not in goals[0].words
    assert [goal.left for goal in goals] == [
        "reached",
        "stopping: bumper pressed; goal blacklisted for 30 s: bumper pressed; no view found (3 blacklisted)",
        "",
    ]


def test_a_run_without_choices_has_no_goals() -> None:
    assert goals_of([]) == goals_of(events(("mission", "driving home"))) == []

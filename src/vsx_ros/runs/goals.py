"""The views that a run has driven to, and why it left each, from its events."""

from collections.abc import Sequence
from itertools import pairwise

from vsx_ros.evaluation.report_data import Goal
from vsx_ros.exploration.choice import chosen_in
from vsx_ros.exploration.decision import without_figures
from vsx_ros.runs.journal import RunEvent

_MOST_WORDS = 3  # reasons why one goal was left; the events tell all
REACHED = "reached"


def goals_of(events: Sequence[RunEvent]) -> list[Goal]:
    """By time. A view was reached if the next one was chosen and nothing was told in between."""
    told = sorted((event for event in events if event.source == "mission"), key=lambda event: event.stamp_ns)
    places = [chosen_in(event.reason) for event in told]
    chosen = [k for k, place in enumerate(places) if place is not None]
    goals = []
    for k, end in pairwise([*chosen, len(told)]):
        why = list(dict.fromkeys(without_figures(event.reason) for event in told[k + 1 : end]))
        left = "; ".join(why[:_MOST_WORDS]) or (REACHED if end < len(told) else "")
        if (place := places[k]) is not None:
            words = without_figures(told[k].reason)
            figures = told[k].reason.removeprefix(words).strip(" []")
            goals.append(Goal(stamp_ns=told[k].stamp_ns, pose=place, words=words, figures=figures, left=left))
    return goals

"""What became known, as curves over time and metres; and the time of a run without its interruptions."""

import json
import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence
from dataclasses import replace

import pytest

from vsx_ros.evaluation.report import known_area, render
from vsx_ros.evaluation.report_data import Goal, ProgressRow, ReportData
from vsx_ros.evaluation.run_time import elapsed_s, parts
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3, StampedPose

SECOND = 1_000_000_000


def run(progress: Sequence[ProgressRow]) -> ReportData:
    return ReportData(
        summary={}, facts={}, config_yaml="", events=[], frames=[], estimate=[], truth=[], grid=None, progress=progress
    )


def rows(truth: bool) -> list[ProgressRow]:
    return [
        ProgressRow(
            stamp_ns=k * SECOND, elapsed_s=float(k), driven_m=0.25 * k, known_area_m2=2.0 * k,
            coverage_correct=0.01 * k if truth and k % 2 else None,
        )
        for k in range(50)
    ]  # fmt: skip


def test_what_became_known_is_a_curve_over_time_and_one_over_metres() -> None:
    text = known_area(run(rows(False)))
    pictures = [ElementTree.fromstring(found) for found in re.findall(r"<svg.*?</svg>", text, re.DOTALL)]
    assert len(pictures) == 2
    assert [len(next(picture.iter("polyline")).get("points").split()) for picture in pictures] == [50, 50]
    assert [list(picture.iter("text"))[-1].text for picture in pictures] == ["40 s", "10 m"]
    assert re.findall("<figcaption>(.*?)<", text) == [
        "known area [m2] over time",
        "known area [m2] over the way driven",
    ]
    assert known_area(run([])) == ""


def test_with_the_truth_the_correct_share_has_curves_too() -> None:
    text = known_area(run(rows(True)))
    pictures = [ElementTree.fromstring(found) for found in re.findall(r"<svg.*?</svg>", text, re.DOTALL)]
    assert [len(next(picture.iter("polyline")).get("points").split()) for picture in pictures] == [50, 50, 25, 25]
    assert "known and right" in text


def test_time_leaves_out_what_lies_between_two_sessions() -> None:
    during = parts([5 * SECOND, 0, 10 * SECOND, 100 * SECOND, 120 * SECOND])
    assert during == [(0, 10 * SECOND), (100 * SECOND, 120 * SECOND)]
    at = [0, 5 * SECOND, 10 * SECOND, 50 * SECOND, 100 * SECOND, 120 * SECOND]
    assert elapsed_s(at, during).tolist() == [0.0, 5.0, 10.0, 10.0, 10.0, 30.0]
    assert parts([]) == []
    assert elapsed_s([7], []).tolist() == [0.0]


TEN_HOURS_S = 36_000


@pytest.mark.parametrize(
    ("image_s", "goal_s", "expected"),
    [
        ([*range(60, 81)], [70], ["10.0 s"]),
        ([*range(51), *range(50 + TEN_HOURS_S, 101 + TEN_HOURS_S)], [20, 60 + TEN_HOURS_S], ["20.0 s", "60.0 s"]),
        ([*range(3, 51)], [20, 49], ["20.0 s", "49.0 s"]),
    ],
)
def test_every_part_of_the_report_has_the_same_clock(
    image_s: list[int], goal_s: list[int], expected: list[str]
) -> None:
    """After a long wait for the first image, over a pause, and after a short wait."""
    events = [(0, "mission", "starting", "first drive")]
    chosen = dict(zip(goal_s, ("to the left", "to the right")))
    events += [(second * SECOND, "mission", "mapping", words) for second, words in chosen.items()]
    goals = [Goal(second * SECOND, SE2(1.0, 2.0), words, "", "reached") for second, words in chosen.items()]
    text = render(replace(
        run(rows(False)), events=events, goals=goals,
        frames=[(second * SECOND, "good", 9, 9, False, 5.0, None) for second in image_s],
        estimate=[StampedPose(second * SECOND, SE3.identity()) for second in image_s],
        pictures=[(second * SECOND, b"jpeg") for second in image_s],
    ))  # fmt: skip
    table = re.search('<table class="goals">(.*?)</table>', text)[1]
    assert re.findall(r"<td>([0-9.]+ s)</td>", table) == expected
    assert re.findall("<td>([0-9.]+ s)</td><td>mission</td><td>mapping</td>", text) == expected
    assert re.findall("<title>([0-9.]+ s)  mapping:", text) == expected, "on the band of states"
    scrubbed = json.loads(re.search('<script class="run" type="application/json">(.*?)</script>', text)[1])
    assert [f"{row[0]:.1f} s" for row in scrubbed["decisions"]] == ["0.0 s", *expected]
    assert scrubbed["length"] == scrubbed["pictures"][-1][0] == scrubbed["frames"][-1][0]
    assert f"the way from {scrubbed['frames'][0][0]:.0f} s to {scrubbed['length']:.0f} s" in text

"""What became known, as curves over time and metres; and the time of a run without its interruptions."""

import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence

from vsx_ros.evaluation.report import known_area
from vsx_ros.evaluation.report_data import ProgressRow, ReportData
from vsx_ros.evaluation.run_time import elapsed_s, parts

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

import html
import re
import xml.etree.ElementTree as ElementTree
from itertools import pairwise

import numpy as np
import pytest

from vsx_ros.evaluation import svg
from vsx_ros.evaluation.report import render
from vsx_ros.evaluation.report_data import ReportData
from vsx_ros.evaluation.sheet import grid_image, ticks, window_around
from vsx_ros.evaluation.summary import Summary
from vsx_ros.evaluation.svg import map_view
from vsx_ros.geometry.se3 import SE3, StampedPose, so3_exp
from vsx_ros.occupancy.grid import OccupancyGrid
from vsx_ros.occupancy.rooms import Room

SECOND = 10**9


def poses(n=40, turn=0.0):
    R = so3_exp(np.array([0, 0, turn]))
    return [StampedPose(i * SECOND, SE3(R, R @ np.array([0.1 * i, np.sin(0.2 * i), 0.3]))) for i in range(n)]


def frame(i, u2_frames):
    return i * SECOND, "good" if i < 30 else "lost", 100 * (i < 30), 80, False, 5.0, u2_frames


def page(**changes):
    data = {
        "summary": Summary(
            frames=40, frames_tracked=30, u1=0.8, stop_reason="explored: nothing left", world="lab"
        ).as_dict(),
        "facts": {"command": "vsx explore --set a=<b>", "versions": {"numpy": "2"}},
        "config_yaml": "planner:\n  phi_rad_m: 1.0\n",
        "events": [
            (5 * SECOND, "slam", "lost", "too few points < 30 & fading"),
            (2 * SECOND, "slam", "keyframe", "kf"),
        ],
        "frames": [frame(i, u2_frames=2.0 * i if i >= 10 else None) for i in range(40)],
        "estimate": poses(),
        "truth": poses(turn=1.0),
        "grid": OccupancyGrid(np.array([[0, 100], [-1, 0]]), 1.0, 0.0, 0.0),
        "points_world": np.random.default_rng(0).normal(0, 1, (50, 3)),
    }
    return render(ReportData(**{**data, **changes}))


def drawings(text):
    return [ElementTree.fromstring(found) for found in re.findall(r"<svg.*?</svg>", text, re.DOTALL)]


def test_the_page_tells_the_story_and_escapes_it():
    text = page()
    assert "explored: nothing left" in text
    assert "too few points &lt; 30 &amp; fading" in text
    assert "vsx explore --set a=&lt;b&gt;" in text
    assert "<td>keyframe</td>" not in text
    assert len(drawings(text)) == 5


def test_nothing_is_fetched_from_elsewhere():
    assert not re.search(r'(src|href)="(?!data:)|url\(|<script|@import', page())


def test_both_measures_of_tracking_are_curves_over_the_run():
    found, lives = (
        next(d for d in drawings(page()) if d.find("title").text == title)
        for title in ("found / searched", "U2 so far [frames]")
    )
    assert len(next(found.iter("polyline")).get("points").split()) == 30
    places = [[float(p) for p in place.split(",")] for place in next(lives.iter("polyline")).get("points").split()]
    assert len(places) == 30
    rises = np.diff(np.array(places), axis=0)
    assert rises[:, 0] == pytest.approx(rises[0, 0], abs=0.11)
    assert rises[:, 1] == pytest.approx(rises[0, 1], abs=0.11)
    assert rises[0, 1] < 0


def test_a_run_that_kept_no_lives_of_points_has_no_curve_of_them():
    text = page(frames=[frame(i, u2_frames=None) for i in range(40)])
    assert len(drawings(text)) == 4
    assert "U2 so far" not in text


def test_states_are_told_in_the_words_of_the_live_view():
    """Also of folders that older versions left: the file keeps the core's names."""
    values = ["not initialised", "good", "dubious", "lost", "some day's"]
    told = ["NOT_INITIALISED", "TRACKING", "POOR", "LOST", "some day's"]
    text = page(frames=[(i * SECOND, values[i], 100, 80, False, 5.0, None) for i in range(5)])
    assert [html.unescape(word) for word in re.findall(r'style="--c:#\w+">([^<]+)</span>', text)] == told
    band = next(d for d in drawings(text) if d.find("title").text == "state of the tracking over time")
    since = [f"{word} from {i:.1f} s" for i, word in enumerate(told)]
    assert [rect.find("title").text for rect in band.iter("rect")] == since
    assert len({rect.get("fill") for rect in band.iter("rect")}) == 5
    assert ("TRACKING above" in text, "LOST below" in text) == (True, True)
    assert not re.search("good above|dubious", text)


def test_what_is_unknown_is_not_shown_as_zero():
    text = page()
    assert "80.0 %" in text
    assert "<span>collisions</span>" not in text
    assert "<td>ate_rmse_m</td><td><i>unknown</i></td>" in text


@pytest.mark.parametrize(("well", "kind"), [(True, "fine"), (False, "bad"), (None, "unknown")])
def test_the_ending_is_coloured_by_how_it_was_and_not_by_its_words(well, kind):
    summary = Summary(stop_reason="the map did not start: timed out", ended_well=well).as_dict()
    assert f'class="ending {kind}"' in page(summary=summary)


def test_the_truth_is_laid_over_the_estimate():
    lines = [(line.get("class"), line.get("points").split()) for line in drawings(page())[0].iter("polyline")]
    (truth,) = [points for name, points in lines if name == "truth"]
    pieces = [points for name, points in lines if name == "estimate"]
    assert all(before[-1] == after[0] for before, after in pairwise(pieces))
    assert [pieces[0][0], *(point for piece in pieces for point in piece[1:])] == truth


def test_how_much_of_each_room_is_known_is_told():
    kitchen = Room(3, "kitchen & bar", area_m2=12.34, known_ratio=0.876, place=(0.0, 0.0), outline=())
    assert "<td>3</td><td>kitchen &amp; bar</td><td>12.3 m2</td><td>88 %</td>" in page(rooms=[kitchen])
    assert "<h2>Rooms" not in page()


def test_a_run_that_never_began_still_has_a_page():
    nothing = np.zeros((0, 3))
    text = page(estimate=[], truth=[], grid=None, points_world=nothing, frames=[], events=[], facts={})
    assert "There is no map" in text
    assert "<h2>Events</h2>" not in text


def test_one_frame_one_pose():
    text = page(frames=[(7 * SECOND, "good", 0, 0, True, None, None)], estimate=poses(1), truth=[], grid=None)
    assert len(drawings(text)) == 2


@pytest.mark.parametrize(
    ("low", "high", "expected"), [(0, 1, [0, 0.2, 0.4, 0.6, 0.8, 1.0]), (0, 95, [0, 20, 40, 60, 80]), (3, 3, [3])]
)
def test_ticks_are_round(low, high, expected):
    assert ticks(low, high, 6) == pytest.approx(expected)


def test_a_curve_breaks_where_nothing_is_known():
    seconds, values = np.arange(6.0), np.array([1.0, 1.0, np.nan, np.nan, 0.5, 0.5])
    curves = list(drawings(svg.plot([("curve", seconds, values)], "x"))[0].iter("polyline"))
    assert len(curves) == 2
    heights = [float(c.get("points").split()[0].split(",")[1]) for c in curves]
    assert heights[0] < heights[1]


def test_an_axis_of_decades_gives_each_the_same_height():
    line = "curve", np.arange(4.0), np.array([0.5, 10.0, 100.0, 5000.0])
    drawing = drawings(svg.plot([line], "x", 1000.0, bottom=1.0))[0]
    heights = [float(place.split(",")[1]) for place in next(drawing.iter("polyline")).get("points").split()]
    lines = [float(line.get("y1")) for line in drawing.iter("line")]
    assert len(lines) == 4
    assert np.diff(lines) == pytest.approx(np.diff(lines)[0], abs=0.11)
    assert heights == [lines[0], lines[1], lines[2], lines[3]]


@pytest.mark.parametrize(
    ("low", "high", "expected"), [(6.7, 1600.0, [1, 10, 100, 1000, 10000]), (10.0, 10.0, [10, 100])]
)
def test_decades_hold_all_values(low, high, expected):
    assert svg.decades(low, high) == pytest.approx(expected)


def test_the_map_is_drawn_to_scale():
    way = [[0.0, 0.0], [3.0, 0.0], [3.0, 4.0]]
    drawing = drawings(map_view(None, [("estimate", way)], window_around([way])))[0]
    line = next(iter(drawing.iter("polyline"))).get("points").split()
    a, b, c = (np.array(p.split(","), float) for p in line)
    assert np.linalg.norm(c - b) / np.linalg.norm(b - a) == pytest.approx(4 / 3, abs=0.01)
    assert c[1] < b[1]
    bar = next(p for p in drawing.iter("path") if p.get("class") == "bar").get("d")
    metres = float(next(t.text for t in drawing.iter("text")).split()[0])
    assert float(bar.split("h")[1]) / metres == pytest.approx(np.linalg.norm(b - a) / 3, rel=0.01)


def test_the_grid_picture_has_north_up():
    picture = grid_image(OccupancyGrid(np.array([[0, 100], [-1, 0]]), 1.0, 0.0, 0.0))
    assert picture[1, 0, :3].tolist() == [255, 255, 255]
    assert picture[1, 1, 0] < 60
    assert picture[0, 0, 3] < 255


def test_the_report_begins_with_the_verdict_where_when_and_what_the_camera_saw():
    png = b"\x89PNG\r\n\x1a\n"
    summary = Summary(stop_reason="explored: nothing left", world="lab", seed=3).as_dict()
    text = page(summary=summary, facts={"command": "vsx explore", "date": "2026-05-04 10:20:30"}, picture_png=png)
    found = [text.index(words) for words in (
        "explored: nothing left", "world lab, seed 3, date 2026-05-04 10:20:30", "<pre>vsx explore</pre>",
        'alt="the newest keyframe" src="data:image/png;base64,iVBORw0KGgo="', 'class="tiles"',
    )]  # fmt: skip
    assert found == sorted(found)
    assert "newest keyframe" not in page()


def test_events_begin_at_zero_also_those_before_the_first_image():
    text = page(events=[(-3 * SECOND, "mission", "starting", "first drive"), (5 * SECOND, "slam", "lost", "dark")])
    assert "<td>0.0 s</td><td>mission</td>" in text
    assert "<td>8.0 s</td><td>slam</td>" in text


def test_events_are_told_without_their_figures():
    text = page(events=[(5 * SECOND, "mission", "mapping", "driving 1.2 m to look at 3 m2 [view at (1.0, 2.0)]")])
    assert "<td>driving 1.2 m to look at 3 m2</td>" in text

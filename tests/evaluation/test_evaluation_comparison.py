"""Two runs on one page, and the pieces that pages are made of."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from chromium import Chromium

from vsx_ros.evaluation.comparison import change, compare
from vsx_ros.evaluation.page import Section, figures, interval, page, table
from vsx_ros.evaluation.paired import Interval
from vsx_ros.evaluation.report_data import ReportData
from vsx_ros.evaluation.sheet import window_around, window_of
from vsx_ros.evaluation.svg import map_view, plot
from vsx_ros.occupancy.grid import FREE, OccupancyGrid

A = ReportData(
    summary={"stop_reason": "time limit", "u1": 0.5, "breaks": 2, "world": "lab", "coverage": None},
    facts={"command": "vsx explore <a>", "versions": {"numpy": "1"}},
    config_yaml="planner:\n  phi_rad_m: 1.0\nlimits:\n  v_m_s: 0.3\n",
    events=[],
    frames=[(0, "good", 10, 5, False, 3.0, 4.0), (10**9, "lost", 10, 0, False, 3.0, 4.0)],
    estimate=[],
    truth=[],
    grid=None,
)
B = replace(
    A,
    summary={"stop_reason": "explored", "u1": 0.75, "breaks": 3, "world": "lab", "coverage": None},
    config_yaml=A.config_yaml.replace("1.0", "0.5"),
)
GRID = OccupancyGrid(np.full((20, 40), FREE, np.int8), 0.1, -1.0, -1.0)


def test_the_page_says_what_differs_and_which_way_is_better():
    text = compare(("before", A), ("after", B))
    assert '<td class="better">+0.25 (+50 %)</td>' in text
    assert '<td class="worse">+1 (+50 %)</td>' in text
    assert "- planner.phi_rad_m: 1.0\n+ planner.phi_rad_m: 0.5" in text
    assert "v_m_s" not in text
    assert "coverage" not in text
    assert "vsx explore &lt;a&gt;" in text
    assert text.index("before") < text.index("time limit") < text.index("explored")
    assert not re.search(r'(src|href)="(?!data:)|url\(|<script', text)


@pytest.mark.parametrize(("width", "height"), [(1440, 900), (390, 844)])
def test_it_fits_a_desk_and_a_phone(browser: Chromium, tmp_path: Path, width: int, height: int) -> None:
    facts = {"command": "vsx explore --fast --world lab" + 20 * " --set slam.tracker.good_ratio=0.5"}
    summary = {**A.summary, "planned_vs_executed_rms_m": 0.0123, "ate_final_rmse_sim3_m": 0.0123}
    page = compare(("the-run-before", replace(A, facts=facts, summary=summary)), ("the-run-after", B))
    (tmp_path / "page.html").write_text(page, encoding="utf-8")
    browser.size(width, height)
    browser.open((tmp_path / "page.html").as_uri())
    browser.wait("location.protocol === 'file:' && document.readyState === 'complete'")
    assert browser.evaluate("document.documentElement.scrollWidth") <= width


def test_same_runs_differ_in_nothing():
    text = compare(("a", A), ("b", A))
    assert "same options, same configuration, same versions" in text
    assert 'class="better"' not in text
    assert 'class="worse"' not in text


def test_other_worlds_and_times_are_settings_that_differ():
    facts = {"command": "x", "date": "today", "world": "lab", "seed": 1, "time": 60.0}
    other = {**facts, "command": "y", "date": "later", "world": "office", "time": 90.0}
    text = compare(("a", replace(A, facts=facts)), ("b", replace(A, facts=other)))
    assert "<pre>- world: lab\n+ world: office\n- time: 60.0\n+ time: 90.0</pre>" in text
    assert "later" not in text


def test_settings_have_the_names_that_set_takes():
    tracker, noise = "  tracker:\n    ratio: 0.3  # share: of points\n", "  odometry_noise:\n    noise_px: 1.0\n"
    deep = f"# a: comment\nslam:\n{tracker}{noise}limits:\n  v_m_s: 0.3\n"
    text = compare(("a", replace(A, config_yaml=deep)), ("b", replace(A, config_yaml=deep.replace("1.0", "2.0"))))
    assert "<pre>- slam.odometry_noise.noise_px: 1.0\n+ slam.odometry_noise.noise_px: 2.0</pre>" in text


@pytest.mark.parametrize(
    ("key", "before", "after", "told"),
    [
        ("ate_rmse_m", 0.1, 0.05, ("-0.05 (-50 %)", "better")),
        ("coverage", 0.9, 0.8, ("-0.1 (-11 %)", "worse")),
        ("keyframes", 10, 12, ("+2 (+20 %)", "")),
        ("breaks", 0, 1, ("+1", "worse")),
        ("u1", 0.5, 0.5, ("same", "")),
        ("u1", None, 0.5, ("", "")),
        ("world", "lab", "office", ("", "")),
        ("seed", 1, 2, ("", "")),
    ],
)
def test_changes(key, before, after, told):
    assert change(key, before, after) == told


def test_ways_are_where_they_belong():
    way = [[0.0, 0.0], [1.0, 0.0], None, [2.0, 0.5], [2.5, 0.5]]
    picture = map_view(GRID, [("planned", way)], window_of(GRID), marks=[("broke", (1, 0))], width_px=240.0)
    assert picture.count("<polyline") == 2
    assert 'points="60.0,60.0 120.0,60.0"' in picture  # 60 px a metre from the corner (-1, 1)
    assert '<circle class="broke" cx="120.0" cy="60.0"' in picture
    near = map_view(GRID, [("planned", way[:2])], window_around([way[:2]], 0.5), width_px=120.0)
    assert 'viewBox="0 0 120 60"' in near
    assert 'points="30.0,30.0 90.0,30.0"' in near
    assert '<image x="-30.0" y="-30.0" width="240.0" height="120.0"' in near
    many = map_view(GRID, [], window_of(GRID), dots=np.zeros((9000, 2)), width_px=240.0)
    assert 2000 < many.count("M60.0,60.0h0") <= 4000


def test_nothing_has_a_window_too():
    low, high = window_around([[None], []])
    assert (high > low).all()


def test_curves_end_where_the_data_do():
    x, y = np.array([0.0, 5.0, 10.0]), np.array([0.0, 1.0, 2.0])
    drawing = plot([("first", x, y)], "share", 2.0, unit="m", size=(540.0, 260.0))
    x, y = drawing.split('points="')[1].split('"')[0].split()[-1].split(",")
    assert (float(x), float(y)) == (528.0, 12.0)
    assert ">10 m</text>" in drawing


def test_pieces_of_a_page_are_safe():
    body = table(["a", "b"], [["<x>", "1"]]) + figures([("c & d", "<svg></svg>")])
    text = page("T <1>", "facts", [Section("S & S", body)])
    assert "&lt;x&gt;" in text
    assert "c &amp; d" in text
    assert "<h2>S &amp; S</h2>" in text
    assert "T &lt;1&gt;" in text
    assert interval(Interval(0.5, 0.25, 0.75)) == "0.50 [0.25, 0.75]"
    assert interval(None) == "unknown"


def test_a_page_of_one_section_says_its_title_once():
    assert "<h2>" not in page("Figure 5", "facts", [Section("Figure 5", "body")])

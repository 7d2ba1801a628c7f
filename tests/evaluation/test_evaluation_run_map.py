"""The map of a run: axes in metres, the way coloured by time, numbered goals."""

import re
import xml.etree.ElementTree as ElementTree
from itertools import pairwise

import numpy as np
import pytest
from chromium import Chromium

from vsx_ros.evaluation.report import goal_table, render
from vsx_ros.evaluation.report_data import Goal, ProgressRow, ReportData
from vsx_ros.evaluation.run_map import map_picture
from vsx_ros.evaluation.summary import Summary
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3, StampedPose
from vsx_ros.occupancy.grid import FREE, OccupancyGrid

SECOND = 1_000_000_000
WORDS = "driving 3.0 m to look at 4.0 m2 of unknown ground; second best: 3.0 m2 after 2.0 m"
FIGURES = "view at <U>; second <U>"


PROGRESS = [
    ProgressRow(stamp_ns=k * SECOND, elapsed_s=k, driven_m=0.2 * k, known_area_m2=2.0 * k, coverage_correct=0.01 * k)
    for k in range(50)
]


def room(width_m: float, height_m: float, x: float = -3.0, y: float = -2.0) -> OccupancyGrid:
    data = np.full((round(height_m / 0.05), round(width_m / 0.05)), FREE, np.int8)
    return OccupancyGrid(data, 0.05, x, y)


def run(grid: OccupancyGrid | None, n: int = 200, **changes: object) -> ReportData:
    """A straight way from (0, 0) to (4, 0) in n seconds."""
    way = [StampedPose(k * SECOND, SE3(np.eye(3), np.array([4.0 * k / max(n - 1, 1), 0.0, 0.3]))) for k in range(n)]
    data = {
        "summary": Summary(stop_reason="explored", world="lab").as_dict(), "facts": {}, "config_yaml": "", "events": [],
        "frames": [(k * SECOND, "good", 9, 9, False, 5.0, None) for k in range(n)], "estimate": way, "truth": [],
        "grid": grid,
    }  # fmt: skip
    return ReportData(**{**data, **changes})


def goal(x: float, y: float, second: int = 0, left: str = "reached") -> Goal:
    return Goal(stamp_ns=second * SECOND, pose=SE2(x, y, 0.0), words=WORDS, figures=FIGURES, left=left)


def drawing(data: ReportData) -> ElementTree.Element:
    return ElementTree.fromstring(re.search(r"<svg.*?</svg>", map_picture(data), re.DOTALL)[0])


def texts(picture: ElementTree.Element, name: str) -> list[tuple[str, float, float]]:
    found = [text for text in picture.iter("text") if text.get("class") == name]
    return [(str(text.text), float(text.get("x", "nan")), float(text.get("y", "nan"))) for text in found]


def colours(picture: ElementTree.Element) -> list[tuple[int, ...]]:
    styles = [line.get("style") for line in picture.iter("polyline") if line.get("class") == "estimate"]
    return [tuple(bytes.fromhex(style.partition("#")[2])) for style in styles]


@pytest.mark.parametrize(
    ("width_m", "height_m", "step"),
    [(8.0, 6.0, 1.0), (40.0, 25.0, 5.0), (25.0, 40.0, 5.0), (1.5, 1.0, 0.2), (300.0, 9.0, 50.0)],
)  # fmt: skip
def test_the_axes_have_round_steps_that_can_be_told_apart(width_m: float, height_m: float, step: float) -> None:
    picture = drawing(run(room(width_m, height_m), 0))
    ticks = texts(picture, "tick")
    _, _, width, height = (float(size) for size in picture.get("viewBox").split())
    lines = picture.find("path[@class='metres']").get("d")
    across = [float(x) for x in re.findall(r"M([0-9.]+) 0V", lines)]
    assert np.diff(across).min() >= 63.0
    assert np.diff(across) == pytest.approx(np.diff(across)[0], abs=0.11)
    below = [(float(text), x) for text, x, y in ticks if y > height - 10]
    aside = [(float(text), y) for text, x, y in ticks if x < 10]
    for values in (below, aside):
        assert np.diff([value for value, _ in values]) == pytest.approx(np.full(len(values) - 1, step))
    scale = (below[1][1] - below[0][1]) / step
    assert (-2.0 + height_m - aside[0][0]) * scale < height + 5
    assert {x for _, x in below} <= set(across)
    assert [text for text, _, _ in texts(picture, "axis")] == ["x [m]", "y [m]"]
    assert max(width, height) <= 900.0


def test_numbers_of_the_axes_are_those_of_the_map() -> None:
    picture = drawing(run(room(8.0, 6.0), goals=[goal(2.0, 1.0)]))
    disc = next(iter(picture.iter("g"))).find("circle")
    x = {text: x for text, x, y in texts(picture, "tick") if x > 10}
    y = {text: y for text, x, y in texts(picture, "tick") if x < 10}
    assert float(disc.get("cx")) == pytest.approx(x["2"], abs=0.1)
    assert float(disc.get("cy")) == pytest.approx(y["1"] - 4.0, abs=0.1), "the number stands beside its line"


def test_a_map_without_metres_says_so() -> None:
    data = run(None, world_is_level=False)
    assert [text for text, _, _ in texts(drawing(data), "axis")] == ["x [map units]", "z [map units]"]
    assert "no odometry, hence no scale" in map_picture(data)
    assert " m]" not in map_picture(data)


def test_the_way_is_coloured_by_time_from_blue_to_red() -> None:
    seen = colours(drawing(run(room(8.0, 6.0))))
    assert len(seen) == 60
    assert seen[0][2] > 2 * seen[0][0]
    assert seen[-1][0] > 4 * seen[-1][2]
    assert all(after[0] >= before[0] for before, after in pairwise(seen))
    text = map_picture(run(room(8.0, 6.0)))
    assert "the way from 0 s to 199 s" in text
    assert "linear-gradient(90deg,#1f5fd6," in text


def test_an_interruption_takes_no_colours() -> None:
    way = [StampedPose((k + 90_000 * (k >= 100)) * SECOND, SE3.identity()) for k in range(200)]
    frames = [(pose.stamp_ns, "good", 9, 9, False, 5.0, None) for pose in way]
    data = run(room(8.0, 6.0), estimate=way, frames=frames)
    assert len(colours(drawing(data))) == 60
    assert "the way from 0 s to 198 s" in map_picture(data)


def test_goals_and_the_way_count_the_same_time_from_the_first_event_without_interruptions() -> None:
    way = [StampedPose((k + 90_000 * (k >= 100)) * SECOND, SE3.identity()) for k in range(200)]
    frames = [(pose.stamp_ns, "good", 9, 9, False, 5.0, None) for pose in way]
    goals = [goal(1.0, 1.0, 50), goal(1.0, 2.0, 90_100), goal(1.0, 3.0, 90_150)]
    data = run(room(8.0, 6.0), estimate=way, frames=frames, goals=goals, events=[(-3 * SECOND, "mission", "a", "b")])
    assert "the way from 3 s to 201 s" in map_picture(data)
    titles = [group.find("title").text for group in drawing(data).iter("g") if group.get("class") == "goal"]
    assert [title.partition(":")[0] for title in titles] == ["1 at 53.0 s", "2 at 102.0 s", "3 at 152.0 s"]
    assert re.findall(r"<td>([0-9.]+ s)</td>", goal_table(data)) == ["53.0 s", "102.0 s", "152.0 s"]


@pytest.mark.parametrize("n", [0, 1, 2])
def test_hardly_a_way_is_drawn_too(n: int) -> None:
    assert len(colours(drawing(run(room(8.0, 6.0), n)))) == n


def test_goals_are_numbered_beside_their_places_and_hide_none() -> None:
    rng = np.random.default_rng(0)
    goals = [goal(x, y, 5 * k) for k, (x, y) in enumerate(rng.uniform([-2.0, -1.5], [4.0, 3.0], (60, 2)).tolist())]
    goals += [goal(1.0, 1.0, 400 + k) for k in range(3)]
    picture = drawing(run(room(8.0, 6.0), goals=goals))
    groups = [group for group in picture.iter("g") if group.get("class") == "goal"]
    assert len(groups) == len(goals)
    assert groups[2].find("title").text == f"3 at 10.0 s: {WORDS}"
    labels = [group.find("text") for group in groups]
    assert [label.text for label in labels] == [str(k) for k in range(1, 64)]
    boxes = np.array(
        [(x := float(t.get("x")), y := float(t.get("y")), x + 9.0 * len(t.text), y - 13.0) for t in labels]
    )
    for k, (left, low, right, high) in enumerate(boxes.tolist()):
        others = np.delete(boxes, k, axis=0)
        apart = (others[:, 0] >= right) | (others[:, 2] <= left) | (others[:, 1] <= high) | (others[:, 3] >= low)
        assert apart.all(), labels[k].text


def test_hundreds_of_goals_at_one_place_and_goals_far_outside_are_no_trouble() -> None:
    goals = [goal(1.0, 1.0, k) for k in range(600)]
    picture = drawing(run(room(8.0, 6.0), goals=[*goals, goal(900.0, 0.0)]))
    groups = [group for group in picture.iter("g") if group.get("class") == "goal"]
    assert len(groups) == 600
    assert 10 < sum(group.find("text") is not None for group in groups) < 100


def test_the_goals_are_told_with_what_came_second_and_why_they_were_left() -> None:
    text = goal_table(
        run(None, goals=[goal(1.0, 2.0, 7), goal(1.0, 2.0, 9, "goal <blacklisted> for 30 s"), goal(0, 0, 9, "")])
    )
    assert (
        "<tr><td>1</td><td>7.0 s</td><td><details><summary>driving 3.0 m to look at 4.0 m2 of unknown ground; second"
        in text
    )
    assert "</summary>view at &lt;U&gt;; second &lt;U&gt;</details>" in text
    assert "left: reached" in text
    assert "left: goal &lt;blacklisted&gt; for 30 s" in text
    assert text.count("left: ") == 2
    assert goal_table(run(None)) == ""
    many = goal_table(run(None, goals=[goal(1.0, 2.0)] * 412))
    assert (many.count("<tr>"), "... and 12 more in events.jsonl" in many) == (401, True)


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [1440, 390])
def test_it_fits_and_can_be_read(browser: Chromium, tmp_path, width: int, scheme: str) -> None:
    goals = [goal(0.5 * k, 0.3 * k, k, "goal blacklisted for 30 s: " + "blocked " * 20) for k in range(6)]
    path = tmp_path / "report.html"
    path.write_text(render(run(room(40.0, 25.0), goals=goals, progress=PROGRESS)), encoding="utf-8")
    browser.size(width, 900)
    browser.scheme(scheme)
    browser.open(path.as_uri())
    browser.wait(
        f"location.href.includes({tmp_path.name!r}) && document.querySelectorAll('svg.run .goal').length === 6"
    )
    assert browser.evaluate("document.documentElement.scrollWidth <= innerWidth")
    small = browser.evaluate("""Math.min(...Array.from(document.querySelectorAll('svg text')).map(text =>
        parseFloat(getComputedStyle(text).fontSize) * text.ownerSVGElement.getScreenCTM().a))""")
    assert small >= (8.0 if width < 700 else 11.0), "px"
    ratio = browser.evaluate("""(() => {
        const light = colour => colour.match(/[0-9.]+/g).slice(0, 3).map(Number).map(v => v / 255)
            .map(v => v <= 0.03928 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4);
        const bright = colour => { const [r, g, b] = light(colour); return 0.2126 * r + 0.7152 * g + 0.0722 * b; };
        const style = name => getComputedStyle(document.querySelector(name));
        const apart = (ink, paper) => (Math.max(ink, paper) + 0.05) / (Math.min(ink, paper) + 0.05);
        const ground = bright(style("svg.run").backgroundColor), paper = bright(style("body").backgroundColor);
        const drawn = [".tick", ".axis", ".goal text"].map(name => bright(style("svg.run " + name).fill));
        const told = [".goals summary", ".goals .left", "figcaption"].map(name => bright(style(name).color));
        return Math.min(...drawn.map(ink => apart(ink, ground)), ...told.map(ink => apart(ink, paper))); })()""")
    assert 4.5 <= ratio <= 21.0, "AA"

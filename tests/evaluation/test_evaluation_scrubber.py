"""Any second of a run in its report, used in a real browser: camera, map, robot and decision of that second."""

import base64
import json
import re
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from chromium import Chromium

from vsx_ros.evaluation.report import render
from vsx_ros.evaluation.report_data import MapPicture, ReportData
from vsx_ros.evaluation.scrubber import scrubber
from vsx_ros.evaluation.summary import Summary
from vsx_ros.geometry.mount import mount_pose
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3, StampedPose

SECOND = 1_000_000_000
BEGAN = 1_700_000_000 * SECOND
MOUNT = mount_pose(0.1, 0.0, 0.3, 0.0)
PAUSE_S, LENGTH_S = 80_000, 20  # an interruption, and each of the two parts of the run
SECONDS = [*range(LENGTH_S + 1), *range(PAUSE_S, PAUSE_S + LENGTH_S + 1)]


def stamp(second: float) -> int:
    return BEGAN + round(second * SECOND)


def jpeg(second: int) -> bytes:
    return bytes(cv2.imencode(".jpg", np.full((48, 64), 5 * SECONDS.index(second), np.uint8))[1])


def map_picture(second: int) -> MapPicture:
    """A square that grows to the right and upwards; from 10 s on."""
    side = second % PAUSE_S + 1
    png = bytes(cv2.imencode(".png", np.full((side, side), 254, np.uint8))[1])
    return MapPicture(
        stamp_ns=stamp(second),
        png=png,
        origin=(-1.0, -1.0),
        size=(0.5 * side, 0.5 * side),
        known_area_m2=0.25 * side**2,
    )


def base_at(second: float) -> SE2:
    return SE2(0.1 * (second % PAUSE_S), 2.0, 0.5)


def run(**changes: Any) -> ReportData:
    """The camera is lost from 5 to 8 s."""
    lost = [5 <= second < 8 for second in SECONDS]
    data = {
        "summary": Summary(frames=42, stop_reason="explored: nothing left", world="lab").as_dict(),
        "facts": {"command": "vsx explore"},
        "config_yaml": "",
        "events": [
            (stamp(0), "mission", "starting", "first straight drive"),
            (stamp(2), "mission", "mapping", "driving 1.2 m to look at </script> & <b>walls</b> [U = 1.5 m2 / 3 m]"),
            (stamp(5), "slam", "lost", "3 of 90 points"),
            (stamp(5.5), "mission", "recovering", "tracking lost"),
            (stamp(10), "navigation", "following", ""),
            (stamp(PAUSE_S + 1), "mission", "mapping", "driving on"),
            (stamp(4), "slam", "keyframe", "nothing to tell"),
        ],
        "frames": [
            (stamp(second), "lost" if gone else "good", 100, 3 if gone else 80, False, 5.0, None)
            for second, gone in zip(SECONDS, lost, strict=True)
        ],
        "estimate": [
            StampedPose(stamp(second), SE3.from_se2(base_at(second)) @ MOUNT)
            for second, gone in zip(SECONDS, lost, strict=True)
            if not gone
        ],
        "truth": [],
        "grid": None,
        "pictures": [(stamp(second), jpeg(second)) for second in SECONDS],
        "maps": [map_picture(second) for second in SECONDS[10:]],
        "T_base_cam": MOUNT,
        "robot_radius_m": 0.18,
    }
    return ReportData(**{**data, **changes})


def known(page: str) -> dict[str, Any]:
    return dict(json.loads(re.search(r'<script class="run" type="application/json">(.*?)</script>', page)[1]))


def test_what_the_page_knows() -> None:
    told = known(scrubber(run()))
    assert told["length"] == 2 * LENGTH_S
    assert [row[0] for row in told["pictures"]] == [*range(LENGTH_S + 1), *range(LENGTH_S, 2 * LENGTH_S + 1)]
    assert base64.b64decode(told["pictures"][7][1]) == jpeg(7)
    assert [row[1] for row in told["decisions"]] == ["starting", "mapping", "recovering", "mapping"]
    assert told["others"] == [[5, "slam", "lost", "3 of 90 points"], [10, "navigation", "following", ""]]
    assert [row[0] for row in told["maps"]][:2] == [10, 11]
    assert told["maps"][0][4] == pytest.approx(0.25 * 11**2, abs=0.1)
    frames = {row[0]: row[1:] for row in told["frames"]}
    assert frames[6] == ["LOST", 3, 100]
    assert frames[9][:3] == ["TRACKING", 80, 100]
    assert frames[9][4] == pytest.approx(-28.6, abs=0.6), "clockwise, as pictures turn"


def test_places_are_those_of_the_base_on_the_map() -> None:
    told = known(scrubber(run()))
    _, corner, width, height, *_ = told["maps"][-1]
    left, top = (float(px) for px in corner.split(","))
    x, y = (float(px) for px in told["frames"][-1][4].split(","))
    scale = width / (0.5 * (LENGTH_S + 1))
    assert width == height
    here = base_at(SECONDS[-1])
    assert (x - left) / scale == pytest.approx(here.x + 1.0, abs=0.01)
    assert (top + height - y) / scale == pytest.approx(here.y + 1.0, abs=0.01)


def test_without_a_floor_the_camera_moves_in_its_own_plane() -> None:
    looks = SE3(np.eye(3), np.array([1.0, 7.0, 3.0]))
    told = known(scrubber(run(world_is_level=False, maps=[], estimate=[StampedPose(stamp(0), looks)])))
    assert told["frames"][0][5] == -90, "along z, which is up on this map"
    assert not any(len(row) > 4 for row in told["frames"][1:])


def test_hours_take_hardly_more_room() -> None:
    frames = [(stamp(0.1 * k), "good", 100, 80, False, 5.0, None) for k in range(100_000)]
    told = known(scrubber(run(frames=frames)))
    assert 3000 < len(told["frames"]) <= 4001


def test_runs_that_kept_nothing_have_no_such_part_or_say_why() -> None:
    assert scrubber(run(pictures=[], maps=[])) == ""
    assert scrubber(run(pictures=[], maps=[], moments_trouble="it is <damaged>")) == "<p>it is &lt;damaged&gt;</p>"
    assert "<script" not in render(run(pictures=[], maps=[]))


@pytest.fixture
def page(browser: Chromium, tmp_path: Path) -> Chromium:
    (tmp_path / "report.html").write_text(render(run()), encoding="utf-8")
    browser.requested.clear()
    browser.open((tmp_path / "report.html").as_uri())
    browser.wait(
        f"location.href.includes({tmp_path.name!r}) && document.querySelector('.scrub .camera').naturalWidth === 64"
    )
    return browser


def press(page: Chromium, key: str, shift: bool = False) -> None:
    code = {"ArrowLeft": 37, "ArrowRight": 39, " ": 32, "Tab": 9, "End": 35}[key]
    about = {"key": key, "windowsVirtualKeyCode": code, "modifiers": 8 if shift else 0}
    page.call("Input.dispatchKeyEvent", type="keyDown", **about, **({"text": " "} if key == " " else {}))
    page.call("Input.dispatchKeyEvent", type="keyUp", **about)


def click(page: Chromium, selector: str, across: float = 0.5) -> None:
    """As a finger does, in the middle, or at this share of the width."""
    page.evaluate(f"document.querySelector('{selector}').scrollIntoView({{block: 'center'}})")
    box = page.evaluate(
        f"(b => [b.left, b.top, b.width, b.height])(document.querySelector('{selector}').getBoundingClientRect())"
    )
    for kind in ("mousePressed", "mouseReleased"):
        page.call(
            "Input.dispatchMouseEvent", type=kind, x=box[0] + across * box[2], y=box[1] + 0.5 * box[3], button="left",
            clickCount=1,
        )  # fmt: skip


def text(page: Chromium, name: str) -> str:
    return str(page.evaluate(f"document.querySelector('.scrub .{name}').textContent"))


def seen(page: Chromium) -> int:
    """The second whose picture is shown."""
    url = page.evaluate("document.querySelector('.scrub .camera').src").partition(",")[2]
    return next(second for second in SECONDS if jpeg(second) == base64.b64decode(url))


def test_keys_go_through_the_seconds(page: Chromium) -> None:
    assert (text(page, "now"), seen(page), text(page, "mapAt")) == ("0 s of 40 s", 0, "no map yet")
    assert text(page, "state") == "STARTING"
    for _ in range(3):
        press(page, "ArrowRight")
    assert (seen(page), text(page, "now")) == (3, "3 s of 40 s")
    assert text(page, "state") == "MAPPING"
    assert text(page, "reason") == "Driving 1.2 m to look at </script> & <b>walls</b>"
    assert text(page, "figures") == "decided at 2.0 s · U = 1.5 m2 / 3 m"
    assert text(page, "tracking") == "camera TRACKING, 80 of 100 points found"
    press(page, "ArrowRight", shift=True)
    assert seen(page) == 13
    assert (
        text(page, "mapAt")
        == f"{0.25 * 14**2:.1f} m² known, {round(100 * 14**2 / 21**2)} % of what became known in this run"
    )
    press(page, "ArrowLeft")
    press(page, "ArrowLeft", shift=True)
    assert seen(page) == 2
    assert [url for url in page.requested if not url.startswith(("file:", "data:", "about:"))] == []


def test_a_lost_camera_is_told_and_its_robot_is_unsure(page: Chromium) -> None:
    for _ in range(6):
        press(page, "ArrowRight")
    assert text(page, "tracking") == "camera LOST, 3 of 100 points found"
    assert text(page, "others") == "5.0 s, slam: lost, 3 of 90 points"
    assert page.evaluate("document.querySelector('.robot').classList.contains('unsure')")
    way = "document.querySelector('.scrub polyline').getAttribute('points').split(' ').length"
    assert page.evaluate(way) == 5, "as far as it is known"
    for _ in range(3):
        press(page, "ArrowRight")
    assert not page.evaluate("document.querySelector('.robot').classList.contains('unsure')")
    assert page.evaluate(way) == 7
    place = known(scrubber(run()))["frames"][9][4]
    assert page.evaluate("document.querySelector('.robot').getAttribute('transform')").startswith(f"translate({place})")
    press(page, "ArrowRight")
    assert text(page, "others") == "10.0 s, navigation: following"


def test_the_slider_leaves_out_the_interruption(page: Chromium) -> None:
    assert page.evaluate("document.querySelector('.slider').max") == "40"
    click(page, ".slider", 0.75)
    assert seen(page) in range(PAUSE_S + 8, PAUSE_S + 13)
    press(page, "End")
    assert (seen(page), text(page, "now")) == (SECONDS[-1], "40 s of 40 s")
    assert text(page, "figures") == "decided at 21.0 s"
    assert "100 % of what became known" in text(page, "mapAt")


def test_buttons_go_from_decision_to_decision(page: Chromium) -> None:
    places = []
    for name in ("after", "after", "after", "before", "before", "before"):
        click(page, f".scrub .{name}")
        places.append((text(page, "state"), page.evaluate("document.querySelector('.slider').value")))
    told = [
        ("MAPPING", "2"),
        ("RECOVERING", "6"),
        ("MAPPING", "21"),
        ("RECOVERING", "6"),
        ("MAPPING", "2"),
        ("STARTING", "0"),
    ]
    assert places == told


def test_it_plays_pauses_and_ends(page: Chromium) -> None:
    click(page, ".scrub .play")
    page.wait("Number(document.querySelector('.slider').value) >= 3")
    assert page.evaluate("document.querySelector('.play').getAttribute('aria-label')") == "pause"
    click(page, ".scrub .play")
    here = page.evaluate("document.querySelector('.slider').value")
    page.evaluate("new Promise(done => setTimeout(done, 400))")
    assert page.evaluate("document.querySelector('.slider').value") == here
    page.evaluate("document.querySelector('.speed').value = '60'; document.querySelector('.slider').focus()")
    press(page, " ")
    page.wait("document.querySelector('.slider').value === '40'")
    page.wait("document.querySelector('.play').getAttribute('aria-label') === 'play'")
    assert seen(page) == SECONDS[-1]


@pytest.mark.parametrize("dark", [False, True])
@pytest.mark.parametrize(("width", "height"), [(1440, 900), (390, 844)])
def test_it_fits_and_can_be_read(page: Chromium, width: int, height: int, dark: bool) -> None:
    page.call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=width < 500)
    scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
    page.call("Emulation.setEmulatedMedia", features=[scheme])
    click(page, ".slider", 0.4)
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
    boxes = page.evaluate(
        "Array.from(document.querySelectorAll('.scrub button, .scrub select, .scrub .slider')).map(control => { "
        "const box = control.getBoundingClientRect(); return [box.width, box.height, box.left, box.right]; })"
    )
    assert len(boxes) == 5
    assert all(w >= 44 and h >= 44 and left >= 0 and right <= width for w, h, left, right in boxes), boxes
    ratio = page.evaluate("""(() => {
        const light = colour => colour.match(/[0-9.]+/g).slice(0, 3).map(Number).map(v => v / 255)
            .map(v => v <= 0.03928 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4);
        const bright = colour => { const [r, g, b] = light(colour); return 0.2126 * r + 0.7152 * g + 0.0722 * b; };
        const paper = bright(getComputedStyle(document.body).backgroundColor);
        return Math.min(...["state", "reason", "now", "figures", "mapAt"].map(name => {
            const ink = bright(getComputedStyle(document.querySelector(".scrub ." + name)).color);
            return (Math.max(ink, paper) + 0.05) / (Math.min(ink, paper) + 0.05); })); })()""")
    assert 4.5 <= ratio <= 21, "AA"

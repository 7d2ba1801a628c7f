"""The page in a real browser, fed with messages as the stack sends them; no master needed."""

import json
import time
from collections import defaultdict
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rospy")

from chromium import EXECUTABLE
from posting_robot import KEYFRAMES
from served_page import TOKEN, ServedPage
from waiting import Lateness

from vsx_ros.evaluation.events import collapsed
from vsx_ros.exploration.time_left import left_words
from vsx_ros.ros.status import screen

pytestmark = pytest.mark.skipif(EXECUTABLE is None, reason="no chromium is installed")


WATCHED = """new Promise(done => {
  const shown = known.pictures, began = performance.now();
  let due = began + 100, late = 0;
  const look = () => {
    const now = performance.now();
    late += Math.max(0, now - due);
    due = now + 100;
    if (now - began < 3000) setTimeout(look, 100);
    else done([known.pictures - shown, now - began, late]);
  };
  setTimeout(look, 100);
})"""
"""On the browser's clock: pictures in three seconds, how long these were, and how late timers fired in them [ms]."""


def test_the_page_shows_everything_and_asks_nobody_else(page: ServedPage, tmp_path: Path) -> None:
    browser = page.browser
    browser.requested.clear()
    page.open()
    page.wait("series.ratio.length > 5 && $('ratioNow').textContent")
    assert page.value("$('mission').textContent") == "MAPPING"
    assert "4.0 m2" in page.value("$('why').textContent")
    assert page.value("$('camera').naturalWidth") == 640
    assert page.value("$('release').hidden") is False
    assert page.value("$('ratioNow').textContent") == "73 %"
    assert "30\nimages / s" in page.value("$('numbers').innerText")
    events = page.value("$('events').textContent")
    assert "<b>chosen</b>" in events  # words from outside stay words
    assert "12.0 smappingblocked 0 cm ahead (7 times until 18.0 s)" in events
    assert page.value("$('events').children.length") == 2
    numbers = page.value("$('numbers').innerText")
    assert numbers.startswith("1:25\nelapsed\n12.3 m\ndriven\n23 m²\nknown area\n94 %\nrooms known\n")
    assert "4\nimages skipped" in numbers
    assert f"{KEYFRAMES}\nkeyframes" in numbers
    assert page.value("$('why').textContent").startswith(
        "Driving to a view of 4.0 m2, 2.0 m away. · about 4 minutes left"
    )
    assert page.value("$('figuresText').textContent") == "U = 2.0"
    assert page.value("$('figures').hidden || $('figures').open") is False
    assert "rug" in page.value("$('zones').textContent")
    assert "room 1" in page.value("$('rooms').textContent")
    browser.screenshot(tmp_path / "page.png")
    asked = [url for url in browser.requested if url.startswith("http")]
    assert {url.split("/")[2] for url in asked} == {f"127.0.0.1:{page.port}"}
    assert browser.errors == []


def test_frontiers_views_plan_and_keyframes_are_drawn_on_the_map(page: ServedPage) -> None:
    """Each colour is there, and goes with what it stands for."""
    page.open()
    page.wait("['frontiers', 'plan', 'keyframes', 'mission'].every(name => known[name])")
    page.value("known.mission.goal = null")  # a ring in the colour of the plan
    inks = "map-frontier", "map-view", "map-keyframe", "map-plan"
    drawn_px = page.pixels("map", "paint()", *inks)
    assert all(n_px > least for n_px, least in zip(drawn_px, (500, 100, KEYFRAMES, 100), strict=True)), drawn_px
    for subject, gone in (("frontiers", inks[:2]), ("keyframes", inks[2:3]), ("plan", inks[3:])):
        assert page.pixels("map", f"delete known.{subject}, paint()", *gone) == [0] * len(gone)


def test_the_way_of_the_whole_run_is_drawn_but_not_where_the_robot_was_carried(page: ServedPage) -> None:
    page.open()
    page.value("Object.entries(layers).forEach(([name, layer]) => { layer.shown = name === 'way'; })")
    page.post("way", [[0.0, 1.5], [1.0, 1.5], None, [3.0, 1.5], [4.0, 1.5]])
    page.wait("known.way")
    for x, drawn in ((0.5, True), (2.0, False), (3.5, True)):
        place = f"toScreen({x}, 1.5).map(Math.round).map((v, i) => v - [1, 4][i])"
        ink = page.value(f"(paint(), Math.max(...$('map').getContext('2d').getImageData(...{place}, 3, 9).data))")
        assert (ink > 100) is drawn, x


def test_the_charts_show_latency_and_planning_time(page: ServedPage) -> None:
    page.open()
    page.wait("series.latency.length > 20 && $('latencyNow').textContent && $('planningNow').textContent")
    assert page.value("$('latencyNow').textContent") == "20 ms"
    assert page.value("$('planningNow').textContent") == "180 ms"
    assert page.value("series.planning.map(([t, v]) => v)") == [180.0]  # a dot for a plan, not for a message
    (poor_px,) = page.pixels("ratio", "drawRatio()", "map-keyframe")  # below the dashed line tracking counts as poor
    assert poor_px > 50
    for name, draw in (("latency", "drawLatency()"), ("planning", "drawPlanning()")):
        assert page.pixels(name, draw, "accent")[0] > 0
        assert page.pixels(name, f"series.{name}.length = 0, {draw}", "accent") == [0]


def test_the_picture_changes_at_least_five_times_a_second(page: ServedPage) -> None:
    page.open()
    lateness, began_s = Lateness(), time.monotonic()  # of the robot, which posts from here
    shown, took_ms, late_ms = page.value(WATCHED)
    late_s = 1e-3 * late_ms + lateness.since(began_s)
    lateness.close()
    assert 5.0 * (1e-3 * took_ms - late_s) <= shown <= 11.0 * 1e-3 * took_ms


def test_the_page_says_that_the_stack_is_away_and_comes_back_with_it(page: ServedPage) -> None:
    page.open()
    page.wait("$('banner').hidden")
    page.server.close()
    page.wait("!$('banner').hidden && $('banner').textContent.includes('No connection')")
    before = page.value("known.pictures")
    page.serve(page.port)
    page.wait(f"known.pictures > {before} + 2 && $('banner').hidden")


@pytest.mark.parametrize("left_s", [None, 3, 44, 50, 89, 91, 150, 3600])
def test_the_time_left_is_told_as_by_vsx_status(page: ServedPage, left_s: float | None) -> None:
    page.open()
    page.post("mission", {"state": "mapping", "reason": "on the way", "left_s": left_s})
    page.wait("$('why').textContent.startsWith('On the way.')")
    said = page.value("$('why').textContent").split(" · ")
    assert said == ["On the way.", *filter(None, [left_words(left_s)])]


def test_what_the_battery_lasts_is_told_as_by_vsx_status(page: ServedPage) -> None:
    page.open()
    for left_s, words in ((150, "3 min"), (3569, "59 min"), (3590, "1 h 0 min"), (7190, "2 h 0 min")):
        page.post("dock", {"state": "idle", "reason": "", "docked": False, "known": False, "battery_left_s": left_s})
        page.wait(f"$('numbers').innerText.includes('\\n{words}\\nbattery lasts')")
        assert f", lasts about {words}\n" in screen(defaultdict(lambda: None, battery_left_s=left_s))


def test_events_are_collapsed_as_in_the_report(page: ServedPage) -> None:
    page.open()
    rng = np.random.default_rng(3)
    reasons = "pose is 20 ms old", "pose is -3.5 ms old", "following", ""
    events = [
        (10**9 * k, "", state, reasons[i])
        for k, (state, i) in enumerate(zip(rng.choice(["stale", "on"], 300), rng.integers(0, 4, 300), strict=True))
    ]
    events += [(10**9 * (300 + k), "", ("stale", "on")[k % 2], f"{k} ms") for k in range(99)]
    told = [{"stamp_ns": stamp_ns, "state": str(state), "reason": why} for stamp_ns, _, state, why in events]
    script = f"collapsed({json.dumps(told)}).map(e => [e.stamp_ns, e.state, e.reason, e.times, e.last_ns])"
    expected = [[e.event[0], str(e.event[2]), e.event[3], e.times, e.last_ns] for e in collapsed(events)]
    assert page.value(script) == expected
    assert max(times for _, _, _, times, _ in expected) >= 49


def test_events_of_the_run_before_are_not_told(page: ServedPage) -> None:
    page.open()
    told_at_s = {"old": -6.8, "first": 0.0, "second": 1.5}
    page.post(
        "events",
        [{"stamp_ns": 10**18 + round(1e9 * t), "state": "mapping", "reason": word} for word, t in told_at_s.items()],
    )
    page.wait("$('events').innerText.includes('second')")
    assert page.value("[...$('events').children].map(e => e.innerText)") == ["1.5 smappingsecond", "0.0 smappingfirst"]


def test_the_end_takes_the_tools_out_of_the_hand(page: ServedPage) -> None:
    """Its server knows none of their commands."""
    page.open()
    page.browser.click("#drawZone")
    page.browser.click("#byHand")
    page.browser.key("ArrowUp", up=False)
    page.wait("hand.holds && !$('sheet').hidden && !$('stick').hidden")
    page.post("end", {"reason": "time", "ok": True, "facts": [], "folder": "/run", "report": False})
    page.wait("!$('end').hidden")
    assert page.value("hand.holds || $('healthCard').checkVisibility() || draft !== null") is False
    assert page.value("$('sheet').hidden && $('stick').hidden && $('byHand').ariaPressed === 'false'")
    page.value("document.querySelector('[data-command=explore_on]').focus()")
    done = len(page.done)
    page.browser.key(" ", " ")
    page.browser.key("ArrowUp")
    time.sleep(0.3)
    assert page.done[done:] == []


def test_held_wheels_are_red_and_say_by_what(page: ServedPage) -> None:
    page.open()
    page.wait("$('banner').hidden")
    for by, ends in (("emergency stop", "Release e-stop"), ("teleop", "by itself")):
        page.post("held", {"by": by, "since_ns": 10**18})
        page.post("mission", {"state": "held", "reason": f"the operator holds the wheels ({by})"})
        page.wait(f"$('banner').textContent.includes({by!r}) && !$('banner').hidden")
        assert ends in page.value("$('banner').textContent")
        assert page.value("$('mission').className") == "pill bad"
    page.post("held", {"by": "", "since_ns": 0})
    page.post("mission", {"state": "mapping", "reason": "the exploration goes on"})
    page.wait("$('banner').hidden && $('mission').className === 'pill good'")


def test_buttons_need_the_token(page: ServedPage) -> None:
    """A page of an earlier run at the same port has an old one."""
    for fragment in ("", "#wrong"):
        page.open(fragment=fragment)
        page.wait("$('said').textContent.includes('Looking only') && $('estop').disabled")
        for name in ("pause", "stop", "estop", "drawZone", "byHand", "endDrive"):
            assert page.value(f"$('{name}').disabled"), name
        assert page.value("document.querySelectorAll('#zones button, #rooms button').length") == 0
        page.click_map(0.0, 0.0)
        assert page.wait("!$('sheet').hidden && $('sheet').querySelectorAll('button').length") == 1  # that closes it
        page.browser.key(" ")
    page.value(f"location.hash = {TOKEN!r}")  # the address of now, in the same tab
    page.wait("!$('pause').disabled && !$('release').hidden")
    page.browser.click("#pause")
    page.wait("$('said').textContent.includes('Pause is done.')")
    assert page.done == [("pause", None)]


def test_the_buttons_follow_the_robot_that_answers(page: ServedPage) -> None:
    """A stack with another token comes at the same port, and that of the page comes back."""
    page.open()
    page.wait("!$('estop').disabled")
    for token, said in (("another", "Looking only"), (TOKEN, "The buttons work")):
        page.server.close()
        page.serve(page.port)
        page.server.token = token
        page.wait(f"$('estop').disabled === {str(token != TOKEN).lower()} && $('said').textContent.includes({said!r})")

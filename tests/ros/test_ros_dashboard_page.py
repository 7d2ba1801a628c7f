"""The page in a real browser, fed with messages as the stack sends them; no master needed."""

import base64
import math
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

pytest.importorskip("rospy")

import cv2
import numpy as np
from chromium import EXECUTABLE, Chromium
from geometry_msgs.msg import PoseArray

from vsx_ros.exploration.utility import View
from vsx_ros.geometry.mount import mount_pose
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3
from vsx_ros.occupancy.grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from vsx_ros.occupancy.unknown_ground import Frontier
from vsx_ros.robot import Frame
from vsx_ros.ros import convert
from vsx_ros.ros.dashboard import feed
from vsx_ros.ros.dashboard.feed import Board
from vsx_ros.ros.dashboard.server import Answer, ViewServer
from vsx_ros.ros.mission_output import frontier_markers
from vsx_ros.ros.slam_messages import drawn
from vsx_ros.slam.snapshot import TrackedFeatures

pytestmark = pytest.mark.skipif(EXECUTABLE is None, reason="no chromium is installed")

TOKEN = "a-token-of-tests"
RATE_HZ = 15.0
KEYFRAMES = 12
MOUNT = mount_pose(0.0, 0.0, 0.3, 0.1)

FRONTIERS, VIEWS, KEYFRAME, PLAN = "#58a6ff", "#4cc38a", "#e5b567", "#d2a8ff"
CURVE, POOR = "#58a6ff", "#e5b567"
"""Colours of the page. POOR: the line below which tracking counts as poor."""


def room() -> OccupancyGrid:
    cells = np.full((120, 160), UNKNOWN, np.int8)
    cells[20:100, 20:130] = FREE
    cells[20, 20:130] = cells[99, 20:130] = cells[20:100, 20] = OCCUPIED
    cells[50:60, 60:75] = OCCUPIED
    return OccupancyGrid(cells, 0.05, -2.0, -3.0)


class Robot:
    """Posts what a run would, at the rates of a run, on a thread."""

    def __init__(self, board: Board) -> None:
        self._board = board
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def close(self) -> None:
        self._over.set()
        self._thread.join()

    def _run(self) -> None:
        grid = room()
        border = np.array([[row, 129] for row in range(30, 90)])
        views = [View(SE2(3.6, y, 0.0), 4.0 / k, 1.0 + k, 30, 2.5 / k) for k, y in ((1, 0.5), (2, -1.0))]
        markers = frontier_markers(grid, [Frontier(border, np.zeros(2), 3.0)], views, 1, 2.0)
        self._board.post("frontiers", feed.text(feed.frontiers(markers)))
        self._board.post("map", feed.text(feed.grid(convert.grid_msg(grid, "map", 1))))
        path = [SE2(0.05 * k, 0.3 * math.sin(0.1 * k), 0.0) for k in range(60)]
        self._board.post("plan", feed.text(feed.plan(convert.path_msg("map", 1, path))))
        cameras = [SE3.from_se2(SE2(-1.0 + 0.4 * k, -1.5, 0.2 * k)) @ MOUNT for k in range(KEYFRAMES)]
        self._board.post("keyframes", feed.text(feed.keyframes(PoseArray(poses=list(map(convert.pose_msg, cameras))))))
        reason = "driving to a view of 4.0 m2, 2.0 m away [U = 2.0]"
        status = {"state": "mapping", "reason": reason, "goal": [3.0, 0.3, 0.0]}
        status |= {"elapsed_s": 85, "driven_m": 12.3, "known_area_m2": 23.4}
        self._board.post("mission", feed.text(status))
        self._board.post("slam", feed.text(["TRACKING", ""]))
        health = {
            "mobile_base: safety": [1, "emergency stop", {"estop": "True"}],
            "vslam: input": [0, "30 images a second", {"dropped": "4"}],
        }
        self._board.post("health", feed.text(health))
        event = {"stamp_ns": 10**18, "state": "mapping", "reason": "<b>chosen</b>"}
        again = [{"stamp_ns": 10**18, "state": "mapping", "reason": f"blocked {k} cm ahead"} for k in range(7)]
        self._board.post("events", feed.text([*again, event]))
        rng = np.random.default_rng(0)
        noise = cv2.GaussianBlur(rng.integers(0, 255, (480, 640), dtype=np.uint8), (31, 31), 0)
        k = 0
        while not self._over.wait(1.0 / RATE_HZ):
            k += 1
            points = rng.uniform((10, 10), (630, 470), (300, 2))
            picture = drawn(Frame(k, noise), TrackedFeatures(points[:220], points[220:]))
            _, jpeg = cv2.imencode(".jpg", picture)
            self._board.post("camera", feed.text(base64.b64encode(jpeg.tobytes()).decode()))
            self._board.post("pose", feed.text([0.02 * k % 3.0, 0.3 * math.sin(0.04 * k), 0.0]))
            stats = {"tracked": 220, "attempted": 300, "latency_ms": 20.0, "keyframes": KEYFRAMES, "points": 3000}
            self._board.post("stats", feed.text({**stats, "plan_ms": 180.0}))


@pytest.fixture
def board() -> Iterator[Board]:
    board = Board()
    robot = Robot(board)
    yield board
    robot.close()


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Chromium]:
    with Chromium(tmp_path_factory.mktemp("profile")) as chromium:
        yield chromium


def served(board: Board, done: list[str], port: int = 0) -> ViewServer:
    def command() -> Answer:
        done.append("pause")
        return Answer(True, "paused")

    server = ViewServer(board, {"pause": command}, lambda count: None, TOKEN, port=port)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    return server


def test_the_page_shows_everything_and_asks_nobody_else(browser: Chromium, board: Board, tmp_path: Path) -> None:
    server = served(board, [])
    try:
        browser.requested.clear()
        browser.open(f"http://127.0.0.1:{server.server_port}/#{TOKEN}")
        browser.wait("frames > 5 && ground !== null && series.ratio.length > 5 && $('ratioNow').textContent")
        assert browser.evaluate("$('mission').textContent") == "MAPPING"
        assert "4.0 m2" in browser.evaluate("$('why').textContent")
        assert browser.evaluate("$('camera').naturalWidth") == 640
        assert browser.evaluate("$('release').hidden") is False
        assert browser.evaluate("$('ratioNow').textContent") == "73 %"
        assert "30\nimages / s" in browser.evaluate("$('numbers').innerText")
        events = browser.evaluate("$('events').textContent")
        assert "<b>chosen</b>" in events  # words from outside stay words
        assert "blocked 0 cm ahead (7 times)" in events
        assert browser.evaluate("$('events').children.length") == 2
        numbers = browser.evaluate("$('numbers').innerText")
        assert numbers.startswith("1:25\nelapsed\n12.3 m\ndriven\n23 m²\nknown area\n")
        assert f"{KEYFRAMES}\nkeyframes" in numbers
        assert browser.evaluate("$('why').textContent").startswith("Driving to a view of 4.0 m2, 2.0 m away.")
        assert browser.evaluate("$('figuresText').textContent") == "U = 2.0"
        assert browser.evaluate("$('figures').hidden || $('figures').open") is False
        browser.screenshot(tmp_path / "page.png")
        assert {url.split("/")[2] for url in browser.requested if url.startswith("http")} == {
            f"127.0.0.1:{server.server_port}"
        }
    finally:
        browser.open("about:blank")
        server.close()


def pixels_of(browser: Chromium, canvas: str, draw: str, *colours: str) -> list[int]:
    """How many pixels of a canvas have each colour, right after it was drawn by a JavaScript expression."""
    data = f"$('{canvas}').getContext('2d').getImageData(0, 0, $('{canvas}').width, $('{canvas}').height).data"
    coded = base64.b64decode(
        browser.evaluate(
            f"({draw}, new Promise(done => {{ const reader = new FileReader(); reader.onload = () => "
            f"done(reader.result.split(',')[1]); reader.readAsDataURL(new Blob([{data}])); }}))"
        )
    )
    pixels = np.frombuffer(coded, np.uint8).reshape(-1, 4).astype(int)
    rgb, drawn = pixels[:, :3], pixels[:, 3] > 127
    wanted = [[int(colour[i : i + 2], 16) for i in (1, 3, 5)] for colour in colours]
    return [int(np.count_nonzero(drawn & (np.abs(rgb - colour) <= 3).all(axis=1))) for colour in wanted]


def test_frontiers_views_plan_and_keyframes_are_drawn_on_the_map(browser: Chromium, board: Board) -> None:
    """Each colour is there, and goes with what it stands for."""
    server = served(board, [])
    try:
        browser.open(f"http://127.0.0.1:{server.server_port}/#{TOKEN}")
        browser.wait("ground !== null && ['frontiers', 'plan', 'keyframes', 'mission'].every(name => known[name])")
        browser.evaluate("known.mission.goal = null")  # a ring in the colour of the plan
        colours = FRONTIERS, VIEWS, KEYFRAME, PLAN
        drawn_px = pixels_of(browser, "map", "drawMap()", *colours)
        assert all(n_px > least for n_px, least in zip(drawn_px, (500, 100, 2 * KEYFRAMES, 100), strict=True)), drawn_px
        for subject, gone in (("frontiers", colours[:2]), ("keyframes", (KEYFRAME,)), ("plan", (PLAN,))):
            assert pixels_of(browser, "map", f"delete known.{subject}, drawMap()", *gone) == [0] * len(gone)
    finally:
        browser.open("about:blank")
        server.close()


def test_the_charts_show_latency_and_planning_time(browser: Chromium, board: Board) -> None:
    server = served(board, [])
    try:
        browser.open(f"http://127.0.0.1:{server.server_port}/#{TOKEN}")
        browser.wait("series.latency.length > 20 && $('latencyNow').textContent && $('planningNow').textContent")
        assert browser.evaluate("$('latencyNow').textContent") == "20 ms"
        assert browser.evaluate("$('planningNow').textContent") == "180 ms"
        assert browser.evaluate("series.planning.map(([t, v]) => v)") == [180.0]  # a dot for a plan, not for a message
        (poor_px,) = pixels_of(browser, "ratio", "chart('ratio', 1, '', GOOD_RATIO)", POOR)
        assert poor_px > 50
        for name, dots in (("latency", "false"), ("planning", "true")):
            draw = f"chart('{name}', 0, 'ms', 0, {dots})"
            assert pixels_of(browser, name, draw, CURVE)[0] > 0
            assert pixels_of(browser, name, f"series.{name}.length = 0, {draw}", CURVE) == [0]
    finally:
        browser.open("about:blank")
        server.close()


def test_the_picture_changes_at_least_five_times_a_second(browser: Chromium, board: Board) -> None:
    server = served(board, [])
    try:
        browser.open(f"http://127.0.0.1:{server.server_port}/#{TOKEN}")
        browser.wait("frames > 2")
        # Counted on the browser's clock, between two pictures.
        rate_hz = browser.evaluate(
            "new Promise(done => { const f = frames, t = performance.now(); setTimeout(() => "
            "done(1000 * (frames - f) / (performance.now() - t)), 3000); })"
        )
        assert 5.0 <= rate_hz <= 11.0
    finally:
        browser.open("about:blank")
        server.close()


def test_the_page_says_that_the_stack_is_away_and_comes_back_with_it(browser: Chromium, board: Board) -> None:
    server = served(board, [])
    port = server.server_port
    browser.open(f"http://127.0.0.1:{port}/#{TOKEN}")
    browser.wait("frames > 2 && $('banner').hidden")
    server.close()
    browser.wait("!$('banner').hidden && $('banner').textContent.includes('No connection')")
    before = browser.evaluate("frames")
    again = served(board, [], port)
    try:
        browser.wait(f"frames > {before} + 2 && $('banner').hidden")
    finally:
        browser.open("about:blank")
        again.close()


def test_held_wheels_are_red_and_say_by_what(browser: Chromium, board: Board) -> None:
    server = served(board, [])
    try:
        browser.open(f"http://127.0.0.1:{server.server_port}/#{TOKEN}")
        browser.wait("frames > 2 && $('banner').hidden")
        for by, ends in (("emergency stop", "Release e-stop"), ("teleop", "by itself")):
            reason = f"the operator holds the wheels ({by})"
            board.post("held", feed.text({"by": by, "since_ns": 10**18}))
            board.post("mission", feed.text({"state": "held", "reason": reason}))
            browser.wait(f"$('banner').textContent.includes({by!r}) && !$('banner').hidden")
            assert ends in browser.evaluate("$('banner').textContent")
            assert browser.evaluate("$('mission').className") == "pill bad"
        board.post("held", feed.text({"by": "", "since_ns": 0}))
        board.post("mission", feed.text({"state": "mapping", "reason": "the exploration goes on"}))
        browser.wait("$('banner').hidden && $('mission').className === 'pill good'")
    finally:
        browser.open("about:blank")
        server.close()


def test_buttons_need_the_token(browser: Chromium, board: Board) -> None:
    done: list[str] = []
    server = served(board, done)
    try:
        for fragment, said in (("", "Looking only"), ("#wrong", "wrong token"), (f"#{TOKEN}", "Paused.")):
            browser.open("about:blank")
            browser.open(f"http://127.0.0.1:{server.server_port}/{fragment}")
            browser.wait("document.readyState === 'complete' && typeof frames === 'number'")
            browser.evaluate("document.querySelector('[data-command=pause]').click()")
            browser.wait(f"$('said').textContent.includes({said!r})")
            assert bool(done) == (said == "Paused.")
    finally:
        browser.open("about:blank")
        server.close()
    assert done == ["pause"]

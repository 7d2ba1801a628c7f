"""The page in a real browser, fed by a robot that only posts; its commands are written down."""

import base64
import json
import threading
from typing import Any

import numpy as np
from chromium import Chromium
from posting_robot import PostingRobot

from vsx_ros.control.joystick import Joystick
from vsx_ros.ros.dashboard import feed
from vsx_ros.ros.dashboard.feed import Board
from vsx_ros.ros.dashboard.server import Answer, Command, ViewServer

TOKEN = "a-token-of-tests"
PLAIN = "pause", "resume", "home", "stop", "estop", "release", "end-drive", "dock", "undock"

CONTRASTS = """(() => {
  const paint = document.createElement("canvas").getContext("2d", {willReadFrequently: true});
  const rgb = colour => {
    paint.clearRect(0, 0, 1, 1); paint.fillStyle = colour; paint.fillRect(0, 0, 1, 1);
    return paint.getImageData(0, 0, 1, 1).data; };
  const linear = v => v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4;
  const light = ([r, g, b]) => [r, g, b].map(v => linear(v / 255))
    .reduce((sum, v, i) => sum + v * [0.2126, 0.7152, 0.0722][i], 0);
  const behind = node => { for (; node; node = node.parentElement) {
    const found = rgb(getComputedStyle(node).backgroundColor);
    if (found[3] > 250) return found; } return [255, 255, 255]; };
  return [...document.body.querySelectorAll("*")].filter(node => node.checkVisibility({visibilityProperty: true})
      && !node.disabled && [...node.childNodes].some(child => child.nodeType === 3 && child.data.trim()))
    .map(node => { const [a, b] = [light(rgb(getComputedStyle(node).color)), light(behind(node))].sort((a, b) => b - a);
      return [(a + 0.05) / (b + 0.05), node.textContent.trim().slice(0, 40)]; });
})()"""
"""Ratio of contrast (WCAG 2.2) and words of every element that shows words of its own and is no disabled button."""


def window_place(browser: Chromium, x: float, y: float) -> tuple[float, float]:
    """Where a place on the map [m] of the open page is in the window [px]."""
    script = "(box => toScreen(%s, %s).map((px, i) => px + [box.x, box.y][i]))($('map').getBoundingClientRect())"
    px, py = browser.evaluate(script % (x, y))
    return px, py


class ServedPage:
    """done: name and value of every command. answers: what commands answer, by name; else they succeed. hangs: names of
    those that never answer."""

    def __init__(self, browser: Chromium) -> None:
        self.browser, self.board = browser, Board()
        self.done: list[tuple[str, Any]] = []
        self.answers: dict[str, Answer] = {}
        self.hangs: set[str] = set()
        self._over, self._phone = threading.Event(), False
        self.stick = Joystick(0.2, 0.6)
        self._robot = PostingRobot(self.board)
        self.serve()

    def serve(self, port: int = 0) -> None:
        """Start the server, for the first time or again at the same port."""
        commands: dict[str, Command] = {name: self._command(name) for name in PLAIN}
        commands |= {f"{name}?": self._command(name) for name in ("plan", "go", "zones", "name-room")}
        self.server = ViewServer(self.board, {**commands, "drive?": self._drive}, lambda count: None, TOKEN, port=port)
        self.port = self.server.server_port
        threading.Thread(target=self.server.serve_forever, daemon=True).start()

    def close(self) -> None:
        self._over.set()
        self.browser.open("about:blank")
        self.server.close()
        self._robot.close()

    def _command(self, name: str) -> Command:
        def act(text: str = "null") -> Answer:
            self.done.append((name, json.loads(text)))
            if name in self.hangs:
                self._over.wait()
            return self.answers.get(name, Answer(True, f"{name} is done"))

        return act

    def _drive(self, text: str) -> Answer:
        asked = json.loads(text)
        moved = self.stick.move(0.0, **asked)  # no time passes, so nothing is late
        self.done.append(("drive", moved.command))
        return Answer(not moved.reason, moved.reason, {"ticket": moved.ticket})

    def post(self, subject: str, value: Any) -> None:
        self.board.post(subject, feed.text(value))

    def open(self, width: int = 1440, height: int = 900, fragment: str = f"#{TOKEN}", scheme: str = "dark") -> None:
        """Open the page and wait until it has shown the robot. Below 700 px it is a phone."""
        self._phone = width < 700
        self.browser.size(width, height)
        self.browser.scheme(scheme)
        self.browser.open("about:blank")
        self.browser.errors.clear()
        self.browser.open(f"http://127.0.0.1:{self.port}/{fragment}")
        self.wait("known.pictures > 2 && ground.free !== null && known.rooms && known.health && known.zones")
        self.browser.evaluate("paint()")

    def value(self, expression: str) -> Any:
        return self.browser.evaluate(expression)

    def wait(self, expression: str) -> Any:
        return self.browser.wait(expression)

    def at(self, x: float, y: float) -> tuple[float, float]:
        """Where a place on the map [m] is in the window [px]."""
        return window_place(self.browser, x, y)

    def click_map(self, x: float, y: float) -> None:
        """Click a place on the map [m]; on a phone tap it."""
        place = self.at(x, y)
        if self._phone:
            self.browser.touch("Start", place)
            self.browser.touch("End")
            return
        for kind in ("Moved", "Pressed", "Released"):
            self.browser.mouse(kind, *place)

    def ink(self, name: str) -> str:
        return str(self.value(f"getComputedStyle(document.documentElement).getPropertyValue('--{name}').trim()"))

    def pixels(self, canvas: str, draw: str, *inks: str) -> list[int]:
        """How many pixels of a canvas have each colour of the style sheet, right after it was drawn by a script."""
        data = f"$('{canvas}').getContext('2d').getImageData(0, 0, $('{canvas}').width, $('{canvas}').height).data"
        coded = base64.b64decode(
            self.value(
                f"({draw}, new Promise(done => {{ const reader = new FileReader(); reader.onload = () => "
                f"done(reader.result.split(',')[1]); reader.readAsDataURL(new Blob([{data}])); }}))"
            )
        )
        pixels = np.frombuffer(coded, np.uint8).reshape(-1, 4).astype(int)
        rgb, drawn = pixels[:, :3], pixels[:, 3] > 127
        wanted = [[int(self.ink(ink)[i : i + 2], 16) for i in (1, 3, 5)] for ink in inks]
        return [int(np.count_nonzero(drawn & (np.abs(rgb - colour) <= 3).all(axis=1))) for colour in wanted]

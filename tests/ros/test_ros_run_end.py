"""The end of a run in the live view: the page outlives the run, with what was reached and what to do with it."""

import argparse
import json
import threading
import time
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rospy")

from chromium import EXECUTABLE, Chromium
from free_ports import free_port
from waiting import PATIENCE_S

from vsx_ros.config import Config
from vsx_ros.evaluation.summary import Summary
from vsx_ros.geometry.se3 import SE3, StampedPose
from vsx_ros.occupancy.grid import OccupancyGrid
from vsx_ros.ros.dashboard.ending import Ended, show_end
from vsx_ros.ros.run import go_on_args
from vsx_ros.runs.folder import RunFolder

TOKEN = "a-token-of-tests"


@pytest.fixture
def folder(tmp_path: Path) -> RunFolder:
    made = RunFolder.create(tmp_path / "run")
    made.write_config(Config(), ["vsx", "explore"], world="lab", seed=1, time=120.0, fast=False)
    summary = Summary(frames=40, frames_tracked=30, coverage=0.93, stop_reason="time limit of 120 s", duration_s=120.0)
    made.write_summary(summary.as_dict())
    made.write_map(OccupancyGrid(np.array([[0, 0, 100], [0, -1, 100]], np.int8), 0.5, 0.0, 0.0))
    made.write_poses("trajectory", [StampedPose(k, SE3(np.eye(3), np.array([0.1 * k, 0.0, 0.3]))) for k in range(20)])
    (made.path / "report.html").write_text("<p>the report</p>", encoding="utf-8")
    return made


class End:
    """A run's end, served on a thread. go_on: what it returned; None before."""

    def __init__(self, folder: RunFolder) -> None:
        self.port, self.stop, self.go_on = free_port(), False, None
        ended = Ended(folder, folder.read_summary(), ended_well=True)
        self._thread = threading.Thread(target=self._run, args=(ended,))
        self._thread.start()

    def _run(self, ended: Ended) -> None:
        self.go_on = show_end(ended, TOKEN, self.port, lambda: self.stop)

    def close(self) -> None:
        self.stop = True
        self._thread.join()


@pytest.fixture
def end(folder: RunFolder) -> Iterator[End]:
    shown = End(folder)
    yield shown
    shown.close()


def ask(port: int, path: str, method: str = "GET") -> bytes:
    request = urllib.request.Request(
        f"http://127.0.0.1:{port}{path}", headers={"X-Vsx-Token": TOKEN}, method=method, data=None
    )
    while True:
        try:
            with urllib.request.urlopen(request, timeout=PATIENCE_S) as reply:
                return bytes(reply.read())
        except urllib.error.HTTPError as error:
            return bytes(error.read())
        except OSError:
            time.sleep(0.05)


def test_the_report_can_be_opened_and_a_run_without_a_map_cannot_go_on(end: End) -> None:
    assert ask(end.port, "/report") == b"<p>the report</p>"
    answer = json.loads(ask(end.port, "/command/explore_on", "POST"))
    assert not answer["ok"]
    assert "holds no map" in answer["message"]
    assert not json.loads(ask(end.port, "/command/save_map", "POST"))["ok"]


def test_nobody_looks_so_it_ends_by_itself(folder: RunFolder) -> None:
    shown = End(folder)
    shown._thread.join()
    assert shown.go_on is False


def test_a_taken_port_is_no_failure(folder: RunFolder, end: End) -> None:
    ask(end.port, "/report")
    assert show_end(Ended(folder, {}, ended_well=True), TOKEN, end.port) is False


def test_going_on_means_the_same_run_for_as_long_again(folder: RunFolder) -> None:
    args = argparse.Namespace(
        world="lab", seed=1, base="auto", planner="fov", phi=None, load_map=None, config=None, out=folder.path,
        set=["a=1"], moved=False, resume=None, time=120.0, until=0.9, view=True,
    )  # fmt: skip
    again = go_on_args(args, folder)
    assert (again.resume, again.time, again.until) == (folder.path, 240.0, None)
    assert (again.world, again.out, again.set, again.view) == (None, None, [], True)


@pytest.mark.skipif(EXECUTABLE is None, reason="no chromium is installed")
def test_the_page_shows_what_was_reached(folder: RunFolder, end: End, tmp_path: Path) -> None:
    with Chromium(tmp_path / "profile") as browser:
        browser.open(f"http://127.0.0.1:{end.port}/#{TOKEN}")
        browser.wait("known.end && ground !== null && way.length")
        assert browser.evaluate("$('endReason').textContent") == "Time limit of 120 s."
        assert "coverage 93 %" in browser.evaluate("$('endFacts').textContent")
        assert browser.evaluate("$('end').hidden || $('endReport').hidden || !$('buttons').hidden") is False
        assert browser.evaluate("$('mission').textContent") == "ENDED"
        browser.evaluate("document.querySelector('[data-command=explore_on]').click()")
        browser.wait("$('said').textContent.startsWith('Not done: ') && $('said').textContent.includes('no map')")
        end.stop = True
        browser.wait("!$('banner').hidden && $('banner').textContent.startsWith('The run is over')")
        assert browser.evaluate("document.body.className") == "old"

"""The end of a run in the live view: the page outlives the run, with what was reached and what to do with it."""

import http.client
import json
import os
import socket
import sys
import threading
import time
import urllib.request
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace

import file_samples
import numpy as np
import pytest

pytest.importorskip("rospy")

from chromium import EXECUTABLE, Chromium
from free_ports import free_port
from served_page import ServedPage
from waiting import PATIENCE_S, wait_for

from vsx_ros.cli.main import parse
from vsx_ros.config import Config
from vsx_ros.errors import VsxError
from vsx_ros.evaluation.summary import Summary
from vsx_ros.geometry.se3 import SE3, StampedPose
from vsx_ros.io.slam_map_file import load_slam_map
from vsx_ros.io.zone_file import load_zones, save_zones, zone_file
from vsx_ros.occupancy.grid import OccupancyGrid
from vsx_ros.occupancy.zones import Zone, ZoneKind
from vsx_ros.ros import run
from vsx_ros.ros.dashboard import ending, server
from vsx_ros.ros.dashboard.ending import Ended, show_end
from vsx_ros.ros.dashboard.feed import Board
from vsx_ros.ros.dashboard.server import ViewServer
from vsx_ros.ros.fork_server import ForkServer
from vsx_ros.ros.nodes import dashboard
from vsx_ros.ros.run import go_on_words
from vsx_ros.runs.checkpoint import CheckpointData
from vsx_ros.runs.folder import RunFolder
from vsx_ros.runs.start import begin
from vsx_ros.runs.world import open_world, save_world

TOKEN = "a-token-of-tests"


@pytest.fixture
def folder(tmp_path: Path) -> RunFolder:
    made = RunFolder.create(tmp_path / "run")
    made.write_config(Config(), ["vsx", "explore"], world="lab", seed=1, time=120.0, until=0.9, fast=False)
    save_world(open_world("lab", 1), made.path / "world.yaml")
    summary = Summary(frames=40, frames_tracked=30, coverage=0.93, stop_reason="time limit of 120 s", duration_s=120.0)
    made.write_summary(summary.as_dict())
    made.write_map(OccupancyGrid(np.array([[0, 0, 100], [0, -1, 100]], np.int8), 0.5, 0.0, 0.0))
    save_zones(
        [Zone("carpet", ZoneKind.NO_GO, ((0.0, 0.0), (0.5, 0.0), (0.5, 0.5)))], zone_file(made.path / "map.yaml")
    )
    made.write_poses("trajectory", [StampedPose(k, SE3(np.eye(3), np.array([0.1 * k, 0.0, 0.3]))) for k in range(20)])
    (made.path / "report.html").write_text("<p>the report</p>", encoding="utf-8")
    return made


class End:
    """A run's end, served on a thread. go_on: what it returned; None before."""

    def __init__(self, folder: RunFolder, port: int | None = None) -> None:
        self.port, self.stop, self.go_on = port or free_port(), False, None
        ended = Ended(folder, folder.read_summary(), ended_well=True)
        self._thread = threading.Thread(target=self._run, args=(ended,))
        self._thread.start()

    def _run(self, ended: Ended) -> None:
        self.go_on = show_end(ended, TOKEN, self.port, lambda: self.stop)

    def close(self) -> None:
        self.stop = True
        self._thread.join()


@pytest.fixture
def end(folder: RunFolder, monkeypatch: pytest.MonkeyPatch) -> Iterator[End]:
    """It waits for a viewer as long as a browser may take to start, and does not leave while another page is shown."""
    monkeypatch.setattr(ending, "_COME_S", PATIENCE_S)
    monkeypatch.setattr(ending, "_GONE_S", PATIENCE_S)
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


def test_a_long_report_comes_whole_through_a_slow_network(monkeypatch: pytest.MonkeyPatch) -> None:
    """In several times the seconds that an update of the view may take."""
    monkeypatch.setattr(server, "_SEND_S", 2.0)
    page = bytes(range(256)) * 100_000
    served = ViewServer(Board(), {}, lambda count: None, TOKEN, "127.0.0.1", 0)
    served.report = lambda: page
    threading.Thread(target=served.serve_forever, daemon=True).start()
    connection = http.client.HTTPConnection("127.0.0.1", served.server_port, timeout=PATIENCE_S)
    connection.request("GET", "/report")
    answer, parts = connection.getresponse(), []
    while part := answer.read(2**20):
        parts.append(part)
        time.sleep(0.15)
    connection.close()
    served.close()
    assert b"".join(parts) == page


def test_nobody_looks_so_it_ends_by_itself(folder: RunFolder) -> None:
    shown = End(folder)
    shown._thread.join()
    assert shown.go_on is False


def test_a_machine_that_was_late_shows_the_end_to_who_looks(folder: RunFolder, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each tick comes an hour late; the page comes, and comes again after a break."""
    tell, ticks, now_s = [], [1, 0, 1, 1, 0, 1], [0.0]

    def served(_board: Board, _commands: object, report: Callable[[int], object], *_: object) -> SimpleNamespace:
        tell.append(report)
        return SimpleNamespace(serve_forever=lambda: None, close=lambda: None)

    def late(_: float) -> None:
        now_s[0] += 3600.0
        if ticks:
            tell[0](ticks.pop(0))

    monkeypatch.setattr(ending, "ViewServer", served)
    monkeypatch.setattr(ending, "time", SimpleNamespace(monotonic=lambda: now_s[0], sleep=late))
    show_end(Ended(folder, folder.read_summary(), ended_well=True), TOKEN, 0, lambda: not ticks)
    assert ticks == []


def test_a_taken_port_is_no_failure(folder: RunFolder, end: End) -> None:
    ask(end.port, "/report")
    assert show_end(Ended(folder, {}, ended_well=True), TOKEN, end.port) is False


def test_going_on_means_the_same_run_for_as_long_again(folder: RunFolder) -> None:
    words = go_on_words(folder)
    args = parse(words)
    assert (args.command, args.resume, args.time, args.view) == ("explore", folder.path.resolve(), 240.0, True)
    assert args.headless, "the page is open"
    assert args.until == 1.0, "the share with which it has ended would end it again at once"
    with begin(parse(["explore", "--resume", str(folder.path), *words[3:]])) as (begun, config, _):
        assert begun.path == folder.path
        assert config == Config()


def test_going_on_needs_a_process_of_its_own(folder: RunFolder, monkeypatch: pytest.MonkeyPatch) -> None:
    """After its shutdown rospy registers nothing any more: a second session would hear no word of its nodes."""
    sessions, becomes = [0, 0], []
    monkeypatch.setattr(run, "_explore", lambda *_: (folder, 0, sessions.pop() == 0))
    monkeypatch.setattr(sys, "orig_argv", ["python3", "-X", "dev", "scripts/vsx", "explore", "--view"])
    monkeypatch.setattr(sys, "argv", ["scripts/vsx", "explore", "--view"])
    monkeypatch.setattr(os, "execv", lambda program, words: becomes.append((program, words)))
    with ForkServer() as forks:
        run.explore(parse(["explore", "--view"]), forks)
    assert len(sessions) == 1, "one session in this process"
    assert becomes == [(sys.executable, [sys.executable, "-X", "dev", "scripts/vsx", *go_on_words(folder)])]


def test_the_next_session_is_served_where_the_open_page_looks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(dashboard.PORT, "")
    monkeypatch.setenv(dashboard.TOKEN, TOKEN)
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        monkeypatch.setattr(dashboard, "DEFAULT_PORT", taken.getsockname()[1])
        (first, url), (again, same) = dashboard.prepare_view(), dashboard.prepare_view()
        assert first != taken.getsockname()[1]
    assert (first, url) == (again, same)


def test_results_that_cannot_be_shown_do_not_change_how_the_run_ended(folder: RunFolder) -> None:
    (folder.path / "map.yaml").write_text("{", encoding="utf-8")
    port = free_port()
    with pytest.raises(VsxError):
        show_end(Ended(folder, folder.read_summary(), ended_well=True), TOKEN, port)
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", port))


@pytest.mark.skipif(EXECUTABLE is None, reason="no chromium is installed")
def test_the_end_waits_for_who_reads_the_report_in_another_tab(
    folder: RunFolder, end: End, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with Chromium(tmp_path / "profile") as browser:
        browser.open(f"http://127.0.0.1:{end.port}/#{TOKEN}")
        browser.wait("known.end && !$('endReport').hidden")
        monkeypatch.setattr(ending, "_GONE_S", 0.5)
        browser.evaluate("Object.defineProperty(document, 'hidden', {get: () => true})")
        browser.evaluate("document.dispatchEvent(new Event('visibilitychange'))")
        time.sleep(2.0)
        assert end.go_on is None, "it is still there"
        browser.click("[data-command=explore_on]")
        browser.wait("$('said').textContent.startsWith('Not done: ')")


@pytest.mark.skipif(EXECUTABLE is None, reason="no chromium is installed")
def test_a_hidden_page_gets_no_pictures_but_the_end(
    page: ServedPage, folder: RunFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    page.open()
    page.value("Object.defineProperty(document, 'hidden', {get: () => true})")
    page.value("document.dispatchEvent(new Event('visibilitychange'))")
    wait_for(lambda: page.value("1") and page.browser.requested[-1].endswith("/end"), "a light connection")
    pictures = page.value("known.pictures")
    time.sleep(0.5)
    assert page.value("known.pictures") == pictures
    page.server.close()
    monkeypatch.setattr(ending, "_COME_S", PATIENCE_S)
    shown = End(folder, page.port)
    try:
        page.wait("known.end && !$('end').hidden && $('endFacts').children.length")
        page.wait("ground.free !== null && known.way")  # it looks now, so that the end stays
        assert shown.go_on is None
    finally:
        shown.close()


@pytest.mark.skipif(EXECUTABLE is None, reason="no chromium is installed")
def test_the_page_shows_what_was_reached(folder: RunFolder, end: End, tmp_path: Path) -> None:
    with Chromium(tmp_path / "profile") as browser:
        browser.open(f"http://127.0.0.1:{end.port}/#{TOKEN}")
        browser.wait("known.end && ground.free !== null && known.way.length")
        assert browser.evaluate("$('endReason').textContent") == "Time limit of 120 s."
        assert "coverage 93 %" in browser.evaluate("$('endFacts').textContent")
        assert browser.evaluate("$('end').hidden || $('endReport').hidden || !$('buttons').hidden") is False
        assert browser.evaluate("$('mission').textContent") == "ENDED"
        assert "carpet" in browser.evaluate("$('zones').textContent")
        assert browser.evaluate("$('drawZone').checkVisibility() || $('byHand').checkVisibility()") is False
        browser.evaluate("($('map').focus(), $('map').dispatchEvent(new KeyboardEvent('keydown', {key: 'Enter'})))")
        browser.wait("!$('sheet').hidden")  # a place can be looked at, but nobody drives there
        assert browser.evaluate("$('go') === null && $('sheet').innerText.includes(' m')")
        browser.click("[data-command=explore_on]")
        browser.wait("$('said').textContent.startsWith('Not done: ') && $('said').textContent.includes('no map')")
        end.stop = True
        browser.wait("!$('banner').hidden && $('banner').textContent.startsWith('The run is over')")
        assert browser.evaluate("document.body.classList.contains('old')")


def pages_at(browser: Chromium, path: str) -> list[str]:
    """Numbers of the open pages whose address ends so."""
    pages = browser.call("Target.getTargets")["targetInfos"]
    return [page["targetId"] for page in pages if page["url"].endswith(path)]


@pytest.mark.skipif(EXECUTABLE is None, reason="no chromium is installed")
def test_the_buttons_of_the_end_save_the_map_open_the_report_and_explore_on(
    folder: RunFolder, end: End, tmp_path: Path
) -> None:
    folder.checkpoint.write(CheckpointData(file_samples.slam_map(), 1, {}, {}))
    zone_file(folder.path / "map.yaml").touch()  # a run that ends in order writes it last
    with Chromium(tmp_path / "profile") as browser:
        browser.open(f"http://127.0.0.1:{end.port}/#{TOKEN}")
        browser.wait("known.end && !$('endReport').hidden")
        browser.click("[data-command=save_map]")
        browser.wait("$('said').textContent.startsWith('The map is saved: ')")
        saved = folder.path / "map.vsxmap"
        assert load_slam_map(saved).view.keyframes
        assert [zone.name for zone in load_zones(zone_file(saved))] == ["carpet"]
        browser.click("#endReport")
        [report] = wait_for(lambda: pages_at(browser, "/report"), "the report")
        browser.call("Target.closeTarget", targetId=report)
        browser.call("Page.bringToFront")
        browser.click("[data-command=explore_on]")
        wait_for(lambda: end.go_on is not None, "the end to be over")
        assert end.go_on is True

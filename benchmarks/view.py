"""Cost and update rates of the live view, without a viewer and with one.

PYTHONPATH=src:hw:tests python benchmarks/view.py [--seconds 20] [--picture view.png]

A robot explores the emulated lab live. It prints the processor time of the view's process, as a share of a core,
and the SLAM's additional time for drawing the camera picture; also the rates of camera, pose and all updates at the
viewer. With --picture, a third measurement uses a headless Chromium as the viewer and stores its picture.
"""

import argparse
import http.client
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

START_S = 90.0
TICKS = os.sysconf("SC_CLK_TCK")


def processor_s(pid: int) -> float:
    """User and system time of a process so far."""
    fields = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / TICKS


def node_pid(name: str, run: Path) -> int:
    """The process of this run's node: the run's log folder is in its arguments."""
    for entry in Path("/proc").glob("[0-9]*"):
        try:
            words = (entry / "cmdline").read_bytes().decode(errors="replace")
        except OSError:
            continue
        if f"__name:={name}" in words and str(run) in words:
            return int(entry.name)
    raise LookupError(f"no node {name} of {run} runs")


def shares(pids: dict[str, int], seconds: float) -> dict[str, float]:
    """Share of a core of each process over the next seconds."""
    before, began_s = {name: processor_s(pid) for name, pid in pids.items()}, time.monotonic()
    time.sleep(seconds)
    elapsed_s = time.monotonic() - began_s
    return {name: (processor_s(pid) - before[name]) / elapsed_s for name, pid in pids.items()}


class Viewer:
    """Reads the stream like a browser and counts."""

    def __init__(self, port: int) -> None:
        connection = http.client.HTTPConnection("127.0.0.1", port, timeout=20)
        connection.request("GET", "/events")
        self._stream = connection.getresponse()

    def count(self, seconds: float) -> tuple[Counter[str], int]:
        """Updates by subject and bytes."""
        heard: Counter[str] = Counter()
        size, deadline_s = 0, time.monotonic() + seconds
        while time.monotonic() < deadline_s:
            line = self._stream.readline()
            size += len(line)
            if line.startswith(b"event: "):
                heard[line[7:].decode().strip()] += 1
        return heard, size

    def close(self) -> None:
        self._stream.close()


def wait_until_mapping(explorer: subprocess.Popen[str]) -> str:
    """Wait until the robot maps; returns the address of the view."""
    url, began_s = "", time.monotonic()
    assert explorer.stderr is not None
    for line in explorer.stderr:
        found = re.search(r"live view: (http://\S+)", line)
        url = found[1] if found else url
        if "mapping" in line or time.monotonic() - began_s > START_S:
            break
    return url


def measure(url: str, run: Path, seconds: float, picture: Path | None) -> None:
    port = int(re.findall(r":(\d+)/", url)[0])
    pids = {name: node_pid(name, run) for name in ("dashboard", "vslam")}
    alone = shares(pids, seconds)
    viewer = Viewer(port)
    viewer.count(3.0)
    before, began_s = {name: processor_s(pid) for name, pid in pids.items()}, time.monotonic()
    heard, size = viewer.count(seconds)
    elapsed_s = time.monotonic() - began_s
    watched = {name: (processor_s(pid) - before[name]) / elapsed_s for name, pid in pids.items()}
    viewer.close()
    print(f"view, nobody looks          {100 * alone['dashboard']:5.1f} % of a core")
    print(f"view, one viewer            {100 * watched['dashboard']:5.1f} % of a core")
    print(f"SLAM, nobody looks          {100 * alone['vslam']:5.1f} % of a core")
    print(f"SLAM, one viewer            {100 * watched['vslam']:5.1f} % of a core")
    for subject in ("camera", "pose"):
        print(f"updates of {subject:16} {heard[subject] / elapsed_s:5.1f} a second")
    print(f"updates of all      {sum(heard.values()) / elapsed_s:5.1f} a second, {size / elapsed_s / 1e3:.0f} kB/s")
    if picture is not None:
        from chromium import Chromium

        with tempfile.TemporaryDirectory() as profile, Chromium(Path(profile)) as browser:
            browser.open(url)
            browser.wait("known.stack === true && known.camera")
            time.sleep(5.0)
            browser.screenshot(picture)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--picture", type=Path)
    args = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="view-") as folder:
        run = Path(folder) / "run"
        words = ["--world", "lab", "--seed", "2", "--view", "--headless", "--out", str(run)]
        command = [sys.executable, "-m", "vsx_ros.cli.main", "explore", *words]
        with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as explorer:
            try:
                url = wait_until_mapping(explorer)
                measure(url, run, args.seconds, args.picture)
            finally:
                explorer.send_signal(signal.SIGINT)
                explorer.communicate(timeout=60)


if __name__ == "__main__":
    main()

"""How runs end when the disk is full or read-only, accepts no new file, or loses the run folder.

python benchmarks/fault_disk.py [--how live lockstep] [--repetitions 2] [--out FILE]

Each run has its own disk (a tmpfs, or an ext4 on a loop device; both need root) for its folder, its logs and
ROS_HOME. Live is ``vsx explore`` with all nodes in an emulated lab, lock-step is ``vsx explore --fast``. The disk fails
at a random moment. Then the run ends in one of three ways: it reaches its time limit, is interrupted (SIGINT) or is
terminated (SIGTERM); each is repeated for each fault. A run is good under these conditions: at the end the emulator
reports that the wheels stand; the program ends within 10 s, with an exit code and without a traceback; none of its
processes is left; every file in the run folder can be read, and its journals and tables end with a whole line. The end
begins with the signal, or when the run has seen that its time is over, before it writes its results; the run must give
that reason. Existing rows of the present code are not measured again; benchmarks/tables.py makes the table from the
rows.
"""

from __future__ import annotations

import argparse
import contextlib
import csv
import json
import math
import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections import namedtuple
from collections.abc import Callable, Iterator
from itertools import product
from pathlib import Path

import cv2
import numpy as np
from tables import RESULTS, campaign

from vsx_ros.evaluation.report_data import ProgressRow
from vsx_ros.experiments.campaign import UntriedError
from vsx_ros.io.dock_file import load_dock
from vsx_ros.io.map_export import read_ply
from vsx_ros.io.map_file import load_map
from vsx_ros.io.room_file import load_rooms
from vsx_ros.io.sealed_archive import unseal
from vsx_ros.io.zone_file import load_zones
from vsx_ros.runs.folder import RunFolder
from vsx_ros.runs.journal import read_journal
from vsx_ros.runs.self_calibration import read_self_calibration
from vsx_ros.sim.world_file import load_world

Failing = namedtuple("Failing", "how fault ended_by repetition")
FAULTS = ("full", "full for 3 s", "no inode left", "read-only", "run folder deleted")
HOW = ("live", "lockstep")
ENDED_BY = {"its time": None, "SIGINT": signal.SIGINT, "SIGTERM": signal.SIGTERM}
LASTS_S = {"live": 20.0, "lockstep": 10.0}
DISK_MB, END_S, PATIENCE_S = 64, 10.0, 180.0
WATCH = """
import rospy
from nav_msgs.msg import Odometry
rospy.init_node("watch", anonymous=True, disable_signals=True)
def said(msg):
    print("speeds", msg.twist.twist.linear.x, msg.twist.twist.angular.z, flush=True)
rospy.Subscriber("/emulator/ground_truth/odometry", Odometry, said)
rospy.spin()
"""


@contextlib.contextmanager
def disk(fault: str) -> Iterator[Path]:
    """An empty disk that can fail in this way."""
    place = Path(tempfile.mkdtemp(prefix="vsx-disk-"))
    mounted, image = place / "disk", place / "image"
    mounted.mkdir()
    if fault == "read-only":
        with image.open("wb") as file:
            file.truncate(DISK_MB << 20)
        subprocess.run(["mkfs.ext4", "-q", str(image)], check=True)
        mount = ["-o", "loop,errors=remount-ro", str(image)]
    else:
        mount = ["-t", "tmpfs", "-o", f"size={DISK_MB}m,nr_inodes=4000", "tmpfs"]
    subprocess.run(["mount", *mount, str(mounted)], check=True)
    try:
        yield mounted
    finally:
        subprocess.run(["umount", "-l", str(mounted)], check=True)
        shutil.rmtree(place)


def strike(fault: str, mounted: Path, run: Path) -> None:
    """Let the disk fail."""
    if fault == "run folder deleted":
        shutil.rmtree(run, ignore_errors=True)
    elif fault == "read-only":
        device = subprocess.run(["findmnt", "-no", "SOURCE", str(mounted)], check=True, capture_output=True, text=True)
        Path("/sys/fs/ext4", Path(device.stdout.strip()).name, "trigger_fs_error").write_text("1")
    elif fault == "no inode left":
        with contextlib.suppress(OSError):
            for number in range(1 << 20):
                (mounted / f"taken{number}").touch()
    else:
        fill(mounted / "taken")
        if fault == "full for 3 s":
            threading.Timer(3.0, (mounted / "taken").unlink).start()


def fill(path: Path) -> None:
    with contextlib.suppress(OSError), path.open("wb", buffering=0) as file:
        while file.write(bytes(1 << 12)):
            pass


def progress(path: Path) -> None:
    """Read progress.csv; its last column may be empty."""
    header, *rows = csv.reader(path.read_text().splitlines())
    for row in rows:
        numbers = [float(cell) for cell in (row if row[-1] else row[:-1])]
        if len(row) != len(header) or not all(map(math.isfinite, numbers)):
            raise ValueError(f"{row} is no row of {header}")
    if header[1:] != list(ProgressRow._fields[1:]):
        raise ValueError(f"{header} are other columns")


def picture(path: Path) -> object:
    return cv2.imread(str(path), cv2.IMREAD_GRAYSCALE).shape


def of_run(read: Callable[[RunFolder], object]) -> Callable[[Path], object]:
    """The reader of a file that a run folder reads by a name of its own."""
    return lambda path: read(RunFolder(path.parent))


BY_NAME: dict[str, Callable[[Path], object]] = {
    "config.yaml": of_run(RunFolder.read_config),
    "events.jsonl": of_run(RunFolder.read_events),
    "frames.csv": of_run(RunFolder.read_frames),
    "map.yaml": load_map,
    "map_dock.yaml": load_dock,
    "map_rooms.json": load_rooms,
    "map_zones.yaml": load_zones,
    "odometry_calibration.yaml": lambda path: read_self_calibration(path.parent),
    "progress.csv": progress,
    **dict.fromkeys(("world.yaml", "world_resumed.yaml"), load_world),
}
BY_SUFFIX: dict[str, Callable[[Path], object]] = {
    ".json": lambda path: json.loads(path.read_text()),
    ".jsonl": read_journal,
    ".txt": lambda path: RunFolder(path.parent).read_poses(path.stem),
    ".ply": read_ply,
    ".npy": np.load,
    ".zip": lambda path: unseal(path.read_bytes()) and RunFolder(path.parents[1]).checkpoint.read(),
    ".html": lambda path: path.read_text().rstrip().endswith("</html>") or {}["its end"],
    **dict.fromkeys((".jpg", ".pgm", ".png"), picture),
}
"""Readers of the files of a run folder. One that has none here counts as unreadable."""


def kept(folder: Path) -> list[Path]:
    """Files of a run folder, without unfinished ones and logs."""
    files = [path for path in sorted(folder.rglob("*")) if path.is_file() and not path.name.endswith(".part")]
    return [path for path in files if "log" not in path.relative_to(folder).parts[:-1]]


def unreadable(folder: Path) -> list[str]:
    """Files of a run folder that cannot be read, and why."""
    bad = []
    for path in kept(folder):
        try:
            if path.suffix in (".csv", ".jsonl", ".txt"):
                whole(path)
            (BY_NAME.get(path.name) or BY_SUFFIX[path.suffix])(path)
        except Exception as error:
            bad.append(f"{path.relative_to(folder)}: {error!r}"[:200])
    return bad


def whole(path: Path) -> None:
    """Check that the last line is complete: who reads a journal leaves half a line out without a word."""
    data = path.read_bytes()
    if data and not data.endswith(b"\n"):
        raise ValueError("half a line at its end")


def left_alive(*names: str) -> list[str]:
    lines = []
    for entry in Path("/proc").glob("[0-9]*/cmdline"):
        with contextlib.suppress(OSError):
            lines.append(entry.read_bytes().replace(b"\0", b" ").decode(errors="replace"))
    return [line[:200] for line in lines if any(name in line for name in names)]


class Run:
    """One exploration on a failing disk; on exit it ends remaining processes."""

    def __init__(self, how: str, mounted: Path, seed: int, lasts_s: float) -> None:
        self.folder, self._others = mounted / "run", Path(tempfile.mkdtemp(prefix="vsx-watch-"))
        with socket.socket() as probe:
            probe.bind(("localhost", 0))
            self.port = probe.getsockname()[1]
        kept = {name: value for name, value in os.environ.items() if not name.startswith("ROS_LOG")}
        shell = {**kept, "ROS_MASTER_URI": f"http://localhost:{self.port}", "ROS_HOSTNAME": "localhost"}
        options = ["--fast"] if how == "lockstep" else ["--headless"]
        options += ["--world", "lab", "--seed", str(seed), "--time", str(lasts_s), "--out", str(self.folder)]
        self.lines: list[tuple[float, str]] = []
        self.speeds: list[tuple[float, float]] = []
        (mounted / "ros").mkdir()
        self.child = self._start(["-m", "vsx_ros.cli.main", "explore", *options], shell, mounted / "ros")
        self._watch = self._start(["-c", WATCH], shell, self._others) if how == "live" else None

    def _start(self, words: list[str], shell: dict[str, str], home: Path) -> subprocess.Popen[str]:
        shell, pipe = {**shell, "ROS_HOME": str(home)}, subprocess.PIPE
        child = subprocess.Popen([sys.executable, *words], env=shell, stdout=pipe, stderr=pipe, text=True)
        for stream in (child.stdout, child.stderr):
            threading.Thread(target=self._read, args=(stream,), daemon=True).start()
        return child

    def _read(self, stream: object) -> None:
        for line in stream:
            if line.startswith("speeds"):
                _, v, omega = line.split()
                self.speeds = [*self.speeds[-29:], (float(v), float(omega))]
            else:
                self.lines.append((time.monotonic(), line.rstrip()))

    def __enter__(self) -> Run:
        return self

    def __exit__(self, *_: object) -> None:
        for child in filter(None, (self.child, self._watch)):
            child.kill()
            child.wait()
        shutil.rmtree(self._others)

    @property
    def stood(self) -> bool:
        """Whether the robot stood in the emulator's last report; in lock-step it cannot move uncommanded."""
        last = self.speeds[-3:]
        return self._watch is None or (bool(last) and all(abs(v) < 0.01 and abs(w) < 0.02 for v, w in last))

    def wait_for(self, happened: Callable[[], float]) -> float | None:
        """Wait for an event; returns its time, None if it never came."""
        deadline_s = time.monotonic() + PATIENCE_S
        while time.monotonic() < deadline_s and self.child.poll() is None:
            if at_s := happened():
                return at_s
            time.sleep(0.02)
        return happened() or None

    def said(self, word: str) -> float:
        return next((at_s for at_s, line in list(self.lines) if word in line), 0.0)

    def has_frames(self) -> float:
        journal = self.folder / "resume" / "journal.jsonl"
        return time.monotonic() if journal.exists() and journal.stat().st_size > 0 else 0.0

    def is_over(self) -> float:
        """Of a run with frames in lock-step: whether its time is over. Only while it drives it listens to SIGTERM. It
        tells its end after its results, and its journal ends where the disk failed."""
        lines = Path(f"/proc/{self.child.pid}/status").read_text().splitlines() if self.child.poll() is None else []
        listens = [int(line.split()[1], 16) >> (signal.SIGTERM - 1) & 1 for line in lines if line.startswith("SigCgt:")]
        return time.monotonic() if listens == [0] else 0.0

    def ended(self, end_s: float | None, reason: str) -> dict[str, object]:
        """The results; end_s: when the end of the run began, None if it did not. reason: words of its end."""
        with contextlib.suppress(subprocess.TimeoutExpired):
            self.child.wait(60.0)
        code, took_s = self.child.poll(), None if end_s is None else round(time.monotonic() - end_s, 2)
        left = left_alive(f"-p {self.port}", str(self.folder))
        time.sleep(0.3)
        bad, said = unreadable(self.folder), [line for _, line in self.lines]
        traceback, gave = any("Traceback" in line for line in said), any(reason in line for line in said)
        soon = took_s is not None and took_s < END_S
        good = self.stood and code in (0, 1, 4) and gave and soon and not (left or bad or traceback)
        return {
            "stood": self.stood, "exit code": code, "gave its reason": gave, "ended_s": took_s, "left alive": left,
            "unreadable": bad, "files": len(kept(self.folder)), "summary": (self.folder / "summary.json").exists(),
            "traceback": traceback, "said": [line for line in said if "kept" in line or "cannot" in line][-1:],
            "good": good,
        }  # fmt: skip


def trial(task: Failing) -> dict[str, object]:
    how, fault, ended_by, number = task
    way, sent = list(ENDED_BY).index(ended_by), ENDED_BY[ended_by]
    rng, seed = np.random.default_rng([HOW.index(how), FAULTS.index(fault), way, number]), 100 + 3 * number + way
    with disk(fault) as mounted, Run(how, mounted, seed, LASTS_S[how] if sent is None else 600.0) as run:
        if run.wait_for(run.has_frames) is None:
            raise UntriedError(f"the run began no journal: {[line for _, line in run.lines][-1:]}")
        moment_s = float(rng.uniform(0.0, 0.8)) * (LASTS_S[how] if how == "live" else 4.0)
        time.sleep(moment_s)
        if run.child.poll() is not None:
            raise UntriedError(f"the run ended before its disk failed: {[line for _, line in run.lines][-1:]}")
        strike(fault, mounted, run.folder)
        if sent is not None:
            time.sleep(float(rng.uniform(0.5, 5.0)))
            end_s = time.monotonic()
            run.child.send_signal(sent)
        else:
            end_s = run.wait_for(run.is_over if how == "lockstep" else lambda: run.said("stopping: "))
        came_out = run.ended(end_s, "stopped by the operator" if sent else "time limit of")
    return {"moment_s": round(moment_s, 1), **came_out}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--how", nargs="+", default=list(HOW), choices=HOW)
    parser.add_argument("--faults", nargs="+", default=list(FAULTS), choices=FAULTS)
    parser.add_argument("--ended-by", nargs="+", default=list(ENDED_BY), choices=ENDED_BY)
    parser.add_argument("--repetitions", type=int, default=2, help="of each fault with each end")
    parser.add_argument("--out", type=Path, default=RESULTS / "fault_disk.jsonl")
    args = parser.parse_args()
    for number in (signal.SIGINT, signal.SIGTERM):  # a shell's background job ignores SIGINT, and so do its children
        signal.signal(number, signal.default_int_handler)
    asked = product(args.how, range(args.repetitions), args.faults, args.ended_by)
    tasks = [Failing(how, fault, ended_by, number) for how, number, fault, ended_by in asked]
    campaign("fault_disk", tasks, trial, args.out)


if __name__ == "__main__":
    main()

"""How runs end when the disk is full or read-only, accepts no new file, or loses the run folder.

python benchmarks/fault_disk.py [--how live lockstep] [--repetitions 2]

Each run has its own disk (a tmpfs, or an ext4 on a loop device; both need root) for its folder, its logs and
ROS_HOME. Live is ``vsx explore`` with all nodes in an emulated lab, lock-step is ``vsx explore --fast``. The disk fails
at a random moment. Then the run ends in one of three ways: it reaches its time limit, is interrupted (SIGINT) or is
terminated (SIGTERM); each is repeated for each fault. A run is good under these conditions: at the end the emulator
reports that the wheels stand; the program ends within 10 s, with an exit code and without a traceback; none of its
processes is left; every file in the run folder can be read. Existing rows of the present code are not measured again;
benchmarks/tables.py makes the table from the rows.
"""

from __future__ import annotations

import argparse
import contextlib
import json
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
import yaml
from tables import campaign

from vsx_ros.io.map_export import read_ply
from vsx_ros.io.map_file import load_map
from vsx_ros.io.sealed_archive import unseal
from vsx_ros.runs.folder import RunFolder
from vsx_ros.runs.journal import read_journal

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


def unreadable(folder: Path) -> list[str]:
    """Files of a run folder that cannot be read; unfinished files and logs do not count."""
    readers: dict[str, Callable[[Path], object]] = {
        ".json": lambda path: json.loads(path.read_text()),
        ".yaml": lambda path: (
            load_map(path)
            if path.name == "map.yaml"
            else yaml.safe_load(path.read_text())["walls"]
            if "world" in path.name
            else RunFolder(path.parent).read_config()
        ),
        ".jsonl": lambda path: RunFolder(path.parent).read_events() if path.name == "events.jsonl" else whole(path),
        ".txt": lambda path: RunFolder(path.parent).read_poses(path.stem),
        ".csv": lambda path: RunFolder(path.parent).read_frames(),
        ".pgm": lambda path: cv2.imread(str(path), 0).shape,
        ".png": lambda path: cv2.imread(str(path), 0).shape,
        ".ply": read_ply,
        ".npy": np.load,
        ".zip": lambda path: unseal(path.read_bytes()) and RunFolder(path.parents[1]).checkpoint.read(),
        ".html": lambda path: path.read_text().rstrip().endswith("</html>") or {}["its end"],
    }
    bad = []
    for path in sorted(folder.rglob("*")):
        if path.is_file() and "log" not in path.relative_to(folder).parts[:-1] and not path.name.endswith(".part"):
            try:
                readers[path.suffix](path)
            except Exception as error:
                bad.append(f"{path.relative_to(folder)}: {error!r}"[:200])
    return bad


def whole(path: Path) -> None:
    """Check that the last line is complete."""
    read_journal(path)
    if not path.read_bytes().endswith((b"\n", b"")[not path.stat().st_size :]):
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

    def wait_for(self, happened: Callable[[], float]) -> float:
        """Wait for an event; returns its time, or now if it never came."""
        deadline_s = time.monotonic() + PATIENCE_S
        while time.monotonic() < deadline_s and self.child.poll() is None:
            if at_s := happened():
                return at_s
            time.sleep(0.02)
        return time.monotonic()

    def said(self, word: str) -> float:
        return next((at_s for at_s, line in list(self.lines) if word in line), 0.0)

    def has_frames(self) -> float:
        journal = self.folder / "resume" / "journal.jsonl"
        return time.monotonic() if journal.exists() and journal.stat().st_size > 0 else 0.0

    def ended(self, end_s: float) -> dict[str, object]:
        """The results; end_s: when the end of the run began."""
        with contextlib.suppress(subprocess.TimeoutExpired):
            self.child.wait(60.0)
        took_s, code = time.monotonic() - end_s, self.child.poll()
        left = left_alive(f"-p {self.port}", str(self.folder))
        time.sleep(0.3)
        bad, said = unreadable(self.folder), [line for _, line in self.lines]
        traceback = any("Traceback" in line for line in said)
        good = self.stood and code in (0, 1, 4) and took_s < END_S and not (left or bad or traceback)
        return {
            "stood": self.stood, "exit code": code, "ended_s": round(took_s, 2), "left alive": left,
            "unreadable": bad, "summary": (self.folder / "summary.json").exists(), "traceback": traceback,
            "said": [line for line in said if "kept" in line or "cannot" in line][-1:], "good": good,
        }  # fmt: skip


def trial(task: Failing) -> dict[str, object]:
    how, fault, ended_by, number = task
    way, sent = list(ENDED_BY).index(ended_by), ENDED_BY[ended_by]
    rng, seed = np.random.default_rng([HOW.index(how), FAULTS.index(fault), way, number]), 100 + 3 * number + way
    with disk(fault) as mounted, Run(how, mounted, seed, LASTS_S[how] if sent is None else 600.0) as run:
        run.wait_for(run.has_frames)
        moment_s = float(rng.uniform(0.0, 0.9)) * (LASTS_S[how] if how == "live" else 4.0)
        time.sleep(moment_s)
        during = run.child.poll() is None
        strike(fault, mounted, run.folder)
        if sent is not None:
            time.sleep(float(rng.uniform(0.5, 5.0)))
            end_s = time.monotonic()
            run.child.send_signal(sent)
        else:
            end_s = run.wait_for(lambda: run.said("stopping: " if how == "live" else "time limit of"))
        came_out = run.ended(end_s)
    return {"moment_s": round(moment_s, 1), "while_running": during, **came_out}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--how", nargs="+", default=list(HOW), choices=HOW)
    parser.add_argument("--faults", nargs="+", default=list(FAULTS), choices=FAULTS)
    parser.add_argument("--ended-by", nargs="+", default=list(ENDED_BY), choices=ENDED_BY)
    parser.add_argument("--repetitions", type=int, default=2, help="of each fault with each end")
    args = parser.parse_args()
    for number in (signal.SIGINT, signal.SIGTERM):  # a shell's background job ignores SIGINT, and so do its children
        signal.signal(number, signal.default_int_handler)
    asked = product(args.how, range(args.repetitions), args.faults, args.ended_by)
    tasks = [Failing(how, fault, ended_by, number) for how, number, fault, ended_by in asked]
    campaign("fault_disk", tasks, trial)


if __name__ == "__main__":
    main()

"""The live run as its users start it: an emulated robot explores, Ctrl-C ends it in order."""

import contextlib
import json
import math
import os
import pty
import re
import resource
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import pytest

pytest.importorskip("rospy")

from ros_ports import free_port
from waiting import PATIENCE_S, wait_for

from vsx_ros.config import Config
from vsx_ros.ros import topics
from vsx_ros.ros.run import Coverage
from vsx_ros.ros.run_results import all_events
from vsx_ros.runs.folder import RunFolder
from vsx_ros.runs.journal import RunEvent, read_journal
from vsx_ros.runs.process import FAILED, STOPPED

pytestmark = pytest.mark.ros

CHECKOUT = Path(__file__).resolve().parents[2]


WITNESS = f"""
import rospy
from nav_msgs.msg import Odometry
def tell(msg):
    at = msg.pose.pose.position
    print(msg.header.stamp.to_sec(), at.x, at.y, flush=True)
rospy.init_node("witness", disable_signals=True)
rospy.Subscriber("{topics.TRUTH_ODOMETRY}", Odometry, tell)
rospy.spin()
"""
"""Tells where the robot is, also when no image is rendered any more."""


def environment(tmp_path: Path, port: int) -> dict[str, str]:
    paths = os.pathsep.join([str(CHECKOUT / "src"), str(CHECKOUT / "hw")])
    kept = {name: value for name, value in os.environ.items() if not name.startswith("ROS_")}
    return {**kept, "PYTHONPATH": paths, "ROS_HOME": str(tmp_path), "ROS_MASTER_URI": f"http://localhost:{port}"}


def run_command(*words: str) -> list[str]:
    return [sys.executable, "-m", "vsx_ros.cli.main", "explore", *words]


def processes_that_name(text: str) -> list[str]:
    """Command lines of the running processes that hold the text."""
    lines = []
    for entry in Path("/proc").glob("[0-9]*/cmdline"):
        with contextlib.suppress(OSError):
            lines.append(entry.read_bytes().replace(b"\0", b" ").decode(errors="replace"))
    return [line for line in lines if text in line]


def wait_for_words(run: subprocess.Popen[str], lines: list[str], *words: str) -> None:
    """Wait for a line with all of these words, while the run lasts."""

    def said() -> bool:
        assert run.poll() is None, lines
        return any(all(word in line for word in words) for line in lines)

    wait_for(said, " ".join(words), lambda: lines)


@contextlib.contextmanager
def exploring(tmp_path: Path, port: int, out: Path, *words: str) -> Iterator[tuple[subprocess.Popen[str], list[str]]]:
    """A run that maps by now, and what it says on a terminal, where it says it often."""
    command = run_command("--world", "lab", "--seed", "1", "--time", "300", "--out", str(out), *words)
    lines: list[str] = []
    ours, theirs = pty.openpty()
    wide = {**environment(tmp_path, port), "COLUMNS": "200"}

    def read() -> None:
        with contextlib.suppress(OSError), open(ours, encoding="utf-8") as terminal:  # an error once it is closed
            lines.extend(terminal)

    with subprocess.Popen(command, env=wide, stdout=subprocess.PIPE, stderr=theirs, text=True) as run:
        os.close(theirs)
        threading.Thread(target=read, daemon=True).start()
        wait_for_words(run, lines, "mapping: ")
        yield run, lines


def wait_for_a_metre(run: subprocess.Popen[str], lines: list[str]) -> None:
    """Wait until the robot has driven that far, while the run lasts."""

    def has_driven() -> bool:
        assert run.poll() is None, lines
        return any(float(way_m) >= 1.0 for line in lines for way_m in re.findall(r" ([\d.]+) m \| ", line))

    wait_for(has_driven, "a metre of driving", lambda: lines)


def assert_explored(out: Path) -> None:
    """The robot has driven about and seen something, and no node of it was surprised."""
    summary = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    assert summary["collisions"] == 0
    assert summary["frames_tracked"] > 0
    truth = RunFolder.open(out).read_poses("groundtruth")
    farthest_m = max(float(abs(pose.T.translation - truth[0].T.translation).max()) for pose in truth)
    assert 0.3 < farthest_m < 4.0
    assert summary["driven_m"] > 0.5
    assert "Traceback" not in (out / "log" / "terminal.log").read_text(encoding="utf-8")


def test_ctrl_c_stops_the_robot_ends_every_process_and_leaves_a_run_folder(tmp_path: Path) -> None:
    port, out = free_port(), tmp_path / "run"
    truth: list[str] = []
    with (
        exploring(tmp_path, port, out, "--headless", "--base", "kobuki") as (run, lines),
        subprocess.Popen(
            [sys.executable, "-c", WITNESS], env=environment(tmp_path, port), stdout=subprocess.PIPE, text=True
        ) as witness,
    ):
        assert witness.stdout is not None
        threading.Thread(target=truth.extend, args=(witness.stdout,), daemon=True).start()
        wait_for(lambda: truth, "the true way")
        wait_for_a_metre(run, lines)
        run.send_signal(signal.SIGINT)
        assert run.wait(PATIENCE_S) == STOPPED, lines
        witness.kill()
    assert not processes_that_name(f"-p {port}")
    assert not processes_that_name(str(out))
    folder = RunFolder.open(out)
    summary = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    assert summary["stop_reason"] == "stopped by the operator"
    assert 0.0 < summary["coverage"] < 1.0
    places = [tuple(map(float, line.split())) for line in truth[:-1]]  # of the last line perhaps a part
    stamp_s, *last = places[-1]
    before = next(place for before_s, *place in reversed(places) if stamp_s - before_s >= 0.13)
    assert math.dist(last, before) < 0.002, "the robot still rolled when its nodes were ended"
    assert (out / "report.html").exists()
    assert folder.read_map() is not None
    assert_explored(out)


def test_a_slam_that_hangs_at_the_end_is_told_and_its_journal_kept(tmp_path: Path) -> None:
    out = tmp_path / "run"
    with exploring(tmp_path, free_port(), out, "--base", "create") as (run, lines):
        wait_for_a_metre(run, lines)
        named = Path("/proc").glob("[0-9]*/cmdline")
        (vslam,) = (entry for entry in named if is_node(entry, "vslam", str(out)))
        os.kill(int(vslam.parent.name), signal.SIGSTOP)
        run.send_signal(signal.SIGINT)
        assert run.wait(PATIENCE_S) == STOPPED, lines
    said = (out / "summary.json").read_text(encoding="utf-8")
    assert json.loads(said)["ate_rmse_m"] < 0.1
    assert RunFolder.open(out).read_poses("trajectory")
    assert not processes_that_name(str(out))
    assert_explored(out)


def is_node(entry: Path, name: str, text: str) -> bool:
    with contextlib.suppress(OSError):
        words = entry.read_bytes()
        return f"__name:={name}".encode() in words.split(b"\0") and text.encode() in words
    return False


def test_a_run_whose_own_master_is_killed_ends_in_one_sentence_with_every_process(tmp_path: Path) -> None:
    port, out = free_port(), tmp_path / "run"
    with exploring(tmp_path, port, out, "--base", "create2") as (run, lines):
        wait_for_a_metre(run, lines)
        assert run.stdout is not None
        (master,) = (entry for entry in Path("/proc").glob("[0-9]*/cmdline") if is_master(entry, port))
        os.kill(int(master.parent.name), signal.SIGKILL)
        said = run.stdout.read()
        assert run.wait(PATIENCE_S) == FAILED, (said, lines)
    reason = "the ROS master of this run has ended, so the robot was stopped; explore again"
    assert said.splitlines()[0] == reason, said
    assert not any("Traceback" in line for line in lines)
    assert not processes_that_name(f"-p {port}")
    assert not processes_that_name(str(out))
    assert json.loads((out / "summary.json").read_text(encoding="utf-8"))["stop_reason"] == reason
    assert_explored(out)


def is_master(entry: Path, port: int) -> bool:
    with contextlib.suppress(OSError):
        words = entry.read_bytes().split(b"\0")
        return any(word.endswith(b"rosmaster") for word in words) and str(port).encode() in words
    return False


def test_a_live_run_whose_files_may_not_grow_ends_in_order_and_keeps_what_fits(tmp_path: Path) -> None:
    out = tmp_path / "run"
    command = run_command("--world", "lab", "--seed", "1", "--time", "15", "--headless", "--out", str(out))
    done = subprocess.run(
        command,
        env=environment(tmp_path, free_port()),
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (60_000, 60_000)),
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        check=False,
    )
    assert done.returncode == FAILED, done.stderr
    assert done.stdout.startswith("time limit of 15 s\n")
    assert "vsx: not all of the run is kept: " in done.stderr
    assert "Traceback" not in done.stderr
    summary = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    assert (summary["stop_reason"], summary["collisions"]) == ("time limit of 15 s", 0)
    assert read_journal(RunFolder(out).journal)
    assert not processes_that_name(str(out))


@pytest.mark.light
def test_a_resumed_run_whose_slam_never_began_tells_nothing_twice(tmp_path: Path) -> None:
    folder = RunFolder.create(tmp_path / "run")
    folder.write_config(Config(), ["vsx", "explore"])
    slam, mission, more = (RunEvent(i, source, "s", "r") for i, source in enumerate(("slam", "mission", "mission")))
    folder.write_events([slam, mission])
    journal, monitor = SimpleNamespace(events=lambda: [mission]), SimpleNamespace(events=[more])
    assert all_events(folder, journal, monitor) == [slam, mission, more]


@pytest.mark.light
@pytest.mark.parametrize(
    ("until", "right", "state", "enough"),
    [
        (0.9, 0.95, "TRACKING", True),
        (0.9, 0.95, "POOR", True),
        (0.9, 0.95, "LOST", False),
        (0.9, 0.8, "TRACKING", False),
        (0.9, None, "TRACKING", False),
        (None, 1.0, "TRACKING", False),
    ],
)
def test_a_run_ends_when_enough_is_known_and_the_camera_tracked(
    until: float | None, right: float | None, state: str, enough: bool
) -> None:
    quality = SimpleNamespace(coverage=1.0, coverage_correct=right)
    coverage = Coverage(SimpleNamespace(quality=lambda grid: quality), until)
    assert coverage.is_enough(SimpleNamespace(grid=object(), slam_state=state)) == enough


@pytest.mark.light
def test_a_wrong_serial_port_is_named_and_waited_for(tmp_path: Path) -> None:
    command = run_command("--base", "kobuki", "--port", "/dev/ttyNONE", "--headless", "--out", str(tmp_path / "run"))
    lines: list[str] = []
    with subprocess.Popen(
        command, env=environment(tmp_path, free_port()), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as run:
        assert run.stderr is not None
        reader = threading.Thread(target=lines.extend, args=(run.stderr,), daemon=True)
        reader.start()
        wait_for_words(run, lines, "waiting for", "mobile_base")
        run.send_signal(signal.SIGINT)
        assert run.wait(PATIENCE_S) == STOPPED
    told = [line for line in lines if line.startswith("mobile_base: /dev/ttyNONE: no such port; plug the base in")]
    assert len(told) == 1


@pytest.mark.light
@pytest.mark.parametrize(
    ("words", "sentence"),
    [(["--world", "moon"], "moon"), (["--world", "lab", "--set", "planner.phi_rad_m=-1"], "phi_rad_m")],
)
def test_mistakes_are_one_sentence_before_anything_starts(tmp_path: Path, words: list[str], sentence: str) -> None:
    command = run_command(*words, "--out", str(tmp_path / "run"))
    done = subprocess.run(
        command, env=environment(tmp_path, 1), capture_output=True, text=True, timeout=PATIENCE_S, check=False
    )
    assert done.returncode == FAILED
    assert sentence in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1

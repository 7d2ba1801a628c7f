"""A live run, killed without warning with all its nodes, goes on in the same map."""

import contextlib
import json
import os
import signal
import subprocess
import time
from pathlib import Path

import pytest

pytest.importorskip("rospy")

from ros_ports import free_port
from test_ros_run import environment, run_command
from waiting import PATIENCE_S, wait_for

from vsx_ros.runs.folder import RunFolder
from vsx_ros.runs.journal import ClockLine, FrameLine, read_journal
from vsx_ros.slam.state import TrackingState

pytestmark = pytest.mark.ros


def kill_everything(folder: Path, port: int) -> None:
    """kill -9 for every process of the run; a second round for those that were just being born."""
    for _ in range(2):
        for entry in Path("/proc").glob("[0-9]*/environ"):
            with contextlib.suppress(OSError):
                text = entry.read_bytes() + (entry.parent / "cmdline").read_bytes()
                if f"localhost:{port}".encode() in text or str(folder).encode() in text:
                    os.kill(int(entry.parent.name), signal.SIGKILL)
        time.sleep(0.5)


def test_killed_and_resumed(tmp_path: Path) -> None:
    out, port = tmp_path / "run", free_port()
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    command = run_command("--world", "lab", "--seed", "1", "--time", "300", "--headless", "--out", str(out))
    folder = RunFolder(out)
    with subprocess.Popen(command, env=environment(tmp_path, port), **quiet) as run:

        def maps() -> bool:
            assert run.poll() is None, "the run ended by itself"
            return folder.checkpoint.exists and len(folder.checkpoint.read().slam_map.view.living) >= 8

        wait_for(maps, "a map", pause_s=1.0)
        kill_everything(out, port)
        run.wait()
    assert not (out / "summary.json").exists()
    before = folder.checkpoint.read()
    frames = [line for line in read_journal(folder.journal) if isinstance(line, FrameLine)]
    clock = [line for line in read_journal(out / "resume/witness.jsonl") if isinstance(line, ClockLine)][-1]
    assert frames[-1].stamp_ns - before.stamp_ns < 8_000_000_000

    command = run_command("--resume", str(out), "--time", f"{clock.elapsed_s + 25:.0f}", "--headless")
    port = free_port()
    done = subprocess.run(
        command, env=environment(tmp_path, port), timeout=PATIENCE_S, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    summary = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    assert summary["duration_s"] > clock.elapsed_s + 23
    assert summary["collisions"] == 0
    assert summary["relocalizations"] >= 1
    ends_lost = folder.read_frames()[-1].state == TrackingState.LOST.value
    assert summary["breaks"] == ends_lost, "its time may end before a plain wall; but no pose jumps"
    assert 0.0 < summary["ate_rmse_m"] < 0.05
    assert summary["keyframes"] >= len(before.slam_map.view.living) - 1
    assert summary["frames"] == len(folder.read_frames()) > len(frames) - 8 * 15
    reasons = [event.reason for event in folder.read_events()]
    assert reasons.count("resumed: looking for a place of the known map") == 1
    assert "relocalised" in reasons
    assert folder.read_poses("trajectory")[0].stamp_ns < before.stamp_ns

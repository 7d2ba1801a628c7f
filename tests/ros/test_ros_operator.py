"""vsx status, stop, teleop and record as an operator types them, beside a robot that explores."""

from __future__ import annotations

import contextlib
import json
import os
import pty
import signal
import subprocess
import sys
import termios
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

pytest.importorskip("rospy")

import bag_numbers
import numpy as np
from waiting import PATIENCE_S

from vsx_ros.control.keyboard import keys
from vsx_ros.io.bag import open_recording
from vsx_ros.ros import topics
from vsx_ros.runs.process import DONE, FAILED

if TYPE_CHECKING:
    from conftest import Stack

pytestmark = pytest.mark.ros

VSX = [sys.executable, "-m", "vsx_ros.cli.main"]


def vsx(stack: Stack, *words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [*VSX, *words], env=stack.environment, capture_output=True, text=True, timeout=PATIENCE_S, check=False
    )


def facts(stack: Stack) -> dict[str, Any]:
    done = vsx(stack, "status", "--json")
    assert done.returncode == DONE, done.stderr
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def test_status_says_what_the_robot_does(stack: Stack) -> None:
    stack.wait_until_driving()
    stack.wait(lambda: facts(stack)["slam_state"] == "TRACKING", "tracking", 60.0)
    said = facts(stack)
    assert None not in [said[name] for name in ("state", "reason", "tracked_ratio", "base_reason", "hazards")]
    assert 0.0 < said["tracked_ratio"] <= 1.0
    assert 1.0 < said["camera_hz"] < 20.0
    assert 0.0 < said["battery_fraction"] <= 1.0
    assert said["estop"] is False
    screen = vsx(stack, "status").stdout
    assert [line.split()[0] for line in screen.splitlines()] == [
        "exploration", "slam", "camera", "wheels", "hazards", "battery", "zones", "room",
    ]  # fmt: skip


def test_a_watch_goes_on_until_ctrl_c(stack: Stack) -> None:
    command = [*VSX, "status", "--watch", "--json"]
    with subprocess.Popen(command, env=stack.environment, stdout=subprocess.PIPE, text=True) as watch:
        assert watch.stdout is not None
        lines = [json.loads(watch.stdout.readline()) for _ in range(2)]
        watch.send_signal(signal.SIGINT)
        assert watch.wait(PATIENCE_S) == DONE
    assert all(line["base_reason"] for line in lines)


def test_stop_stands_until_it_is_released(stack: Stack) -> None:
    stack.wait_until_driving()
    stopped = vsx(stack, "stop")
    assert not stack.plant.moving
    assert stopped.returncode == DONE, stopped.stderr
    assert "--release" in stopped.stdout
    assert facts(stack)["estop"] is True
    assert not stack.plant.moving
    assert "EMERGENCY STOP" in vsx(stack, "status").stdout
    assert vsx(stack, "stop", "--release").returncode == DONE
    stack.wait_until_driving()


def test_a_namespace_without_a_robot_is_told(stack: Stack) -> None:
    other = {**stack.environment, "ROS_NAMESPACE": "robot9"}
    done = subprocess.run([*VSX, "stop"], env=other, capture_output=True, text=True, timeout=PATIENCE_S, check=False)
    assert done.returncode == FAILED
    assert "/robot9/mobile_base/estop" in done.stderr
    assert done.stderr.count("\n") == 1


class Keyboard:
    """``vsx teleop`` in a terminal of its own."""

    def __init__(self, stack: Stack) -> None:
        self.master, self.slave = pty.openpty()
        self.before = termios.tcgetattr(self.slave)
        self.process = subprocess.Popen(
            [*VSX, "teleop", "--omega", "0.5"],
            env=stack.environment,
            stdin=self.slave,
            stdout=subprocess.DEVNULL,
            stderr=self.slave,
            start_new_session=True,
        )
        self.said = b""
        threading.Thread(target=self._listen, daemon=True).start()
        stack.wait(lambda: b"0.50 rad/s" in self.said, "teleop to be ready", 60.0)

    def _listen(self) -> None:
        with contextlib.suppress(OSError):
            while content := os.read(self.master, 1024):
                self.said += content

    def hold(self, key: str, released: threading.Event) -> None:
        while not released.is_set():
            os.write(self.master, key.encode())
            time.sleep(0.04)

    def close(self) -> None:
        self.process.kill()
        self.process.wait()
        os.close(self.slave)
        os.close(self.master)


@pytest.fixture
def keyboard(stack: Stack) -> Iterator[Keyboard]:
    stack.wait_until_driving()
    typed = Keyboard(stack)
    yield typed
    typed.close()


def test_a_held_key_turns_the_robot_and_a_released_one_stops_it(stack: Stack, keyboard: Keyboard) -> None:
    assert termios.tcgetattr(keyboard.slave) != keyboard.before
    turning, released = [], threading.Event()

    def has_turned() -> bool:
        """In place, to the left: nothing that the explorer would do for so long with the same speed."""
        left, right = stack.plant.commanded
        turning.append(left < -0.02 and right == pytest.approx(-left, abs=0.003))
        return sum(turning) > 50

    holder = threading.Thread(target=keyboard.hold, args=("\x1b[D", released))
    holder.start()
    stack.wait(has_turned, "the robot to turn")
    released.set()
    holder.join()
    os.write(keyboard.master, b"\x1b")  # half an arrow key must not keep the robot turning
    stack.wait(lambda: stack.plant.commanded == (0.0, 0.0) or stack.plant.commanded[0] >= 0.0, "the key's release", 1.5)
    os.write(keyboard.master, b"q")
    assert keyboard.process.wait(PATIENCE_S) == DONE
    assert termios.tcgetattr(keyboard.slave) == keyboard.before
    assert b"drive" in keyboard.said


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_the_terminal_is_given_back_however_teleop_ends(keyboard: Keyboard, number: int) -> None:
    assert termios.tcgetattr(keyboard.slave) != keyboard.before
    keyboard.process.send_signal(number)
    keyboard.process.wait(PATIENCE_S)
    assert termios.tcgetattr(keyboard.slave) == keyboard.before


@pytest.mark.light
@pytest.mark.parametrize(
    ("text", "pressed"),
    [
        ("w", ["w"]),
        ("\x1b[A\x1b[A", ["w", "w"]),
        ("\x1bOD+", ["a", "+"]),
        ("\x1b", ["\x1b"]),
        ("\x1b[", ["\x1b", "["]),
        ("", []),
    ],
)
def test_keys(text: str, pressed: list[str]) -> None:
    assert keys(text) == pressed


@pytest.fixture(scope="module")
def elsewhere(stack: Stack, tmp_path_factory: pytest.TempPathFactory) -> Iterator[subprocess.Popen[str]]:
    """A recording where no robot is. It waits long for images, so it begins before the other tests of recordings."""
    other = {**stack.environment, "ROS_NAMESPACE": "robot9"}
    command = [*VSX, "record", "--time", "4", "--out", str(tmp_path_factory.mktemp("elsewhere") / "a.bag")]
    with subprocess.Popen(command, env=other, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as recorder:
        yield recorder
        recorder.kill()


@pytest.mark.usefixtures("elsewhere")
def test_a_bag_replays_png_is_the_same_picture_and_jpeg_nearly(stack: Stack, tmp_path: Path) -> None:
    stack.wait_until_driving()
    bags = raw, png, jpeg = [tmp_path / f"{how}.bag" for how in ("raw", "png", "jpeg")]
    with contextlib.ExitStack() as ends:
        recorders = [
            ends.enter_context(
                subprocess.Popen(
                    [*VSX, "record", "--images", bag.stem, "--out", str(bag)],
                    env=stack.environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
                )
            )
            for bag in (raw, jpeg)
        ]  # fmt: skip
        timed = vsx(stack, "record", "--images", "png", "--time", "4", "--out", str(png))
        for recorder in recorders:
            recorder.send_signal(signal.SIGINT)
        said = [recorder.communicate(timeout=PATIENCE_S) for recorder in recorders]
    assert [process.returncode for process in (*recorders, timed)] == [DONE] * 3, (said, timed.stderr)
    assert f"vsx replay {raw}" in said[0][0]
    pictures = {}
    for bag in bags:
        recording = open_recording(bag)
        frames = {frame.stamp_ns: frame.image for frame in recording.frames()}
        assert len(frames) > 5
        assert recording.camera is not None
        assert recording.odometry_at(sorted(frames)[len(frames) // 2]) is not None
        pictures[bag] = frames
    shared = pictures[raw].keys() & pictures[png].keys() & pictures[jpeg].keys()
    assert len(shared) > 5
    assert all(np.array_equal(pictures[raw][stamp], pictures[png][stamp]) for stamp in shared)
    errors = [pictures[jpeg][stamp].astype(float) - pictures[raw][stamp] for stamp in shared]
    assert 0.0 < float(np.sqrt(np.mean(np.square(errors)))) < 6.0
    # Recorders do not begin at the same moment.
    per_image = {bag: bag.stat().st_size / len(pictures[bag]) for bag in bags}
    assert per_image[jpeg] < 0.2 * per_image[raw], per_image
    assert not list(tmp_path.glob("*.active"))


def test_a_bag_holds_what_was_asked_for_and_every_number_once(stack: Stack, tmp_path: Path) -> None:
    stack.wait(lambda: facts(stack)["slam_state"] == "TRACKING", "tracking", 60.0)
    stack.wait_until_driving()
    bag, twice = tmp_path / "a.bag", f"{topics.STATS}/fps"
    asked = ["--topic", topics.JOINT_STATES, "--topic", twice]
    done = vsx(stack, "record", "--images", "jpeg", "--time", "6", "--out", str(bag), *asked)
    assert done.returncode == DONE, done.stderr
    info = subprocess.run(
        ["rosbag", "info", str(bag)], capture_output=True, text=True, timeout=PATIENCE_S, check=True
    ).stdout
    held = {line.split()[0] if not line.startswith("topics:") else line.split()[1]: line for line in info.splitlines()}
    assert "sensor_msgs/JointState" in held[f"/{topics.JOINT_STATES}"]
    assert "nav_msgs/Path" in held[f"/{topics.GLOBAL_PLAN}"]
    assert "sensor_msgs/CompressedImage" in held[f"/{topics.IMAGE}/compressed"]
    assert "std_msgs/Float32" in held[f"/{topics.COVERAGE}"]
    bag_numbers.check(bag_numbers.numbers(bag))


def test_a_disk_that_is_too_full_is_told_before_anything_is_written(stack: Stack, tmp_path: Path) -> None:
    done = vsx(stack, "record", "--keep-free", "999TB", "--out", str(tmp_path / "a.bag"))
    assert done.returncode == FAILED
    assert "GB left on the disk (--keep-free 999TB)" in done.stderr
    assert done.stderr.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_the_size_limit_ends_a_recording(stack: Stack, tmp_path: Path) -> None:
    done = vsx(stack, "record", "--limit", "2MB", "--out", str(tmp_path / "a.bag"))
    assert done.returncode == DONE, done.stderr
    assert "limit of 2MB" in done.stderr
    assert 2e6 < (tmp_path / "a.bag").stat().st_size < 6e6
    refused = vsx(stack, "record", "--out", str(tmp_path / "a.bag"))
    assert refused.returncode == FAILED
    assert "exists" in refused.stderr


def test_a_recording_without_images_is_no_success(elsewhere: subprocess.Popen[str]) -> None:
    said, complained = elsewhere.communicate(timeout=PATIENCE_S)
    assert "/robot9/camera/rgb/image_raw" in complained
    assert elsewhere.returncode == FAILED
    assert "no image" in complained
    assert "vsx replay" not in said

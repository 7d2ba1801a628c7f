"""``vsx replay --ros``: a bag in place of the robot, in real time, and what is left of it."""

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rospy")

import cv2
from drive_bag import AHEAD, START_NS, driver, write_drive
from ros_ports import free_port
from waiting import PATIENCE_S, Lateness, wait_for

from vsx_ros.cli import main
from vsx_ros.config import Config
from vsx_ros.io.bag import open_recording
from vsx_ros.io.calibration_file import write_calibration
from vsx_ros.runs.folder import RunFolder
from vsx_ros.runs.process import DONE, FAILED, STOPPED
from vsx_ros.slam.slam import SequentialSlam

pytestmark = [pytest.mark.ros, pytest.mark.light]

CHECKOUT = Path(__file__).resolve().parents[2]
FRAMES, IMAGES_HZ = 60, 15.0


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_drive(tmp_path_factory.mktemp("drive") / "drive.bag", FRAMES)


def environment(tmp_path: Path) -> dict[str, str]:
    kept = {name: value for name, value in os.environ.items() if not name.startswith("ROS_")}
    master = {"ROS_MASTER_URI": f"http://localhost:{free_port()}", "ROS_HOME": str(tmp_path)}
    return {**kept, **master, "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)}


@pytest.fixture
def lateness() -> Iterator[Lateness]:
    measured = Lateness()
    yield measured
    measured.close()


def missed(lateness: Lateness) -> int:
    """Images for which this machine may have been late."""
    return round(IMAGES_HZ * lateness.since(0.0))


def command(bag: Path, *words: str) -> list[str]:
    return [sys.executable, "-m", "vsx_ros.cli.main", "replay", str(bag), "--ros", *words]


@pytest.fixture(scope="module")
def in_lock_step(bag: Path, tmp_path_factory: pytest.TempPathFactory) -> RunFolder:
    out = tmp_path_factory.mktemp("runs") / "lock_step"
    assert main.execute(["replay", str(bag), "--map", "--out", str(out)]) == DONE
    return RunFolder.open(out)


def test_a_recording_gives_what_the_drive_itself_gave(in_lock_step: RunFolder) -> None:
    robot = driver()
    slam = SequentialSlam(robot.camera_given, robot.T_base_cam_given, Config().slam, 0)
    results = [slam.track(*robot.step(AHEAD)) for _ in range(FRAMES)]
    tracked = [result for result in results if result.T_world_cam is not None]
    poses = in_lock_step.read_poses("trajectory")
    assert [pose.stamp_ns for pose in poses] == [START_NS + result.stamp_ns for result in tracked]
    for pose, result in zip(poses, tracked, strict=True):
        assert result.T_world_cam is not None
        assert np.allclose(pose.T.matrix(), result.T_world_cam.matrix(), atol=1e-7)


@pytest.mark.parametrize("rate", ["1", "0"])
def test_the_nodes_find_what_lock_step_finds(
    bag: Path, in_lock_step: RunFolder, tmp_path: Path, lateness: Lateness, rate: str
) -> None:
    out = tmp_path / "run"
    done = subprocess.run(
        command(bag, "--map", "--rate", rate, "--out", str(out)),
        env=environment(tmp_path), capture_output=True, text=True, timeout=PATIENCE_S, check=False,
    )  # fmt: skip
    assert done.returncode == DONE, done.stderr + done.stdout
    assert "the recording was played to its end" in done.stdout
    folder, expected = RunFolder.open(out), in_lock_step.read_summary()
    summary = folder.read_summary()
    late = 0 if rate == "0" else missed(lateness)
    assert summary["frames"] == FRAMES or rate == "1"
    assert expected["frames_tracked"] - 20 - late <= summary["frames_tracked"] <= expected["frames_tracked"] + 5
    assert summary["frames_lost"] == 0
    assert expected["ate_rmse_m"] < 0.03
    assert summary["ate_rmse_m"] < 0.03
    here, there = ({p.stamp_ns: p.T.translation for p in f.read_poses("trajectory")} for f in (folder, in_lock_step))
    last_ns = max(here)
    assert last_ns == max(there)
    assert abs(here[last_ns] - there[last_ns]).max() < 0.03
    free_m2 = [(f.read_map().data == 0).sum() * 0.05**2 for f in (folder, in_lock_step)]
    assert free_m2[0] == pytest.approx(free_m2[1], rel=0.3)
    assert (out / "report.html").exists()
    assert not list((out / "log").glob("*.active"))


def test_rosbags_own_player_feeds_the_nodes_too(
    bag: Path, in_lock_step: RunFolder, tmp_path: Path, lateness: Lateness
) -> None:
    """roslaunch ends by itself when the bag does, and leaves the results in a new folder. Slowly: rosbag play waits for
    nobody."""
    names = [
        "rate:=0.4",
        "image_topic:=/kinect/image_raw",
        "camera_info_topic:=/kinect/camera_info",
        "odometry_topic:=/wheels",
    ]
    done = subprocess.run(
        ["roslaunch", "vsx_ros", "replay.launch", f"bag:={bag}", *names],
        env={**environment(tmp_path), "ROS_PACKAGE_PATH": f"{CHECKOUT}:/usr/share", "VSX_PYTHON": sys.executable},
        capture_output=True, text=True, timeout=PATIENCE_S, check=False,
    )  # fmt: skip
    [path] = (tmp_path / "runs").iterdir()
    folder = RunFolder(path)
    assert (folder.path / "summary.json").exists(), done.stdout + done.stderr
    tracked, expected = folder.read_summary()["frames_tracked"], in_lock_step.read_summary()["frames_tracked"]
    assert expected - 15 - missed(lateness) <= tracked <= expected + 15
    here, there = folder.read_poses("trajectory")[-1], in_lock_step.read_poses("trajectory")[-1]
    assert abs(here.T.translation - there.T.translation).max() < 0.1
    free_m2 = [(f.read_map().data == 0).sum() * 0.05**2 for f in (folder, in_lock_step)]
    assert free_m2[0] == pytest.approx(free_m2[1], rel=0.4)


def test_without_odometry_there_is_no_scale_and_no_ground_map(bag: Path, tmp_path: Path) -> None:
    pictures, out = tmp_path / "pictures", tmp_path / "run"
    pictures.mkdir()
    recording = open_recording(bag)
    lines = []
    for k, frame in zip(range(20), recording.frames(), strict=False):
        cv2.imwrite(str(pictures / f"{k}.png"), frame.image)
        lines.append(f"{frame.stamp_ns * 1e-9:.9f} {k}.png")
    (pictures / "rgb.txt").write_text("\n".join(lines), encoding="utf-8")
    assert recording.camera is not None
    write_calibration(tmp_path / "camera.yaml", recording.camera, "emulated")
    words = ["--rate", "0", "--calibration", str(tmp_path / "camera.yaml"), "--out", str(out)]
    done = subprocess.run(
        command(pictures, *words),
        env=environment(tmp_path),
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        check=False,
    )
    assert len(RunFolder.open(out).read_frames()) == 20, done.stdout + done.stderr
    assert RunFolder.open(out).read_map() is None


def test_ctrl_c_ends_it_and_a_second_replay_is_refused(bag: Path, tmp_path: Path) -> None:
    out, shared, lines = tmp_path / "run", environment(tmp_path), []
    with subprocess.Popen(
        command(bag, "--rate", "0.1", "--out", str(out)), env=shared, stderr=subprocess.PIPE, text=True
    ) as first:
        assert first.stderr is not None
        threading.Thread(target=lines.extend, args=(first.stderr,), daemon=True).start()
        wait_for(lambda: any(line.startswith("image ") for line in lines), "an image", lambda: lines)
        refused = subprocess.run(
            command(bag, "--out", str(tmp_path / "other")),
            env=shared, capture_output=True, text=True, timeout=PATIENCE_S, check=False,
        )  # fmt: skip
        first.send_signal(signal.SIGINT)
        assert first.wait(PATIENCE_S) == STOPPED
    assert refused.returncode == FAILED
    assert "already publishes /clock" in refused.stderr
    assert refused.stderr.count("\n") == 1
    assert "stopped by the operator" in RunFolder.open(out).read_summary()["stop_reason"]


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["--ros", "--rate", "-1"], "--rate -1.0: give a number from 0"),
        (["--rate", "2"], "go with --ros"),
        (["--view"], "go with --ros"),
    ],
)
def test_mistakes_are_one_sentence(
    bag: Path, words: list[str], sentence: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main.execute(["replay", str(bag), *words]) == FAILED
    assert sentence in capsys.readouterr().err

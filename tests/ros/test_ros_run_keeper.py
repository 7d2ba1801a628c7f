"""What vslam keeps of a run: gone on with by the next session, and a full disk is told but ends nothing."""

import errno
import sys
import time
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rospy")

import rosgraph
import rospy
from processes import Processes
from ros_ports import HOST, free_port

from vsx_ros.config import Config
from vsx_ros.errors import InputError, MapFileError
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3
from vsx_ros.io.run_folder import RunEvent, RunFolder
from vsx_ros.robot import Odometry, VelocityCommand
from vsx_ros.ros import logs
from vsx_ros.ros.run_keeper import RunKeeper
from vsx_ros.sim.generate import generate_world
from vsx_ros.sim.robot import EmulatedRobot
from vsx_ros.slam.slam import SequentialSlam
from vsx_ros.slam.state import SlamEvent

CHECKOUT = Path(__file__).resolve().parents[2]
GROUND = {"start": np.zeros(3), "trail": np.zeros((0, 7)), "bumps": np.zeros((0, 7))}


@pytest.fixture(scope="module")
def driven():
    robot = EmulatedRobot(generate_world("lab", 3), 3)
    slam = SequentialSlam(robot.camera_given, robot.T_base_cam_given, Config().slam)
    frames = []
    for _ in range(40):
        frame, odometry = robot.step(VelocityCommand(0.2, 0.0))
        frames.append((slam.track(frame, odometry), odometry))
    assert slam.slam_map() is not None
    return robot, slam, frames


def test_what_was_kept_is_there_for_the_next_session(driven, tmp_path: Path) -> None:
    robot, slam, frames = driven
    keeper = RunKeeper(tmp_path, robot.T_base_cam_given)
    assert keeper.before is None
    for result, odometry in frames[:-5]:
        keeper.frame(result, odometry, 0.01, 5.0, [SlamEvent(result.stamp_ns, "lost", "why")])
    keeper.note(slam, frames[-6][0].stamp_ns, now=True)
    keeper.write(GROUND)
    for result, odometry in frames[-5:]:  # after the checkpoint, hence lost
        keeper.frame(result, odometry, 0.01, 6.0, [])
    again = RunKeeper(tmp_path, robot.T_base_cam_given)
    record = again.record
    assert again.before is not None
    assert len(again.before.slam_map.view.living) == len(slam.slam_map().view.living)
    assert [result.stamp_ns for result in record.results] == [result.stamp_ns for result, _ in frames[:-5]]
    assert record.u2_frames == [5.0] * (len(frames) - 5)
    assert record.events == [RunEvent(result.stamp_ns, "slam", "lost", "why") for result, _ in frames[:-5]]
    far = Odometry(frames[-1][1].stamp_ns, SE2(50.0, 0.0, 0.0))  # a base that counts anew is no break
    record.add_frame(frames[-1][0], far, 0.01, None)
    assert record.summary(slam.statistics()).breaks == 0


def test_a_map_that_takes_long_to_write_is_written_less_often(driven, tmp_path: Path, monkeypatch) -> None:
    robot, slam, frames = driven
    keeper, first_ns = RunKeeper(tmp_path, robot.T_base_cam_given), frames[-1][0].stamp_ns
    seconds = iter([0.0, 10.0, 20.0, 20.1, 30.0, 30.1])  # before and after each of three writes
    monkeypatch.setattr(time, "monotonic", lambda: next(seconds))

    def is_written(after_s: float) -> bool:
        (tmp_path / "resume" / "map.zip").unlink(missing_ok=True)
        keeper.note(slam, first_ns + round(after_s * 1e9))
        keeper.write(GROUND)
        return (tmp_path / "resume" / "map.zip").exists()

    written = [is_written(after_s) for after_s in (0.0, 5.0, 39.0, 41.0, 44.0, 47.0)]
    assert written == [True, False, False, True, False, True]


def test_a_full_disk_is_told_and_ends_nothing(driven, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    robot, slam, frames = driven
    said: list[str] = []
    monkeypatch.setattr(logs, "due", lambda *_: True)
    monkeypatch.setattr(rospy, "logerr", lambda form, error: said.append(form % error))
    keeper = RunKeeper(tmp_path, robot.T_base_cam_given)
    (tmp_path / "resume" / "keyframes").touch()  # no folder, so nothing can be written into it
    keeper.note(slam, frames[-1][0].stamp_ns)
    keeper.write(GROUND)
    assert len(said) == 1
    assert "cannot be written" in said[0]


def test_a_run_folder_of_nonsense_is_refused_at_once(tmp_path: Path) -> None:
    (tmp_path / "resume").mkdir()
    (tmp_path / "resume" / "map.zip").write_bytes(b"PK nonsense")
    with pytest.raises(MapFileError, match=r"map\.zip cannot be used"):
        RunKeeper(tmp_path, SE3.identity())


def test_the_end_leaves_the_results_and_the_last_map(driven, tmp_path: Path) -> None:
    robot, slam, frames = driven
    keeper = RunKeeper(tmp_path, robot.T_base_cam_given)
    for result, odometry in frames:
        keeper.odometry(odometry)
        keeper.frame(result, odometry, 0.01, 5.0, [])
    keeper.finish(slam, None, None)
    keeper.write(GROUND)
    assert len((tmp_path / "odometry.txt").read_text().splitlines()) >= len(frames)
    assert len((tmp_path / "frames.csv").read_text().splitlines()) == len(frames) + 1
    assert (tmp_path / "summary.json").exists()
    assert not (tmp_path / "map.pgm").exists()
    again = RunKeeper(tmp_path, robot.T_base_cam_given)
    assert again.before is not None
    assert again.before.stamp_ns == frames[-1][0].stamp_ns


@pytest.mark.ros
def test_a_run_that_went_on_in_a_loaded_map_is_gone_on_with_although_that_map_is_gone(driven, tmp_path: Path) -> None:
    robot, slam, frames = driven
    keeper = RunKeeper(tmp_path / "run", robot.T_base_cam_given)
    keeper.frame(*frames[-1], 0.01, 5.0, [])
    keeper.note(slam, frames[-1][0].stamp_ns)
    keeper.write(GROUND)
    uri = f"http://{HOST}:{free_port()}"
    nodes = Processes(tmp_path, uri, ROS_HOSTNAME=HOST)
    try:
        nodes.start("master", "rosmaster", "--core", "-p", uri.rsplit(":", 1)[1])
        nodes.wait(lambda: rosgraph.is_master_online(uri), "the master")
        script, gone = CHECKOUT / "scripts" / "vslam", tmp_path / "gone.vsxmap"
        node = nodes.start("vslam", sys.executable, str(script), f"_run_dir:={tmp_path / 'run'}", f"_load_map:={gone}")
        nodes.wait(lambda: "/vslam: ready" in nodes.logs() or node.poll() is not None, "the node")
        assert node.poll() is None, nodes.logs()
    finally:
        nodes.end()


def test_a_run_whose_results_cannot_be_written_can_be_gone_on_with(driven, tmp_path: Path, monkeypatch) -> None:
    robot, slam, frames = driven
    keeper = RunKeeper(tmp_path, robot.T_base_cam_given)
    for result, odometry in frames:
        keeper.frame(result, odometry, 0.01, 5.0, [])

    def refuse(*_) -> None:
        raise OSError(errno.ENOSPC, "full", "trajectory.txt")

    monkeypatch.setattr(RunFolder, "write_poses", refuse)
    with pytest.raises(InputError, match="trajectory.txt cannot be used"):
        keeper.finish(slam, None, None)
    assert {"summary.json", "frames.csv", "events.jsonl"} <= {path.name for path in tmp_path.iterdir()}
    keeper.write(GROUND)
    assert RunKeeper(tmp_path, robot.T_base_cam_given).before.stamp_ns == frames[-1][0].stamp_ns

"""What vslam keeps of a run: gone on with by the next session, and a full disk is told but ends nothing."""

import errno
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rospy")

import rosgraph
from processes import Processes
from ros_ports import HOST, free_port
from std_msgs.msg import Float64MultiArray

from vsx_ros.config import Config, OdometryConfig, from_dict
from vsx_ros.errors import MapFileError
from vsx_ros.evaluation.breaks import Continuity, continuity
from vsx_ros.geometry.se2 import SE2
from vsx_ros.occupancy.grid import OccupancyGrid
from vsx_ros.robot import Frame, Odometry, VelocityCommand
from vsx_ros.ros import logs, slam_run, topics
from vsx_ros.ros.slam_run import SlamRun
from vsx_ros.runs import record, session
from vsx_ros.runs.folder import RunFolder
from vsx_ros.runs.journal import FrameLine, RunEvent
from vsx_ros.runs.moments import Moments
from vsx_ros.runs.previous import PreviousSessions
from vsx_ros.runs.session import RunWriter
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
    folder = RunFolder(tmp_path)
    writer = RunWriter(robot.T_base_cam_given, folder)
    assert PreviousSessions.of(folder) is None
    for result, odometry in frames[:-5]:
        writer.frame(result, odometry, 0.01, 5.0, [SlamEvent(result.stamp_ns, "lost", "why")])
    writer.note(slam, frames[-6][0].stamp_ns, now=True)
    writer.write(GROUND)
    for result, odometry in frames[-5:]:  # after the checkpoint, hence lost
        writer.frame(result, odometry, 0.01, 6.0, [])
    before = PreviousSessions.of(folder)
    record = RunWriter(robot.T_base_cam_given, folder, before).record
    assert before is not None
    assert len(before.saved.slam_map.view.living) == len(slam.slam_map().view.living)
    assert [frame.stamp_ns for frame in record.frames] == [result.stamp_ns for result, _ in frames[:-5]]
    assert [frame.u2_frames for frame in record.frames] == [5.0] * (len(frames) - 5)
    assert record.events == [RunEvent(result.stamp_ns, "slam", "lost", "why") for result, _ in frames[:-5]]
    assert record.odom_epoch == 0
    far = Odometry(frames[-1][1].stamp_ns, SE2(50.0, 0.0, 0.0), odom_epoch=1)  # odometry that restarted is no break
    record.add_frame(FrameLine.of(frames[-1][0], far, 10.0, None))
    assert record.summary(slam.statistics()).breaks == 0


def test_a_map_that_takes_long_to_write_is_written_less_often(driven, tmp_path: Path, monkeypatch) -> None:
    robot, slam, frames = driven
    writer = RunWriter(robot.T_base_cam_given, RunFolder(tmp_path), rest=4.0)
    first_ns = frames[-1][0].stamp_ns
    seconds = iter([0.0, 10.0, 20.0, 20.1, 30.0, 30.1])  # before and after each of three writes
    monkeypatch.setattr(session, "time", SimpleNamespace(monotonic=lambda: next(seconds)))

    def is_written(after_s: float) -> bool:
        (tmp_path / "resume" / "map.zip").unlink(missing_ok=True)
        writer.note(slam, first_ns + round(after_s * 1e9))
        writer.write(GROUND)
        return (tmp_path / "resume" / "map.zip").exists()

    written = [is_written(after_s) for after_s in (0.0, 5.0, 39.0, 41.0, 44.0, 47.0)]
    assert written == [True, False, False, True, False, True]


def test_a_full_disk_is_told_and_ends_nothing(driven, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    robot, slam, frames = driven
    said: list[str] = []
    monkeypatch.setattr(logs, "due", lambda *_: True)
    monkeypatch.setattr(logs.rospy, "logerr", lambda form, error: said.append(form % error))
    writer = RunWriter(robot.T_base_cam_given, RunFolder(tmp_path), kept=logs.log_errors)
    (tmp_path / "resume" / "keyframes").touch()  # no folder, so nothing can be written into it
    writer.note(slam, frames[-1][0].stamp_ns)
    writer.write(GROUND)
    assert len(said) == 1
    assert "cannot be written" in said[0]


def test_a_run_folder_of_nonsense_is_refused_at_once(tmp_path: Path) -> None:
    (tmp_path / "resume").mkdir()
    (tmp_path / "resume" / "map.zip").write_bytes(b"PK nonsense")
    with pytest.raises(MapFileError, match=r"map\.zip cannot be used"):
        PreviousSessions.of(RunFolder(tmp_path))


def test_the_end_leaves_the_results(driven, tmp_path: Path) -> None:
    robot, slam, frames = driven
    writer = RunWriter(robot.T_base_cam_given)
    for result, odometry in frames:
        writer.frame(result, odometry, 0.01, 5.0, [])
    assert not writer.note(slam, frames[-1][0].stamp_ns, now=True), "it has nowhere to keep it"
    assert writer.finish(RunFolder(tmp_path), slam) == ""
    assert len((tmp_path / "odometry.txt").read_text().splitlines()) == len(frames) + 1
    assert len((tmp_path / "frames.csv").read_text().splitlines()) == len(frames) + 1
    assert (tmp_path / "summary.json").exists()
    assert not (tmp_path / "map.pgm").exists()


@pytest.mark.ros
@pytest.mark.light
def test_a_run_that_went_on_in_a_loaded_map_is_gone_on_with_although_that_map_is_gone(driven, tmp_path: Path) -> None:
    robot, slam, frames = driven
    writer = RunWriter(robot.T_base_cam_given, RunFolder(tmp_path / "run"))
    writer.frame(*frames[-1], 0.01, 5.0, [])
    writer.note(slam, frames[-1][0].stamp_ns)
    writer.write(GROUND)
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


def test_pictures_wait_for_the_writing_thread(driven, tmp_path: Path, monkeypatch) -> None:
    robot, slam, frames = driven
    monkeypatch.setattr(slam_run.rospy, "get_param", lambda name, usual: {"~run_dir": str(tmp_path)}.get(name, usual))
    run, grid = SlamRun(Config()), OccupancyGrid(np.zeros((4, 5)), 0.05, 0.0, 0.0)
    for result, _ in frames:
        run.see(Frame(result.stamp_ns, np.zeros((48, 64), np.uint8)), grid)
    assert Moments.read(tmp_path / "moments.jsonl").pictures == []
    run.write(GROUND)
    kept = Moments.read(tmp_path / "moments.jsonl")
    whole_seconds = {result.stamp_ns // 10**9 for result, _ in frames}
    assert [line.stamp_ns // 10**9 for line in kept.pictures] == sorted(whole_seconds)
    assert len(kept.maps) == 1, "it has not changed"


def test_a_node_that_is_killed_while_it_computes_results_has_kept_what_only_it_knows(
    driven, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """After an hour the results take seconds, and a node that does not end is killed; they can be made again."""
    robot, slam, frames = driven
    monkeypatch.setattr(slam_run.rospy, "get_param", lambda name, usual: {"~run_dir": str(tmp_path)}.get(name, usual))
    run, beside = SlamRun(Config()), list[Path]()
    for result, odometry in frames:
        run.frame(slam, result, odometry, 0.01)

    class Killed(BaseException):
        pass

    def killed(*_) -> None:
        raise Killed

    monkeypatch.setattr(RunWriter, "finish", killed)
    with pytest.raises(Killed):
        run.end(slam, GROUND, None, None, lambda _, path: beside.append(path))
    assert beside == [tmp_path / "map.yaml"]
    before = PreviousSessions.of(RunFolder(tmp_path))
    assert before is not None
    assert before.saved.stamp_ns == frames[-1][0].stamp_ns


def test_the_way_of_a_run_is_judged_once_for_all_its_results(driven, tmp_path: Path, monkeypatch) -> None:
    robot, slam, frames = driven
    run, judged = RunWriter(robot.T_base_cam_given), list[int]()
    for result, odometry in frames:
        run.frame(result, odometry, 0.01, None, [])

    def told(results, *others) -> Continuity:
        judged.append(len(results := list(results)))
        return continuity(results, *others)

    monkeypatch.setattr(record, "continuity", told)
    assert run.finish(RunFolder(tmp_path), slam) == ""
    assert judged == [len(frames)]


def test_a_run_whose_results_cannot_be_written_can_be_gone_on_with(driven, tmp_path: Path, monkeypatch) -> None:
    robot, slam, frames = driven
    monkeypatch.setattr(slam_run.rospy, "get_param", lambda name, usual: {"~run_dir": str(tmp_path)}.get(name, usual))
    run = SlamRun(Config())
    for result, odometry in frames:
        run.frame(slam, result, odometry, 0.01)

    def refuse(*_) -> None:
        raise OSError(errno.ENOSPC, "full", "trajectory.txt")

    said: list[str] = []
    monkeypatch.setattr(RunFolder, "write_poses", refuse)
    monkeypatch.setattr(logs.rospy, "logerr", lambda form, error: said.append(form % error))
    run.end(slam, GROUND, None, None, lambda *_: None)
    assert len(said) == 1
    assert "trajectory.txt cannot be used" in said[0]
    assert {"summary.json", "frames.csv", "events.jsonl"} <= {path.name for path in tmp_path.iterdir()}
    before = PreviousSessions.of(RunFolder(tmp_path))
    assert before is not None
    assert before.saved.stamp_ns == frames[-1][0].stamp_ns
    monkeypatch.undo()
    monkeypatch.setattr(slam_run.rospy, "get_param", lambda name, usual: {"~run_dir": str(tmp_path)}.get(name, usual))
    assert SlamRun(Config()).first_epoch == 1


def test_what_is_found_while_driving_multiplies_the_factors_that_the_base_told(driven, tmp_path, monkeypatch) -> None:
    """The base may have been started before the last calibration, or with parameters of its own."""
    robot, slam, frames = driven
    monkeypatch.setattr(slam_run.rospy, "get_param", lambda name, usual: {"~run_dir": str(tmp_path)}.get(name, usual))
    heard, known = dict[str, Any](), []
    monkeypatch.setattr(slam_run, "subscribe", lambda topic, kind, take, **_: heard.update({topic: take}))
    monkeypatch.setattr(slam_run, "write_self_calibration", lambda folder, calibration, factors: known.append(factors))
    run = SlamRun(from_dict({"robot": {"odometry": {"linear_scale": 0.974}}}))
    heard[topics.ODOM_FACTORS](Float64MultiArray(data=[1.0, 1.02]))
    for result, odometry in frames:
        run.frame(slam, result, odometry, 0.01)
    run.end(slam, GROUND, None, None, lambda *_: None)
    assert known == [OdometryConfig(1.0, 1.02)]


def test_a_disk_that_takes_nothing_keeps_no_node_from_beginning(driven, tmp_path: Path, monkeypatch) -> None:
    robot, slam, frames = driven
    monkeypatch.setattr(slam_run.rospy, "get_param", lambda name, usual: {"~run_dir": str(tmp_path)}.get(name, usual))
    said: list[str] = []
    monkeypatch.setattr(logs, "due", lambda *_: True)
    monkeypatch.setattr(logs.rospy, "logerr", lambda form, error: said.append(form % error))
    RunFolder(tmp_path).journal.mkdir(parents=True)  # where the journal should be, so it cannot be written
    run = SlamRun(Config())
    assert len(said) == 1
    assert "cannot be written" in said[0]
    for result, odometry in frames:
        run.frame(slam, result, odometry, 0.01)


def test_a_node_begins_with_the_zones_of_a_file_and_goes_on_with_its_own(driven, tmp_path: Path, monkeypatch) -> None:
    _, slam, frames = driven
    (tmp_path / "mine.yaml").write_text(
        "version: 1\nzones: [{name: rug, kind: wall, points: [[1, 0], [2, 0]]}]\n", encoding="utf-8"
    )
    params = {"~run_dir": str(tmp_path / "run"), "~zones": str(tmp_path / "mine.yaml")}
    monkeypatch.setattr(slam_run.rospy, "get_param", lambda name, usual: params.get(name, usual))
    run = SlamRun(Config())
    assert [zone.name for zone in run.session.ground.zones_in(slam.snapshot())] == ["rug"]
    run.session.ground.zones.remove("rug")
    for result, odometry in frames:
        run.frame(slam, result, odometry, 0.01)
    run.write(run.session.ground.state())
    assert len(SlamRun(Config()).session.ground.zones) == 0

"""What a run folder still tells when the SLAM that filled it did not come to its end."""

import os
from pathlib import Path

import pytest

from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3, StampedPose
from vsx_ros.robot import Odometry
from vsx_ros.runs.folder import RunFolder
from vsx_ros.runs.journal import FrameLine, Journal
from vsx_ros.runs.report import one_line_facts
from vsx_ros.runs.session import results_of_slam
from vsx_ros.slam.state import TrackingResult, TrackingState

MOUNT = SE3.identity()


def frame(k: int, state: TrackingState, *, odometry: bool = True) -> FrameLine:
    at = SE2(0.1 * k, 0.0, 0.0)
    pose = SE3.from_se2(at) if state.tracked else None
    result = TrackingResult(
        stamp_ns=k * 10**8, state=state, T_world_cam=pose, searched=100, found=90, keyframe_added=False, reason=""
    )
    return FrameLine.of(result, Odometry(k * 10**8, at) if odometry else None, 5.0, None)


def test_without_a_summary_the_journal_tells_what_it_knows(tmp_path: Path) -> None:
    folder = RunFolder(tmp_path)
    states = [TrackingState.NOT_INITIALISED, TrackingState.GOOD, TrackingState.DUBIOUS, TrackingState.LOST]
    Journal(folder.journal).add(*(frame(k, state) for k, state in enumerate(states)))
    summary, said = results_of_slam(folder, MOUNT)
    assert (summary.frames, summary.frames_tracked, summary.frames_lost, summary.u1) == (4, 2, 1, None)
    assert summary.breaks == 1, "lost for good"
    assert "before it had written its results" in said
    assert [pose.stamp_ns for pose in folder.read_poses("trajectory")] == [10**8, 2 * 10**8]


@pytest.mark.parametrize(("end", "breaks"), [(TrackingState.GOOD, None), (TrackingState.LOST, 1)])
def test_without_odometry_jumps_are_unknown_and_a_loss_for_good_is_not(
    tmp_path: Path, end: TrackingState, breaks: int | None
) -> None:
    folder = RunFolder(tmp_path)
    states = [TrackingState.GOOD] * 5 + [end]
    Journal(folder.journal).add(*(frame(k, state, odometry=False) for k, state in enumerate(states)))
    summary, _ = results_of_slam(folder, MOUNT)
    assert summary.breaks == breaks
    told = one_line_facts({**summary.as_dict(), "u1": 0.9})
    counted = "jumps unknown: no odometry" if breaks is None else "1 breaks"
    assert f"found 90 % of the points searched, {counted}" in told


@pytest.mark.parametrize(("jumps", "told"), [(1, "1 time, see"), (2, "2 times, see")])
def test_jumps_of_odometry_are_counted_in_words(jumps: int, told: str) -> None:
    assert one_line_facts({"odometry_jumps": jumps}) == [f"odometry jumped {told} events.jsonl"]


@pytest.mark.parametrize("content", [b"", b"{\n", b"\0" * 100 + b"\n"])
def test_a_journal_that_tells_nothing_leaves_all_unknown(tmp_path: Path, content: bytes) -> None:
    folder = RunFolder(tmp_path)
    folder.journal.parent.mkdir(parents=True)
    folder.journal.write_bytes(content)
    summary, said = results_of_slam(folder, MOUNT)
    assert summary.frames_tracked in (None, 0)
    assert summary.breaks is None
    assert said


def test_a_summary_that_is_there_is_taken_as_it_is(tmp_path: Path) -> None:
    folder = RunFolder(tmp_path)
    folder.write_summary({"frames": 3})
    summary, said = results_of_slam(folder, MOUNT)
    assert (summary.frames, said) == (3, "")


def test_what_vslam_had_no_time_to_write_comes_from_its_journal(tmp_path: Path) -> None:
    folder = RunFolder(tmp_path)
    Journal(folder.journal).add(*(frame(k, TrackingState.GOOD) for k in range(4)))
    folder.write_summary({"frames": 4, "keyframes": 2})
    summary, said = results_of_slam(folder, MOUNT)
    assert (summary.frames, summary.keyframes) == (4, 2)
    assert "before it had written its results" in said
    assert len(folder.read_poses("trajectory")) == 4
    assert results_of_slam(folder, MOUNT) == (summary, "")


def test_results_of_an_earlier_session_are_not_those_of_this_one(tmp_path: Path) -> None:
    folder = RunFolder(tmp_path)
    folder.write_summary({"frames": 2, "keyframes": 2})
    folder.write_poses("trajectory", [])
    Journal(folder.journal).add(*(frame(k, TrackingState.GOOD) for k in range(8)))
    summary, said = results_of_slam(folder, MOUNT)
    assert (summary.frames, summary.keyframes) == (8, None)
    assert said
    assert len(folder.read_poses("trajectory")) == 8


@pytest.mark.parametrize(("written", "whole"), [(8, True), (5, True), (4, False), (0, False)])
@pytest.mark.parametrize("at_s", [1, 2**31])
def test_the_journal_knows_whether_the_trajectory_is_of_this_session(
    tmp_path: Path, written: int, whole: bool, at_s: int
) -> None:
    """And not the times of the files, which a slow clock falsifies. Three frames came while it was written."""
    folder = RunFolder(tmp_path)
    Journal(folder.journal).add(*(frame(k, TrackingState.GOOD) for k in range(8)))
    poses = [StampedPose(k * 10**8, SE3.from_se2(SE2(0.1 * k, 0.0, 0.0))) for k in range(written)]
    folder.write_poses("trajectory", poses)
    folder.write_summary({"frames": 8, "keyframes": 2})
    os.utime(tmp_path / "trajectory.txt", (at_s, at_s))
    summary, said = results_of_slam(folder, MOUNT)
    assert (summary.keyframes, said == "") == (2, whole)
    assert len(folder.read_poses("trajectory")) == (written if whole else 8)


@pytest.mark.parametrize(("written", "whole"), [(0, True), (4, False)])
def test_a_map_given_up_leaves_no_trajectory(tmp_path: Path, written: int, whole: bool) -> None:
    folder = RunFolder(tmp_path)
    states = [TrackingState.GOOD] * 4 + [TrackingState.NOT_INITIALISED]
    Journal(folder.journal).add(*(frame(k, state) for k, state in enumerate(states)))
    folder.write_summary({"frames": 5})
    folder.write_poses("trajectory", [StampedPose(k * 10**8, SE3.identity()) for k in range(written)])
    assert (results_of_slam(folder, MOUNT)[1] == "") is whole
    assert folder.read_poses("trajectory") == []


def test_poses_of_a_map_that_was_begun_again_are_no_part_of_the_trajectory(tmp_path: Path) -> None:
    folder = RunFolder(tmp_path)
    states = [TrackingState.GOOD, TrackingState.GOOD, TrackingState.NOT_INITIALISED, TrackingState.GOOD]
    Journal(folder.journal).add(*(frame(k, state) for k, state in enumerate(states)))
    results_of_slam(folder, MOUNT)
    assert [pose.stamp_ns for pose in folder.read_poses("trajectory")] == [3 * 10**8]

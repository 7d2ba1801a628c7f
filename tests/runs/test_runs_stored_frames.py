"""Frames that are stored in little memory are the frames that were given, bit for bit."""

import tracemalloc
from pathlib import Path

import numpy as np
import pytest

from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3
from vsx_ros.robot import Odometry
from vsx_ros.runs.folder import RunFolder
from vsx_ros.runs.journal import FrameLine
from vsx_ros.runs.record import RunRecord
from vsx_ros.runs.stored_frames import StoredFrames
from vsx_ros.slam.anchor import Anchor
from vsx_ros.slam.state import TrackingResult, TrackingState

POSE, OTHER, THIRD = (SE3.exp(np.array([0.1, -2.0, 0.3, 0.5, k, -0.4])) for k in (0.1, 0.2, 0.3))
GOOD = TrackingResult(2**60, TrackingState.GOOD, POSE, 300, 290, True, anchor=Anchor(7, OTHER))
FRAMES = [
    FrameLine.of(TrackingResult(5, TrackingState.NOT_INITIALISED, reason="too little motion"), None, 0.1, None),
    FrameLine.of(GOOD, Odometry(3, SE2(0.1, 0.2, 0.3), odom_epoch=4), 1e3 / 3.0, 1.0 / 7.0),
    FrameLine.of(TrackingResult(3, TrackingState.LOST, None, 10, 0, reason="in map 2"), None, 12.0, 7.5),
    FrameLine.of(
        TrackingResult(-4, TrackingState.DUBIOUS, POSE, corrected=True, anchor=Anchor(0, THIRD, 1.0 / 3.0)),
        Odometry(3, SE2()), 12.0, None,
    ),
]  # fmt: skip


def frame(stamp_ns: int, odometry: Odometry | None = None) -> FrameLine:
    return FrameLine.of(GOOD._replace(stamp_ns=stamp_ns), odometry, 10.0, None)


@pytest.fixture
def stored() -> StoredFrames:
    stored = StoredFrames()
    for given in FRAMES:
        stored.append(given)
    return stored


def test_all_comes_back(stored: StoredFrames) -> None:
    assert list(stored) == FRAMES
    assert stored[-1] == FRAMES[3]
    assert stored[1:3] == FRAMES[1:3]


def test_it_is_a_sequence(stored: StoredFrames) -> None:
    assert len(stored) == 4
    assert not StoredFrames()
    for index in (4, -5):
        with pytest.raises(IndexError):
            stored[index]


def test_a_frame_that_is_being_added_disturbs_no_reader(stored: StoredFrames) -> None:
    stored._rows += b"a part of the next"
    assert list(stored) == FRAMES


def test_an_hour_of_frames_takes_little_memory() -> None:
    record, frames = RunRecord(SE3.identity()), 2000
    tracemalloc.start()
    for k in range(frames):
        anchor = Anchor(k // 10, SE3.exp(np.full(6, 0.001 * k)))
        result = TrackingResult(k, TrackingState.GOOD, SE3.exp(np.full(6, 0.002 * k)), 300, 290, anchor=anchor)
        odometry = Odometry(k, SE2(0.001 * k, 0.002 * k, 0.003 * k))
        record.add_frame(FrameLine.of(result, odometry, 10.0 + 1e-3 * k, 9.0 + 0.1 * k))
    taken, _ = tracemalloc.get_traced_memory()
    assert taken < 300 * frames, "an hour of 10 images a second is below 11 MB"
    assert not record.told()
    poses = record.estimate(), record.final(None)
    told, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert [len(of) for of in poses] == [frames, frames]
    assert told < 800 * frames, "and another 18 MB at its end"
    assert most < 1500 * frames


def test_frames_that_come_while_results_are_written_are_no_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    record = RunRecord(SE3.identity())
    for k in range(3):
        record.add_frame(frame(k, Odometry(k, SE2(0.1 * k, 0.0, 0.0))))
    convert = SE3.from_se2

    def while_another_thread_adds(T: SE2) -> SE3:
        record.add_frame(frame(9, Odometry(9, SE2())))
        return convert(T)

    monkeypatch.setattr(SE3, "from_se2", while_another_thread_adds)
    for write in record.writes(RunFolder(tmp_path)):
        write()
    assert len(RunFolder(tmp_path).read_poses("odometry")) >= 3


def test_all_frames_are_decoded_once_however_many_files_need_them(monkeypatch: pytest.MonkeyPatch) -> None:
    record, decoded, decode = RunRecord(SE3.identity()), [], StoredFrames.__getitem__
    for k in range(20):
        record.add_frame(frame(k))

    def counted(frames: StoredFrames, index: int) -> FrameLine:
        decoded.append(index)
        return decode(frames, index)

    monkeypatch.setattr(StoredFrames, "__getitem__", counted)
    assert len(record.estimate()) == len(record.final(None)) == len(record.frame_records()) == 20
    assert not record.told()
    assert len(decoded) <= 21, "each once, and once past the end"

"""Results that are stored as rows of numbers are the results that were given, bit for bit."""

import tracemalloc
from pathlib import Path

import numpy as np
import pytest

from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3
from vsx_ros.robot import Odometry
from vsx_ros.runs.folder import RunFolder
from vsx_ros.runs.record import RunRecord
from vsx_ros.runs.results import StoredResults
from vsx_ros.slam.anchor import Anchor
from vsx_ros.slam.state import TrackingResult, TrackingState

POSE, OTHER, THIRD = (SE3.exp(np.array([0.1, -2.0, 0.3, 0.5, k, -0.4])) for k in (0.1, 0.2, 0.3))
RESULTS = [
    TrackingResult(5, TrackingState.NOT_INITIALISED, reason="too little motion"),
    TrackingResult(
        2**60, TrackingState.GOOD, POSE, 300, 290, True, T_map_cam=POSE, covariance=np.eye(6), anchor=Anchor(7, OTHER)
    ),
    TrackingResult(3, TrackingState.LOST, None, 10, 0, map_id=2, T_map_cam=THIRD, reason="in map 2", ahead="half"),
    TrackingResult(4, TrackingState.DUBIOUS, POSE, corrected=True, anchor=Anchor(0, THIRD, 1.0 / 3.0)),
]


def bits(value: object) -> object:
    if isinstance(value, SE3):
        return value.rotation.tobytes(), value.translation.tobytes()
    return tuple(map(bits, value)) if isinstance(value, tuple) else value


@pytest.fixture
def stored() -> StoredResults:
    stored = StoredResults()
    for result in RESULTS:
        stored.append(result)
    return stored


def test_all_comes_back_but_the_covariance(stored: StoredResults) -> None:
    given = [result._replace(covariance=None) for result in RESULTS]
    assert [bits(result) for result in stored] == [bits(result) for result in given]
    assert bits(stored[-1]) == bits(given[3])
    assert [bits(result) for result in stored[1:3]] == [bits(result) for result in given[1:3]]


def test_it_is_a_sequence(stored: StoredResults) -> None:
    assert len(stored) == 4
    assert not StoredResults()
    for index in (4, -5):
        with pytest.raises(IndexError):
            stored[index]


def test_an_hour_of_frames_and_readings_takes_little_memory() -> None:
    record, frames = RunRecord(SE3.identity()), 2000
    tracemalloc.start()
    for k in range(frames):
        anchor = Anchor(k // 10, SE3.exp(np.full(6, 0.001 * k)))
        result = TrackingResult(k, TrackingState.GOOD, SE3.exp(np.full(6, 0.002 * k)), 300, 290, anchor=anchor)
        odometry = Odometry(k, SE2(0.001 * k, 0.002 * k, 0.003 * k))
        record.add_frame(result._replace(covariance=np.eye(6)), odometry, 0.01 + 1e-6 * k, 9.0 + 0.1 * k)
        for _ in range(4):
            record.add_odometry(odometry)
    taken, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert taken < 800 * frames, "an hour of 15 images a second is below 45 MB"


def test_readings_that_come_while_results_are_written_are_no_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    record = RunRecord(SE3.identity())
    for k in range(3):
        record.add_odometry(Odometry(k, SE2(0.1 * k, 0.0, 0.0)))
        record.add_frame(RESULTS[1]._replace(stamp_ns=k), Odometry(k, SE2(0.1 * k, 0.0, 0.0)), 0.01, None)
    convert = SE3.from_se2

    def while_another_thread_adds(T: SE2) -> SE3:
        record.add_odometry(Odometry(9, SE2()))
        record.add_frame(RESULTS[1], Odometry(9, SE2()), 0.01, None)
        return convert(T)

    monkeypatch.setattr(SE3, "from_se2", while_another_thread_adds)
    for write in record.writes(RunFolder(tmp_path)):
        write()
    assert len(RunFolder(tmp_path).read_poses("odometry")) >= 3


def test_all_results_are_decoded_once_however_many_files_need_them(monkeypatch: pytest.MonkeyPatch) -> None:
    record, decoded, decode = RunRecord(SE3.identity()), [], StoredResults.__getitem__
    for k in range(20):
        record.add_frame(RESULTS[1]._replace(stamp_ns=k), None, 0.01, None)

    def counted(results: StoredResults, index: int) -> TrackingResult:
        decoded.append(index)
        return decode(results, index)

    monkeypatch.setattr(StoredResults, "__getitem__", counted)
    assert len(record.estimate()) == len(record.final(None)) == len(record.frames()) == 20
    assert not record.told()
    assert len(decoded) <= 21, "each once, and once past the end"

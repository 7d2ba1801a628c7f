"""The way that a robot came, in a run that is resumed."""

import pytest

from vsx_ros.cli.main import parse
from vsx_ros.config import Config
from vsx_ros.exploration.decision import SavedMission
from vsx_ros.geometry.se2 import SE2
from vsx_ros.robot import Odometry
from vsx_ros.runs.checkpoint import Checkpoint, CheckpointData
from vsx_ros.runs.folder import RunFolder
from vsx_ros.runs.journal import FrameLine, Journal, OdometryLine, last_driven
from vsx_ros.runs.previous import PreviousSessions, end_trail
from vsx_ros.runs.start import begin
from vsx_ros.slam.state import TrackingResult, TrackingState

SECOND = 1_000_000_000


def test_a_robot_that_was_moved_forgets_the_way_it_came_and_nothing_else(tmp_path):
    folder = RunFolder.create(tmp_path)
    folder.write_config(Config(), ["vsx", "explore"], fast=False, world=None, base="kobuki")
    way, home = [SE2(-0.2, 0.0, 0.0), SE2(-0.1, 0.0, 0.0)], SE2(1.0, 0.0, 0.0)
    saved = SavedMission([home], [(home, 9.0, 2)], way, True, home)
    words = ["explore", "--resume", str(tmp_path)]
    with begin(parse([*words, "--moved"])):  # killed before it had a map: nothing to forget
        pass
    folder.checkpoint.write_mission(saved.tree(), 0)
    (folder.checkpoint.path / "map.zip").touch()
    for more, expected in (([], saved), (["--moved"], saved._replace(trail=[]))):
        with begin(parse([*words, *more])):
            assert SavedMission.of(folder.checkpoint.read_mission(), tmp_path) == expected


def test_the_way_driven_after_the_missions_last_word_is_in_the_journal(tmp_path):
    folder = RunFolder.create(tmp_path)
    folder.write_config(Config(), ["vsx", "explore"], fast=False, world=None, base="kobuki")
    drive = [SE2(4.0 + 0.1 * k, 2.0, 0.0) for k in range(6)]
    result = TrackingResult(0, TrackingState.GOOD, None, 0, 0, False, "")
    Journal(folder.journal).add(
        *(
            FrameLine.of(result._replace(stamp_ns=k * SECOND), Odometry(0, drive[k]), 1.0, None)
            for k in range(len(drive))
        )
    )
    saved = SavedMission([], [], [SE2(-0.1, 0.0, 0.0), SE2()], False, None)
    folder.checkpoint.write_mission(saved.tree(), 3 * SECOND + 1)
    (folder.checkpoint.path / "map.zip").touch()
    for _ in range(2):  # the second time there is nothing left to add
        with begin(parse(["explore", "--resume", str(tmp_path)])):
            pass
        trail = SavedMission.of(folder.checkpoint.read_mission(), tmp_path).trail
        assert [pose.x for pose in trail] == pytest.approx([-0.3, -0.2, -0.1, 0.0])


def test_what_came_after_is_known_by_the_journal_s_order_and_not_by_the_clock(tmp_path, monkeypatch):
    """The clock was set back by 50 s behind the third second, and the last checkpoint is of the fifth frame."""
    folder = RunFolder.create(tmp_path)
    stamps_ns = [second * SECOND for second in (100, 101, 102, 53, 54, 55)]
    result = TrackingResult(0, TrackingState.GOOD, None, 0, 0, False, "")
    frames = [
        FrameLine.of(result._replace(stamp_ns=stamp_ns), Odometry(0, SE2(0.1 * k, 0.0, 0.0)), 1.0, None)
        for k, stamp_ns in enumerate(stamps_ns)
    ]
    Journal(folder.journal).add(*frames)
    (folder.checkpoint.path / "map.zip").touch()
    monkeypatch.setattr(Checkpoint, "read", lambda _: CheckpointData(None, stamps_ns[4], {}, {}))
    last = OdometryLine(stamps_ns[5], frames[5].T_odom_base)
    assert PreviousSessions(folder).lines == [*frames[:5], last]
    saved = SavedMission([], [], [SE2(-0.1, 0.0, 0.0)], False, None)
    folder.checkpoint.write_mission(saved.tree(), stamps_ns[2])
    for _ in range(2):  # also in the journal that a session leaves which is killed before its first frame
        end_trail(folder, moved=False)
        trail = SavedMission.of(folder.checkpoint.read_mission(), tmp_path).trail
        assert [pose.x for pose in trail] == pytest.approx([-0.4, -0.2, -0.1, 0.0])
        Journal(folder.journal, PreviousSessions(folder).lines)
        assert last_driven(folder.journal) == last

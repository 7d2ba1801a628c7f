"""The report of a run that was killed, or still runs, shows what its journals know, and changes nothing."""

import math
from pathlib import Path

import numpy as np
import pytest
from msgspec import structs

from vsx_ros.cli.main import execute
from vsx_ros.config import Config
from vsx_ros.errors import InputError
from vsx_ros.evaluation.summary import Summary
from vsx_ros.geometry.mount import mounted
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3
from vsx_ros.io.map_file import map_png
from vsx_ros.limits import file_bytes
from vsx_ros.occupancy.grid import OccupancyGrid
from vsx_ros.robot import Odometry
from vsx_ros.runs import journal
from vsx_ros.runs.folder import RunFolder
from vsx_ros.runs.interrupted import REASON, REASON_OF_REPLAY
from vsx_ros.runs.journal import ClockLine, FrameLine, Journal, RunEvent, TruthLine, flat
from vsx_ros.runs.moments import map_line
from vsx_ros.runs.report import report_data
from vsx_ros.slam.state import TrackingResult, TrackingState

SECOND = 1_000_000_000
T_BASE_CAM = mounted(Config().robot.mount)


def base(k: int) -> SE2:
    return SE2(0.1 * k, math.sin(0.3 * k), 0.2 * k)


def frame(k: int) -> FrameLine:
    pose = SE3.from_se2(base(k)) @ T_BASE_CAM
    result = TrackingResult(
        stamp_ns=k * SECOND, state=TrackingState.GOOD, T_world_cam=pose, searched=100, found=90, keyframe_added=False,
        reason="",
    )  # fmt: skip
    return FrameLine.of(result, Odometry(k * SECOND, base(k)), 5.0, None)


def truth(k: int) -> TruthLine:
    at = base(k)
    return TruthLine(k * SECOND, flat(SE3.from_se2(at) @ T_BASE_CAM), (at.x, at.y, at.theta), collisions=0)


@pytest.fixture
def killed(tmp_path: Path) -> RunFolder:
    """Of the lock-step kind: one journal; 20 frames."""
    folder = RunFolder.create(tmp_path / "run")
    folder.write_config(Config(), ["vsx", "explore"], world="lab", seed=7, planner="fov", fast=True)
    events = [RunEvent(k * SECOND, "mission", "mapping", f"view {k}") for k in (9, 3)]
    Journal(folder.journal, [*events, *(line for k in range(20) for line in (frame(k), truth(k)))])
    return folder


def test_the_journal_tells_what_the_files_would(killed: RunFolder) -> None:
    data = report_data(killed)
    assert (data.summary["stop_reason"], data.summary["ended_well"]) == (REASON, False)
    assert [data.summary[key] for key in ("world", "seed", "planner", "frames", "breaks")] == ["lab", 7, "fov", 20, 0]
    assert data.summary["duration_s"] == pytest.approx(19.0)
    assert data.summary["ate_rmse_m"] == pytest.approx(0.0, abs=1e-6)
    assert [event[3] for event in data.events] == ["view 3", "view 9"]
    assert [row[0] for row in data.frames] == [k * SECOND for k in range(20)]
    assert len(data.estimate) == len(data.truth) == 20
    assert data.world_is_level


def test_a_killed_replay_is_not_called_one_that_can_be_resumed(killed: RunFolder) -> None:
    killed.write_config(Config(), ["vsx", "replay"], seed=7, input="/data/lab.bag")
    assert report_data(killed).summary["stop_reason"] == REASON_OF_REPLAY
    assert "--resume" not in REASON_OF_REPLAY


def test_the_other_journal_of_a_live_run_is_read_too(killed: RunFolder) -> None:
    hazard = RunEvent(5 * SECOND, "safety", "hazard", "bumper")
    clock = ClockLine(stamp_ns=0, elapsed_s=33.0, plans=2, collisions=0)
    Journal(killed.witness, [hazard, clock])
    data = report_data(killed)
    assert [event[1] for event in data.events] == ["mission", "safety", "mission"]
    assert data.summary["duration_s"] == 33.0


def test_its_duration_leaves_out_the_time_between_two_sessions(killed: RunFolder) -> None:
    """Of vslam alone, which has no clock of the whole run."""
    Journal(killed.journal, [frame(k) for k in (*range(20), *range(5000, 5010))])
    assert report_data(killed).summary["duration_s"] == pytest.approx(19.0 + 9.0)


def test_its_map_is_the_last_one_that_was_kept(killed: RunFolder) -> None:
    grids = [OccupancyGrid(np.full((4, 5 + k), 100 * k), 0.1, 1.0, 2.0) for k in range(2)]
    Journal(killed.moments, [map_line(k * SECOND, grid, map_png(grid)) for k, grid in enumerate(grids)])
    data = report_data(killed)
    assert np.array_equal(data.grid.data, grids[1].data)
    assert [seen.size for seen in data.maps] == [pytest.approx((0.5, 0.4)), pytest.approx((0.6, 0.4))]


def test_only_the_page_is_written_as_the_run_may_go_on(killed: RunFolder, capsys: pytest.CaptureFixture[str]) -> None:
    before = {path: path.read_bytes() for path in killed.path.rglob("*") if path.is_file()}
    assert execute(["report", str(killed.path)]) == 0
    page = killed.path / "report.html"
    assert capsys.readouterr().out.strip() == str(page)
    assert REASON in page.read_text()
    assert {path: path.read_bytes() for path in killed.path.rglob("*") if path.is_file() and path != page} == before


@pytest.mark.parametrize(("frames", "ended"), [(20, True), (25, True), (17, True), (16, False), (None, True)])
def test_a_run_has_ended_when_its_summary_knows_all_frames(killed: RunFolder, frames: int | None, ended: bool) -> None:
    """Three fewer: they came while it was written. Still fewer: it was resumed since, and killed again. More: the disk
    was full. None: of another kind of run."""
    killed.write_summary({"frames": frames, "stop_reason": "it is done"})
    assert report_data(killed).summary["stop_reason"] == ("it is done" if ended else REASON)


@pytest.mark.parametrize("frames", [None, 16, 20])
def test_the_long_journal_is_read_once(killed: RunFolder, monkeypatch: pytest.MonkeyPatch, frames: int | None) -> None:
    """frames: in the summary. None: there is none; 16: it is of an earlier session; 20: the run has ended."""
    if frames is not None:
        killed.write_summary({"frames": frames, "stop_reason": "it is done"})
    read: list[Path] = []
    monkeypatch.setattr(journal, "file_bytes", lambda path, most: read.append(path) or file_bytes(path, most))
    assert len(report_data(killed).frames) == (0 if frames == 20 else 20), "an ended run has them in a file of its own"
    assert read.count(killed.journal) == 1


def test_results_of_vslam_alone_are_not_the_end_of_a_run(killed: RunFolder) -> None:
    """Whoever completes them was killed meanwhile: the journals know more."""
    hazard = RunEvent(5 * SECOND, "safety", "hazard", "bumper")
    Journal(killed.witness, [hazard, ClockLine(stamp_ns=0, elapsed_s=33.0, plans=2, collisions=0)])
    killed.write_summary(Summary(frames=20, frames_tracked=20).as_dict())
    killed.write_events([])
    data = report_data(killed)
    assert (data.summary["stop_reason"], data.summary["duration_s"]) == (REASON, 33.0)
    assert len(data.events) == 3


def test_a_run_that_had_hardly_begun_has_a_page(tmp_path: Path) -> None:
    folder = RunFolder.create(tmp_path / "run")
    folder.write_config(Config(), ["vsx"])
    assert execute(["report", str(folder.path)]) == 0
    assert "There is no map" in (folder.path / "report.html").read_text()


def test_journals_that_cannot_be_are_told(killed: RunFolder) -> None:
    """Two frames of the same moment, after a jump of 9 m."""
    jumped = structs.replace(frame(5), T_world_cam=frame(95).T_world_cam)
    Journal(killed.journal, [frame(4), jumped, structs.replace(frame(6), stamp_ns=jumped.stamp_ns)])
    with pytest.raises(InputError, match="the journals in .* contradict themselves .*; run again"):
        report_data(killed)


def test_a_damaged_journal_is_told(killed: RunFolder) -> None:
    killed.journal.write_text("nonsense\n")
    with pytest.raises(InputError, match=r"journal\.jsonl is damaged"):
        report_data(killed)
    killed.write_summary({"frames": 20, "stop_reason": "it is done"})
    assert report_data(killed).summary["stop_reason"] == "it is done", "the results need no journal"

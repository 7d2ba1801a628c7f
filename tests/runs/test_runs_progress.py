"""How far a run had come: known area over time and metres, and with the truth the correct share."""

import csv
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from vsx_ros.config import Config
from vsx_ros.evaluation.summary import Summary
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3, StampedPose
from vsx_ros.io.map_file import map_png
from vsx_ros.occupancy.grid import FREE, UNKNOWN, OccupancyGrid
from vsx_ros.robot import Odometry
from vsx_ros.runs import progress
from vsx_ros.runs.folder import FrameRecord, RunFolder
from vsx_ros.runs.interrupted import REASON, REASON_OF_REPLAY
from vsx_ros.runs.journal import FrameLine, Journal, MapLine, PictureLine, RunEvent
from vsx_ros.runs.judge import MapJudge
from vsx_ros.runs.moments import map_line, preview
from vsx_ros.runs.report import report_data, write_report
from vsx_ros.runs.world import open_world, save_world
from vsx_ros.sim.truth import ground_truth_grid
from vsx_ros.slam.state import TrackingResult, TrackingState

SECOND = 1_000_000_000
BEGAN = 1_700_000_000 * SECOND
PAUSE_S = 5000.0
STRAIGHT = {0.1 * k: 0.02 * k for k in range(101)}  # 2 m in 10 s


def known(cells: int) -> OccupancyGrid:
    """A row of free cells of 0.01 m2 in unknown ground."""
    data = np.full((4, 100), UNKNOWN, np.int8)
    data[1, :cells] = FREE
    return OccupancyGrid(data, 0.1, -1.0, -0.2)


def stamp(second: float) -> int:
    return BEGAN + round(second * SECOND)


def ended_run(
    path: Path, maps: Mapping[float, OccupancyGrid], way: Mapping[float, float], pictures: tuple[float, ...] = ()
) -> RunFolder:
    """maps: by second. way: x of the odometry by second, of each frame."""
    folder = RunFolder.create(path / "run")
    folder.write_config(Config(), ["vsx", "explore"], seed=1)
    folder.write_frames([FrameRecord(stamp(at), "good", 9, 9, keyframe_added=False, track_ms=5.0) for at in way])
    folder.write_poses("odometry", [StampedPose(stamp(at), SE3.from_se2(SE2(x))) for at, x in way.items()])
    lines: list[PictureLine | MapLine] = [map_line(stamp(at), grid, map_png(grid)) for at, grid in maps.items()]
    lines += [PictureLine(stamp(at), preview(np.zeros((48, 64), np.uint8))) for at in pictures]
    Journal(folder.moments, lines).close()
    folder.write_summary(Summary(frames=len(way), stop_reason="explored").as_dict())
    return folder


def frame_line(second: float, x_m: float, epoch: int) -> FrameLine:
    tracked = TrackingResult(stamp(second), TrackingState.GOOD, SE3.identity())
    return FrameLine.of(tracked, Odometry(stamp(second), SE2(x_m), odom_epoch=epoch), 5.0, None)


def table(folder: RunFolder) -> dict[str, list[str]]:
    write_report(folder)
    with (folder.path / "progress.csv").open() as file:
        rows = list(csv.DictReader(file))
    return {name: [row[name] for row in rows] for name in rows[0]}


def numbers(column: list[str]) -> list[float]:
    return [float(cell) for cell in column]


def test_the_table_tells_area_over_time_and_metres_and_names_its_units(tmp_path: Path) -> None:
    told = table(ended_run(tmp_path, {2.0: known(10), 5.0: known(60)}, STRAIGHT, pictures=(2.0, 8.0)))
    assert list(told) == ["stamp_s", "elapsed_s", "driven_m", "known_area_m2", "coverage_correct"]
    assert numbers(told["elapsed_s"]) == [0.0, 2.0, 5.0, 8.0, 10.0]
    assert numbers(told["known_area_m2"]) == [0.0, 0.1, 0.6, 0.6, 0.6]
    assert numbers(told["driven_m"]) == pytest.approx([0.0, 0.4, 1.0, 1.6, 2.0], abs=0.021)
    assert told["stamp_s"][1] == "1700000002.000000000"
    assert set(told["coverage_correct"]) == {""}, "of a real place nobody knows it"


def test_the_last_row_is_of_the_final_map(tmp_path: Path) -> None:
    """It may have grown since the last moment."""
    folder = ended_run(tmp_path, {2.0: known(10)}, STRAIGHT)
    folder.write_map(known(90))
    assert numbers(table(folder)["known_area_m2"]) == pytest.approx([0.0, 0.1, 0.9])


def test_the_time_between_two_sessions_does_not_count_and_odometry_may_begin_again(tmp_path: Path) -> None:
    again = {PAUSE_S + second: 7.0 + x for second, x in STRAIGHT.items()}
    told = table(ended_run(tmp_path, {5.0: known(10), PAUSE_S + 5.0: known(60)}, {**STRAIGHT, **again}))
    assert numbers(told["elapsed_s"]) == [0.0, 5.0, 15.0, 20.0]
    assert numbers(told["driven_m"]) == pytest.approx([0.0, 1.0, 3.0, 4.0], abs=0.021)


def test_the_table_counts_from_the_first_event_as_the_report_does(tmp_path: Path) -> None:
    folder = ended_run(tmp_path, {2.0: known(10)}, STRAIGHT)
    folder.write_events([RunEvent(stamp(-3.0), "mission", "starting", "first drive")])
    assert numbers(table(folder)["elapsed_s"]) == [3.0, 5.0, 13.0]


def test_emulated_the_share_is_that_of_the_summary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    world, config = open_world("lab", 3), Config()
    ground = config.ground_map
    judge = MapJudge(world, config)
    truth = ground_truth_grid(world, ground.resolution_m, ground.obstacle_min_height_m, ground.obstacle_max_height_m)
    part = truth.data.copy()
    part[: len(part) // 2] = UNKNOWN
    grids = [OccupancyGrid(data, truth.resolution, truth.origin_x, truth.origin_y) for data in (part, truth.data)]
    folder = ended_run(tmp_path, {2.0: grids[0], 5.0: grids[1]}, STRAIGHT)
    save_world(world, folder.path / "world.yaml")
    told = table(folder)["coverage_correct"]
    shares = [judge.quality(grid).coverage_correct for grid in grids]
    assert numbers(told) == pytest.approx([0.0, *shares, shares[1]], abs=1e-5)
    assert shares[0] != shares[1]
    monkeypatch.setattr(progress, "_MOST_JUDGED", 1)
    assert table(folder)["coverage_correct"][1] == "", "of many maps some are compared"
    assert numbers(table(folder)["coverage_correct"][2:]) == pytest.approx([shares[1]] * 2, abs=1e-5)
    (folder.path / "progress.csv").unlink()
    folder.write_config(config, ["vsx", "explore"], seed=1, load_map="lab.vsxmap")
    assert set(table(folder)["coverage_correct"]) == {""}, "the place of a loaded map in the world is unknown"


def test_what_cannot_be_compared_is_left_out(tmp_path: Path) -> None:
    folder = ended_run(tmp_path, {2.0: known(10)}, STRAIGHT)
    save_world(open_world("lab", 3), folder.path / "world.yaml")
    line = map_line(stamp(2.0), known(10), map_png(known(10))[:40])
    Journal(folder.moments, [line]).close()
    assert table(folder)["coverage_correct"] == ["0", "", ""]


def test_the_shares_of_a_run_stay_when_files_of_its_world_are_gone(tmp_path: Path) -> None:
    folder = ended_run(tmp_path, {2.0: known(10)}, STRAIGHT)
    save_world(open_world("lab", 3), folder.path / "world.yaml")
    told = table(folder)
    assert "" not in told["coverage_correct"]
    (folder.path / "world.yaml").write_text("{}")
    assert table(folder) == told
    (folder.path / "progress.csv").unlink()
    assert set(table(folder)["coverage_correct"]) == {""}


def test_without_metres_there_is_no_table(tmp_path: Path) -> None:
    folder = ended_run(tmp_path, {2.0: known(10)}, STRAIGHT)
    table(folder)
    (folder.path / "odometry.txt").unlink()
    page = write_report(folder)
    assert not (folder.path / "progress.csv").exists(), "not even an old one"
    assert "<h2>Known area" not in page.read_text()


@pytest.mark.parametrize("content", [b"\xff\xfe", b'stamp_s,coverage_correct\n"' + b"1" * 200_000, b"a\0b\n1\n"])
def test_a_damaged_table_is_made_again(tmp_path: Path, content: bytes) -> None:
    folder = ended_run(tmp_path, {2.0: known(10)}, STRAIGHT)
    good = table(folder)
    (folder.path / "progress.csv").write_bytes(content)
    assert table(folder) == good


@pytest.mark.parametrize("damaged", [False, True])
def test_a_run_whose_maps_are_gone_makes_no_table_but_keeps_the_one_it_has(tmp_path: Path, damaged: bool) -> None:
    folder = ended_run(tmp_path, {2.0: known(10)}, STRAIGHT)
    before = table(folder)
    if damaged:
        folder.moments.write_text("no moment\n")
    else:
        folder.moments.unlink()
    assert table(folder) == before
    assert "<h2>Known area" not in (folder.path / "report.html").read_text()
    (folder.path / "progress.csv").unlink()
    write_report(folder)
    assert not (folder.path / "progress.csv").exists()


@pytest.mark.parametrize("ended", [True, False])
def test_a_way_that_no_image_saw_counts_and_a_restart_of_the_odometry_does_not(tmp_path: Path, ended: bool) -> None:
    """Seven metres without the camera, then counting anew from beside the place, which is no step of the base."""
    way = {0.0: 0.0, 1.0: 0.2, 2.0: 0.4, 40.0: 7.4, 41.0: 7.6, 42.0: 7.3, 43.0: 7.5}
    folder = ended_run(tmp_path, {0.5: known(10), 42.5: known(60)}, way)
    Journal(folder.journal, [frame_line(at, x, epoch=int(at > 41.0)) for at, x in way.items()]).close()
    if not ended:
        (folder.path / "summary.json").unlink()
    assert report_data(folder).progress[-1].driven_m == pytest.approx(7.8)


@pytest.mark.parametrize("reason", [REASON, REASON_OF_REPLAY])
def test_a_run_that_goes_on_shows_its_curves_and_writes_no_table(tmp_path: Path, reason: str) -> None:
    folder = ended_run(tmp_path, {2.0: known(10)}, STRAIGHT)
    folder.write_summary(Summary(stop_reason=reason).as_dict())
    assert "<h2>Known area" in write_report(folder).read_text()
    assert len(report_data(folder).progress) == 3
    assert not (folder.path / "progress.csv").exists()

"""The report of a run that fills every limit can still be sent and opened."""

from pathlib import Path

import numpy as np

from vsx_ros.config import Config
from vsx_ros.evaluation.summary import Summary
from vsx_ros.geometry.se3 import SE3, StampedPose
from vsx_ros.io.map_export import write_ply
from vsx_ros.io.map_file import map_png
from vsx_ros.occupancy.grid import OccupancyGrid
from vsx_ros.runs.folder import FrameRecord, RunFolder
from vsx_ros.runs.journal import Journal, MapLine, PictureLine, RunEvent
from vsx_ros.runs.moments import MAPS_BYTES, PICTURES_BYTES, Moments, map_line, preview
from vsx_ros.runs.report import write_report

SECOND = 1_000_000_000
LASTS_S, RATE_HZ, EVENTS_S = 600, 15, 1.0
MOST_BYTES = 15_000_000


def filled(folder: RunFolder) -> None:
    """Pictures and maps up to their limits, evenly over the run."""
    rng = np.random.default_rng(0)
    jpeg = preview(rng.integers(0, 256, (140, 180), np.uint8))  # as large as that of a room
    grid = OccupancyGrid(rng.choice(np.array([-1, 0, 100], np.int8), (100, 200)), 0.05, -3.0, -2.0)
    png = map_png(grid)
    lines: list[PictureLine | MapLine] = []
    for count, line in (
        (PICTURES_BYTES // len(jpeg), lambda stamp_ns: PictureLine(stamp_ns, jpeg)),
        (MAPS_BYTES // len(png), lambda stamp_ns: map_line(stamp_ns, grid, png)),
    ):
        lines += [line(round(second * SECOND)) for second in np.linspace(1.0, LASTS_S, count)]
    journal = Journal(folder.moments, sorted(lines, key=lambda line: line.stamp_ns))
    journal.close()


def test_the_report_of_ten_minutes_is_at_most_15_megabytes(tmp_path: Path) -> None:
    folder = RunFolder.create(tmp_path / "run")
    folder.write_config(Config(), ["vsx", "explore"], seed=1)
    filled(folder)
    stamps = [round(SECOND * k / RATE_HZ) for k in range(1, LASTS_S * RATE_HZ)]
    way = [SE3(np.eye(3), np.array([2.0 * np.sin(1e-3 * k), 1.0 + 1e-4 * k, 0.3])) for k in range(len(stamps))]
    folder.write_poses("trajectory", [StampedPose(*pose) for pose in zip(stamps, way, strict=True)])
    folder.write_poses("odometry", [StampedPose(*pose) for pose in zip(stamps, way, strict=True)])
    folder.write_frames([FrameRecord(stamp_ns, "good", 300, 220, False, 20.0, 30.0) for stamp_ns in stamps])
    why = "driving {:.1f} m to look at 1.4 m2 of unknown ground [view at (2.2, 0.1) looking 165 deg, 64 landmarks: U]"
    states = "mapping", "recovering", "held"
    events = [
        RunEvent(round(second * SECOND), "mission", states[int(second) % 3], why.format(second))
        for second in np.arange(0.0, LASTS_S, EVENTS_S).tolist()
    ]
    folder.write_events(events)
    folder.write_map(OccupancyGrid(np.zeros((400, 400), np.int8), 0.05, 0.0, 0.0))
    write_ply(folder.path / "sparse.ply", np.random.default_rng(1).uniform(-5.0, 5.0, (30_000, 3)))
    folder.write_summary(Summary(frames=len(stamps), frames_tracked=len(stamps), stop_reason="explored").as_dict())
    kept = Moments.read(folder.moments)
    assert sum(len(line.image) for line in kept.pictures) > 0.99 * PICTURES_BYTES
    assert sum(len(line.image) for line in kept.maps) > 0.99 * MAPS_BYTES
    size = write_report(folder).stat().st_size
    assert (PICTURES_BYTES + MAPS_BYTES) * 4 / 3 * 0.99 < size < MOST_BYTES

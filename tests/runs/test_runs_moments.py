"""Pictures and maps of a run's moments: about one a second, bounded, and the last things to need the disk."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from vsx_ros.config import Config, RunsConfig
from vsx_ros.errors import InputError, MapFileError
from vsx_ros.geometry.se3 import SE3
from vsx_ros.io.map_file import map_of_png, map_png
from vsx_ros.occupancy.grid import OccupancyGrid
from vsx_ros.robot import Frame
from vsx_ros.runs import moments
from vsx_ros.runs.folder import FILES, RunFolder
from vsx_ros.runs.journal import Journal, MapLine, PictureLine
from vsx_ros.runs.moments import Moments, MomentWriter, preview
from vsx_ros.runs.report import report_data, write_report
from vsx_ros.runs.session import RunWriter

SECOND = 1_000_000_000
NONE = Moments([], [])


def frame(second: float, shape: tuple[int, int] = (48, 64)) -> Frame:
    """Noise: the worst for a JPEG."""
    rng = np.random.default_rng(int(1000 * second))
    return Frame(round(second * SECOND), rng.integers(0, 256, shape, np.uint8))


def grid(known: int) -> OccupancyGrid:
    data = np.full(400, -1, np.int8)
    data[:known] = 0
    return OccupancyGrid(data.reshape(20, 20), 0.5, -3.0, 4.0)


def drive(writer: MomentWriter, end: float, rate: float = 10.0, most_known: int = 400) -> None:
    """Each second one cell more is known, up to this many."""
    for second in np.arange(0.0, end, 1.0 / rate).tolist():
        if writer.see(frame(second), grid(min(int(second), most_known))):
            writer.write()


def test_one_picture_a_second_and_a_map_when_it_changed(tmp_path: Path) -> None:
    writer = MomentWriter(tmp_path / "m.jsonl", 1.0, NONE)
    drive(writer, 20.0, most_known=10)
    kept = Moments.read(tmp_path / "m.jsonl")
    assert [line.stamp_ns / SECOND for line in kept.pictures] == pytest.approx(list(range(20)), abs=1e-6)
    assert [line.known_area_m2 for line in kept.maps] == [0.25 * k for k in range(11)]
    last = kept.maps[-1]
    again = map_of_png(last.image, "it", last.resolution, last.origin)
    assert np.array_equal(again.data, grid(10).data)
    assert (again.resolution, again.origin_x, again.origin_y) == (0.5, -3.0, 4.0)


@pytest.mark.parametrize(
    ("shape", "small"),
    [((480, 640), (240, 320)), ((1024, 1280), (256, 320)), ((300, 100), (300, 100)), ((1, 700), (1, 320))],
)
def test_a_picture_is_small(shape: tuple[int, int], small: tuple[int, int]) -> None:
    """The noise of the worst camera takes 40 kB; a room takes 7 to 9."""
    jpeg = preview(frame(1.0, shape).image)
    assert cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_UNCHANGED).shape == small
    assert 100 < len(jpeg) < 60_000


def test_a_long_run_keeps_fewer_moments_of_all_of_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(moments, "PICTURES_BYTES", 40 * len(preview(frame(1.0).image)))
    monkeypatch.setattr(moments, "MAPS_BYTES", 30 * len(map_png(grid(30))))
    writer = MomentWriter(tmp_path / "m.jsonl", 1.0, NONE)
    drive(writer, 300.0, rate=2.0)
    kept = Moments.read(tmp_path / "m.jsonl")
    assert sum(len(line.image) for line in kept.pictures) <= moments.PICTURES_BYTES
    assert sum(len(line.image) for line in kept.maps) <= moments.MAPS_BYTES
    seconds = np.array([line.stamp_ns / SECOND for line in kept.pictures])
    assert len(seconds) in range(20, 41)
    assert np.diff(seconds) == pytest.approx(8.0)
    assert 15 <= len(kept.maps) <= 30
    assert set(np.diff([line.stamp_ns // SECOND for line in kept.maps])) == {16}
    assert [line.stamp_ns for line in kept.maps] == sorted(line.stamp_ns for line in kept.maps)


def test_a_file_damaged_meanwhile_costs_its_moments_and_no_more(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is not read again with every moment, and does not grow without end; the file before it is closed."""
    monkeypatch.setattr(moments, "PICTURES_BYTES", 10 * len(preview(frame(1.0).image)))
    path = tmp_path / "m.jsonl"
    writer = MomentWriter(path, 1.0, NONE)
    drive(writer, 5.0)
    first = writer._journal
    path.write_bytes(path.read_bytes().replace(b"picture", b"pixture"))
    with pytest.raises(InputError, match="damaged"):
        drive(writer, 60.0)
    assert Moments.read(path).pictures == []
    assert first._file.closed
    writer.see(frame(100.0), None)
    writer.write()
    assert len(Moments.read(path).pictures) == 1


def test_another_session_goes_on_with_the_pictures(tmp_path: Path) -> None:
    folder = RunFolder(tmp_path)
    for begin in (0.0, 5.0):
        writer = RunWriter(SE3.identity(), folder)
        for second in (begin, begin + 1.0):
            assert writer.see(frame(second), grid(7))
            writer.write_seen()
    kept = Moments.read(folder.moments)
    assert [line.stamp_ns // SECOND for line in kept.pictures] == [0, 1, 5, 6]


def test_a_clock_that_was_set_back_costs_no_picture(tmp_path: Path) -> None:
    writer = MomentWriter(tmp_path / "m.jsonl", 1.0, NONE)
    assert [writer.see(frame(second), None) for second in (7.0, 7.5, 3.0, 3.5)] == [True, False, True, False]


def test_a_slow_disk_costs_the_oldest_moments(tmp_path: Path) -> None:
    writer = MomentWriter(tmp_path / "m.jsonl", 1.0, NONE)
    for second in range(100):
        writer.see(frame(second), None)
    writer.write()
    assert [line.stamp_ns // SECOND for line in Moments.read(tmp_path / "m.jsonl").pictures] == list(range(90, 100))


def test_a_nearly_full_disk_is_left_to_map_and_results(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    writer = RunWriter(SE3.identity(), RunFolder(tmp_path))
    monkeypatch.setattr(Journal, "disk_bytes", lambda self: 2**22)
    for second in range(3):
        writer.see(frame(second), None)
        writer.write_seen()
    assert Moments.read(tmp_path / "moments.jsonl") == NONE
    assert "4 MiB are left on the disk, 64 are kept for map and results; free the disk" in writer.failure
    assert capsys.readouterr().err.count("\n") == 1
    monkeypatch.setattr(Journal, "disk_bytes", lambda self: 2**30)
    writer.see(frame(9), None)
    writer.write_seen()
    assert [line.stamp_ns for line in Moments.read(tmp_path / "moments.jsonl").pictures] == [9 * SECOND]


def test_nothing_is_kept_where_nothing_is_wanted(tmp_path: Path) -> None:
    for folder, config in ((RunFolder(tmp_path), RunsConfig(moments_s=0.0)), (None, RunsConfig())):
        writer = RunWriter(SE3.identity(), folder, config=config)
        assert not writer.see(frame(1), None)
        writer.write_seen()
    assert not (tmp_path / "moments.jsonl").exists()


def test_a_replay_keeps_pictures_and_nothing_to_resume(tmp_path: Path) -> None:
    writer = RunWriter(SE3.identity(), RunFolder(tmp_path), resumable=False)
    assert writer.see(frame(1), None)
    writer.write_seen()
    assert [path.name for path in tmp_path.iterdir()] == ["moments.jsonl"]
    assert "moments.jsonl" in FILES


def test_damaged_pictures_are_told_and_the_next_session_begins_anew(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = RunFolder(tmp_path)
    folder.moments.write_text('{"type":"picture","stamp_ns":1,"image":"not base64"}\n')
    with pytest.raises(InputError, match=r"moments\.jsonl is damaged .*; delete it"):
        Moments.read(folder.moments)
    writer = RunWriter(SE3.identity(), folder)
    assert "the run goes on" in capsys.readouterr().err
    writer.see(frame(1), None)
    writer.write_seen()
    assert len(Moments.read(folder.moments).pictures) == 1


GOOD = preview(frame(1.0).image)
HUGE = map_png(grid(3))[:16] + (2**20).to_bytes(4, "big") * 2 + map_png(grid(3))[24:]


@pytest.mark.parametrize(
    "line",
    [
        PictureLine(SECOND, b"no picture"),
        PictureLine(SECOND, GOOD[:10]),
        MapLine(stamp_ns=SECOND, image=HUGE, origin=(0.0, 0.0), resolution=0.05, known_area_m2=1.0),
        MapLine(stamp_ns=SECOND, image=GOOD, origin=(2e6, 0.0), resolution=0.05, known_area_m2=1.0),
        MapLine(stamp_ns=SECOND, image=GOOD, origin=(0.0, 0.0), resolution=0.0, known_area_m2=1.0),
    ],
)
def test_a_report_goes_without_damaged_pictures_and_says_why(tmp_path: Path, line: PictureLine | MapLine) -> None:
    folder = RunFolder.create(tmp_path / "run")
    folder.write_config(Config(), ["vsx"])
    folder.write_summary({"frames": 0})
    Journal(folder.moments, [PictureLine(0, GOOD), line])
    data = report_data(folder)
    assert (data.pictures, data.maps) == ([], [])
    assert "moments.jsonl" in data.moments_trouble
    assert "delete it" in data.moments_trouble


def test_the_report_of_any_run_stays_below_15_megabytes(tmp_path: Path) -> None:
    """Also of a file that is far larger than this program writes."""
    folder = RunFolder.create(tmp_path / "run")
    folder.write_config(Config(), ["vsx"])
    folder.write_summary({"frames": 0})
    jpeg, png = preview(frame(1.0, (240, 320)).image), map_png(grid(200)) + bytes(5000)
    lines = [PictureLine(k * SECOND, jpeg) for k in range(600)]
    maps = [
        MapLine(stamp_ns=k * SECOND, image=png, origin=(0, 0), resolution=0.05, known_area_m2=1) for k in range(900)
    ]
    Journal(folder.moments, [*lines, *maps])
    assert folder.moments.stat().st_size > 24e6
    assert 6e6 < write_report(folder).stat().st_size < 15e6


def test_stamps_without_end_are_thinned_in_finite_time() -> None:
    lines = [PictureLine(stamp_ns, bytes(10)) for stamp_ns in (-(2**62), -1, 0, 2**62 - 1)]
    kept, _ = moments._thinned(lines, 1, 1)
    assert 1 <= len(kept) <= 2


def test_a_map_picture_that_is_none_is_refused() -> None:
    with pytest.raises(MapFileError, match=r"the last map is no map .*; delete the file"):
        map_of_png(b"no picture", "the last map", 0.05, (0.0, 0.0))

"""Folders of images in the layout of the TUM RGB-D benchmark: rgb.txt, rgb/, groundtruth.txt, odometry.txt,
camera.json."""

import io
import re
from collections.abc import Iterator
from operator import attrgetter
from pathlib import Path

import numpy as np

from vsx_ros.errors import InputError, explained
from vsx_ros.geometry.level import LevelWatch
from vsx_ros.io.calibration_file import read_calibration
from vsx_ros.io.image_encoding import GrayImages
from vsx_ros.io.left_out import tried
from vsx_ros.io.recording import Recording
from vsx_ros.io.trajectory_file import parse_stamp, read_trajectory
from vsx_ros.limits import LOG_BYTES, file_bytes
from vsx_ros.robot import Frame, Odometry, with_speeds

CALIBRATION_NAMES = ("camera.json", "camera.yaml", "calibration.yaml", "camera_info.yaml")
_MOST_IMAGES = 2**20  # nine hours at 30 per second
_LONGEST_NAME = 1000  # of a file; longer is invalid
_SEPARATOR = re.compile(r"[\s,]+")
_LONGEST_GAP_S = 60.0  # on the median: no camera that moves can be followed at this rate
_STAMP = attrgetter("stamp_ns")


def open_folder(folder: Path, *, own_camera: bool = True, without_odometry: bool = False) -> Recording:
    """A folder with images listed in rgb.txt; optionally groundtruth.txt (T_world_cam), odometry.txt (T_odom_base) and
    calibration. Raises InputError when rgb.txt is missing, empty or malformed, CalibrationError. own_camera: whether to
    look at the calibration. without_odometry: odometry.txt is not looked at."""
    listed = _listed_images(folder)

    def frames() -> Iterator[Frame | InputError]:
        gray = GrayImages()
        for stamp_ns, name in listed:
            yield tried(_frame, stamp_ns, folder, name, gray)

    truth = folder / "groundtruth.txt"
    calibration = next((folder / name for name in CALIBRATION_NAMES if (folder / name).exists()), None)
    camera = read_calibration(calibration) if own_camera and calibration is not None else None
    odometry, damage = ([], "") if without_odometry else _odometry(folder / "odometry.txt")
    known = sorted(read_trajectory(truth), key=_STAMP) if truth.exists() else []
    recording = Recording(
        source=folder,
        image_topic=None,
        odometry_topic=None,
        frame_count=len(listed),
        camera=camera,
        odometry=odometry,
        ground_truth=known,
        open_frames=frames,
        damage=damage,
    )
    return recording.with_odometry_at(stamp_ns for stamp_ns, _ in listed)


def _frame(stamp_ns: int, folder: Path, name: str, gray: GrayImages) -> Frame:
    path = folder / name
    what = f"image {path} named in {folder / 'rgb.txt'} cannot be read"
    with explained(InputError, what, "copy the folder again or delete its line"):
        content = file_bytes(path, LOG_BYTES)
    return Frame(stamp_ns, gray.of_file(content, f"image {path}"))


def _listed_images(folder: Path) -> list[tuple[int, str]]:
    index = folder / "rgb.txt"
    if not index.exists():
        raise InputError(
            f"folder {folder} has no rgb.txt and no metadata.yaml; give a bag or a folder in the TUM RGB-D layout"
        )
    with explained(InputError, f"{index} cannot be read", "give a text file of lines 'stamp file'"):
        text = file_bytes(index, LOG_BYTES).decode("utf-8-sig", errors="replace")
    listed: list[tuple[int, str]] = []
    for number, line in enumerate(io.StringIO(text), start=1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        try:
            stamp, name = _SEPARATOR.split(line.strip(), maxsplit=1)
            if len(name) > _LONGEST_NAME:
                raise ValueError("no file has so long a name")
            listed.append((parse_stamp(stamp), name))
        except (ValueError, OverflowError) as error:
            expected = "expected 'stamp file', the stamp in seconds"
            raise InputError(f"{index}, line {number}: {expected}, got {line.strip()[:80]!r}") from error
        if len(listed) > _MOST_IMAGES:
            raise InputError(f"{index} lists more than {_MOST_IMAGES} images; cut the recording into parts")
    if not listed:
        raise InputError(f"{index} lists no image; each line shall be 'stamp file'")
    if len(listed) > 1 and (gap_s := 1e-9 * float(np.median(np.diff(sorted(ns for ns, _ in listed))))) > _LONGEST_GAP_S:
        raise InputError(f"{index}: from image to image are {gap_s:g} s; give stamps in seconds, not nanoseconds")
    return listed


def _odometry(path: Path) -> tuple[list[Odometry], str]:
    """The readings by stamp, or why they are not of wheels, in words."""
    readings, watch = list[Odometry](), LevelWatch()
    for stamp_ns, T in sorted(read_trajectory(path), key=_STAMP) if path.exists() else ():
        watch.see(T)
        reading = Odometry(stamp_ns, T.to_se2())
        readings.append(with_speeds(reading, readings[-1]) if readings else reading)
    return ([], f"odometry of {path} is not used: {watch.refusal}") if watch.refusal else (readings, "")

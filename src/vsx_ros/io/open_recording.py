"""A recording by its path: a bag, or images in the layout of the TUM RGB-D benchmark (rgb.txt, rgb/, groundtruth.txt,
camera.json)."""

import io
from collections.abc import Iterator
from dataclasses import replace
from operator import attrgetter
from pathlib import Path

from vsx_ros.errors import InputError, explained
from vsx_ros.io.bag import open_bag
from vsx_ros.io.bag_reader import METADATA
from vsx_ros.io.calibration_file import read_calibration
from vsx_ros.io.image_encoding import decoded
from vsx_ros.io.recording import Recording, with_speeds
from vsx_ros.io.trajectory_file import parse_stamp, read_trajectory
from vsx_ros.limits import LOG_BYTES, file_bytes
from vsx_ros.robot import Frame, Odometry, OdometryEpochs

_MOST_IMAGES = 2**20  # nine hours at 30 a second
_LONGEST_NAME = 1000  # of a file: longer is no name
_STAMP = attrgetter("stamp_ns")
CALIBRATION_NAMES = ("camera.json", "camera.yaml", "calibration.yaml", "camera_info.yaml")


def open_recording(path: Path, image_topic: str | None = None, odometry_topic: str | None = None) -> Recording:
    """A ROS 1 or ROS 2 bag, or a folder in the TUM RGB-D layout (rgb.txt, rgb/, groundtruth.txt, camera.json). Raises
    InputError saying what is wrong with the input and what to do."""
    if path.is_dir() and not (path / METADATA).exists():
        recording = _open_folder(path)
    elif not path.exists():
        raise InputError(f"there is no {path}; give a bag or a folder with rgb.txt")
    else:
        recording = open_bag(path, image_topic, odometry_topic)
    epochs = OdometryEpochs()
    return replace(recording, odometry=[epochs.enter(reading) for reading in recording.odometry])


def _open_folder(folder: Path) -> Recording:
    """Images listed in rgb.txt; groundtruth.txt (T_world_cam), odometry.txt (T_odom_base) and calibration if there.
    Raises InputError when rgb.txt is missing, empty or malformed."""
    listed = _listed_images(folder)

    def frames() -> Iterator[Frame]:
        for stamp_ns, name in listed:
            path = folder / name
            what = f"image {path} named in {folder / 'rgb.txt'} cannot be read"
            with explained(InputError, what, "copy the folder again or delete its line"):
                content = file_bytes(path, LOG_BYTES)
            yield Frame(stamp_ns, decoded(content, f"image {path}"))

    truth = folder / "groundtruth.txt"
    calibration = next((folder / name for name in CALIBRATION_NAMES if (folder / name).exists()), None)
    return Recording(
        source=folder,
        image_topic=None,
        odometry_topic=None,
        frame_count=len(listed),
        camera=read_calibration(calibration) if calibration is not None else None,
        odometry=_odometry(folder / "odometry.txt"),
        ground_truth=sorted(read_trajectory(truth), key=_STAMP) if truth.exists() else [],
        open_frames=frames,
    )


def _listed_images(folder: Path) -> list[tuple[int, str]]:
    index = folder / "rgb.txt"
    if not index.exists():
        raise InputError(
            f"folder {folder} has no rgb.txt and no metadata.yaml; give a bag or a folder in the TUM RGB-D layout"
        )
    with explained(InputError, f"{index} cannot be read", "give a text file of lines 'stamp file'"):
        text = file_bytes(index, LOG_BYTES).decode(errors="replace")
    listed: list[tuple[int, str]] = []
    for number, line in enumerate(io.StringIO(text), start=1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        stamp, _, name = line.strip().partition(" ")
        try:
            if len(name) > _LONGEST_NAME:
                raise ValueError("no file has so long a name")
            listed.append((parse_stamp(stamp), name.strip()))
        except (ValueError, OverflowError) as error:
            raise InputError(f"{index}, line {number}: expected 'stamp file', got {line.strip()[:80]!r}") from error
        if len(listed) > _MOST_IMAGES:
            raise InputError(f"{index} lists more than {_MOST_IMAGES} images; cut the recording into parts")
    if not listed:
        raise InputError(f"{index} lists no image; each line shall be 'stamp file'")
    return listed


def _odometry(path: Path) -> list[Odometry]:
    if not path.exists():
        return []
    readings: list[Odometry] = []
    for stamp_ns, T in sorted(read_trajectory(path), key=_STAMP):
        reading = Odometry(stamp_ns, T.to_se2())
        readings.append(with_speeds(reading, readings[-1]) if readings else reading)
    return readings

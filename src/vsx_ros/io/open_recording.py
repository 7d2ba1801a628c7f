"""Which reader a recording wants."""

from dataclasses import replace
from pathlib import Path

from vsx_ros.errors import InputError
from vsx_ros.io.bag import open_bag
from vsx_ros.io.bag_reader import METADATA
from vsx_ros.io.recording import Recording
from vsx_ros.io.tum_folder import open_folder
from vsx_ros.robot import OdometryEpochs


def open_recording(path: Path, image_topic: str | None = None, odometry_topic: str | None = None) -> Recording:
    """A ROS 1 or ROS 2 bag, or a folder in the TUM RGB-D layout (rgb.txt, rgb/, groundtruth.txt, camera.json). Raises
    InputError saying what is wrong with the input and what to do."""
    if path.is_dir() and not (path / METADATA).exists():
        recording = open_folder(path)
    elif not path.exists():
        raise InputError(f"there is no {path}; give a bag or a folder with rgb.txt")
    else:
        recording = open_bag(path, image_topic, odometry_topic)
    epochs = OdometryEpochs()
    return replace(recording, odometry=[epochs.enter(reading) for reading in recording.odometry])

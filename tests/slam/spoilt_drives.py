"""A drive through the SLAM, some of its frames spoilt on the way: what came of it."""

from typing import NamedTuple

import numpy as np

from vsx_ros.config import Config
from vsx_ros.errors import InputError
from vsx_ros.evaluation.trajectory import align
from vsx_ros.robot import OdometryEpochs
from vsx_ros.slam.slam import SequentialSlam
from vsx_ros.slam.state import SlamEvent, TrackingResult, TrackingState

CONFIG = Config().slam
TRACKED = (TrackingState.GOOD, TrackingState.DUBIOUS)
FIRST, LAST = 60, 75


class Run(NamedTuple):
    """Results by frame, None where it was refused; events; worst error [m] of a pose said to be tracked."""

    results: list[TrackingResult | None]
    refused: list[str]
    events: list[SlamEvent]
    worst_m: float

    def states(self, first, last=None):
        return [r.state for r in self.results[first:last] if r is not None]

    def reasons(self, kind):
        return [e.reason for e in self.events if e.kind == kind]


def run(drive, change):
    """Track a drive with ``change(k, frame, odometry)``; the map's frame is that of the first drawn poses."""
    slam = SequentialSlam(drive.camera, drive.T_base_cam, CONFIG, 1)
    results, refused, epochs = [], [], OdometryEpochs()
    for k, (frame, odometry, _) in enumerate(drive.frames):
        frame, odometry = change(k, frame, odometry)
        try:
            results.append(slam.track(frame, odometry and epochs.enter(odometry)))
        except InputError as error:
            results.append(None)
            refused.append(str(error))
    placed = [
        (r.T_world_cam.translation, truth.translation)
        for r, (_, _, truth) in zip(results, drive.frames)
        if r is not None and r.state in TRACKED and r.T_world_cam is not None
    ]
    worst = 0.0
    if placed:
        seen, true = (np.array(positions) for positions in zip(*placed))
        to_truth = align(seen[:30], true[:30], "yaw")
        worst = float(np.linalg.norm(to_truth.apply(seen) - true, axis=1).max())
    return Run(results, refused, slam.drain_events(), worst)


def between(first, last, image=None, odometry=None):
    """A change of image or odometry in the frames first to last - 1."""

    def change(k, frame, reading):
        if first <= k < last and image is not None:
            frame = frame._replace(image=image(frame.image))
        if first <= k < last and odometry is not None:
            reading = odometry(reading)
        return frame, reading

    return change

"""``vsx calibrate shutter``, from a recorded drive with turns."""

import argparse
import sys
from typing import NamedTuple

from msgspec.structs import replace

from vsx_ros.calibration.odometry import Factor
from vsx_ros.calibration.shutter import (
    SeenRows,
    ShutterCalibration,
    concluded,
    next_readout,
    pose_delay,
    readout_change,
    turns,
)
from vsx_ros.cli.recorded_drive import camera_of, conclude, drive_on_known_wheels, known_before
from vsx_ros.config import Config
from vsx_ros.config.maps import ShutterConfig
from vsx_ros.geometry.mount import mounted
from vsx_ros.geometry.se3 import StampedPose
from vsx_ros.io.recording import Recording
from vsx_ros.robot import Odometry, with_speeds
from vsx_ros.runs.process import Progress
from vsx_ros.session import SlamSession
from vsx_ros.slam.preprocessing import camera_twist, middle_s, shutter_of
from vsx_ros.slam.slam import SequentialSlam
from vsx_ros.slam.state import TrackingState

RATE_NS = 20_000_000  # half of the time over which speeds are taken
ROUNDS = 4  # the first without odometry; the map of each other one is made with the result of the one before


class _Seen(NamedTuple):
    """poses: of the middle of each image's exposure, by driver's stamps. rows: of the images in turns."""

    poses: list[StampedPose]
    rows: list[SeenRows]


def calibrate_shutter(args: argparse.Namespace) -> int:
    """Latency and readout of the camera."""
    recording = drive_on_known_wheels(args, "linear_scale", "angular_scale")
    found, exposure_s = shutter_of_drive(recording, known_before(args))
    for name, factor in (("latency_s", found.latency), ("readout_s", found.readout)):
        print(f"{name:10} {factor.value:.4f}: known to {1e3 * factor.sigma:.1f} ms from {factor.measured:.0f} images")
    values = {"readout_s": found.readout.value, "exposure_s": exposure_s, "latency_s": found.latency.value}
    sure = f"latency known to {1e3 * found.latency.sigma:.1f} ms, readout to {1e3 * found.readout.sigma:.1f} ms"
    rounded = {name: round(value, 4) for name, value in values.items()}
    return conclude(args.out, "slam.shutter", rounded, found.verdict, sure)


def shutter_of_drive(recording: Recording, config: Config) -> tuple[ShutterCalibration, float]:
    """The calibration, and the exposure [s] that it assumes. Raises InputError when the drive does not tell."""
    camera, R_base_cam = camera_of(recording), mounted(config.robot.mount).rotation
    known = shutter_of(camera, config.slam.shutter)
    shutter = ShutterConfig(readout_s=known.readout_s, exposure_s=known.exposure_s)
    latency, tried = Factor(0.0, 0.0, 0.0), list[tuple[float, Factor]]()
    for number in range(ROUNDS):
        seen = _seen(replace(config, slam=replace(config.slam, shutter=shutter)), recording, number)
        delay = pose_delay(seen.poses, R_base_cam, recording.odometry)
        latency = delay._replace(value=delay.value + middle_s(camera, shutter))
        if number > 0:
            tried.append((shutter.readout_s, readout_change(seen.rows, camera, shutter.readout_s)))
        readout_s = next_readout(tried) if tried else shutter.readout_s
        shutter = replace(shutter, latency_s=latency.value, readout_s=readout_s)
    return concluded(latency, tried), known.exposure_s


def _seen(config: Config, recording: Recording, number: int) -> _Seen:
    """Track the drive; on a terminal, with a progress line."""
    session = SlamSession(mounted(config.robot.mount), config)
    slam = session.begin(SequentialSlam, camera_of(recording), 0, metric=number > 0)
    middle_ns = round(1e9 * middle_s(camera_of(recording), config.slam.shutter))
    progress, seen = Progress(sys.stderr, plain=False), _Seen([], [])
    for image, frame in enumerate(recording.frames(), start=1):
        exposed = session.exposed(frame)
        odometry = _odometry_at(recording, exposed.stamp_ns + middle_ns)
        result, last = session.track(exposed, odometry), slam.last_track()
        if progress.is_due:
            progress.show(f"round {number + 1} of {ROUNDS}: image {image}/{recording.frame_count}")
        if result.state is not TrackingState.GOOD or last is None:
            continue
        view, track = last
        seen.poses.append(StampedPose(frame.stamp_ns, track.T_world_cam))
        if odometry is not None and turns(odometry):
            found = track.settled
            seen.rows.append(SeenRows(
                uv=track.uv[found], points_cam=track.T_world_cam.inverse() @ view.points[track.rows[found]],
                level=track.level[found], twist=camera_twist(session.T_base_cam, odometry),
            ))  # fmt: skip
    progress.clear()
    return seen


def _odometry_at(recording: Recording, stamp_ns: int) -> Odometry | None:
    """The odometry at an instant, with the speeds around it: a driver's are those of the time before."""
    before, at, after = (recording.odometry_at(stamp_ns + off_ns) for off_ns in (-RATE_NS, 0, RATE_NS))
    if before is None or at is None or after is None or before.odom_epoch != after.odom_epoch:
        return at
    around = with_speeds(after, before)
    return at._replace(v=around.v, omega=around.omega)

"""``vsx replay``: the SLAM over a recording, every frame in order, and what came of it in a run folder."""

from __future__ import annotations

import argparse
import dataclasses
import sys
import time
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from vsx_ros.config import Config
    from vsx_ros.evaluation.summary import Summary
    from vsx_ros.evaluation.trajectory import AlignmentKind
    from vsx_ros.geometry.se3 import SE3
    from vsx_ros.io.recording import Recording
    from vsx_ros.slam.slam import SequentialSlam
    from vsx_ros.slam.state import SlamEvent, TrackingResult

_PROGRESS_EVERY_S = 0.5


def add_parser(subparsers: Any) -> None:
    """Register the command and its options."""
    from vsx_ros.cli.config import add_arguments

    parser = subparsers.add_parser(
        "replay",
        help="run the SLAM over a ROS 1 bag or an image folder",
        description="Tracks every image of a ROS 1 bag or of a folder in the TUM RGB-D layout (rgb.txt, camera.json, "
        "groundtruth.txt), in order and repeatably, and leaves a run folder with the trajectory and a report.",
        epilog="examples: vsx replay drive.bag --map   |   vsx replay rgbd_freiburg1_xyz --calibration fr1.yaml",
    )
    parser.add_argument("input", type=Path, metavar="INPUT", help="a ROS 1 bag (format 2.0) or a folder with rgb.txt")
    parser.add_argument("--calibration", type=Path, metavar="FILE", help="ROS camera_info YAML or camera.json")
    parser.add_argument("--image-topic", metavar="T", help="image topic of the bag (default: the only one)")
    parser.add_argument("--odometry-topic", metavar="T", help="odometry topic of the bag (likewise)")
    parser.add_argument("--map", action="store_true", help="also build the ground map (needs odometry)")
    parser.add_argument("--out", type=Path, metavar="RUN", help="run folder (default runs/<date>_<name>)")
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="seed of the SLAM's random draws (default 0)")
    add_arguments(parser)
    parser.set_defaults(run=run)


@dataclasses.dataclass
class _Replayed:
    """What the frames gave. expected: the camera pose by odometry at each frame, None where unknown."""

    results: list[TrackingResult]
    expected: list[SE3 | None]
    track_ms: list[float]
    events: list[SlamEvent]


def run(args: argparse.Namespace) -> int:
    """Replay, write the run folder, say what happened; 3 when tracking was lost for good, 1 when it never began."""
    from vsx_ros.cli.config import load
    from vsx_ros.cli.exit_codes import DONE, FAILED, LOST
    from vsx_ros.errors import InputError
    from vsx_ros.geometry.camera import mount_pose
    from vsx_ros.io.recording import open_recording
    from vsx_ros.io.run_folder import RunFolder
    from vsx_ros.slam.slam import SequentialSlam
    from vsx_ros.slam.state import TrackingState

    config = load(args.config, args.set)
    recording = _calibrated(open_recording(args.input, args.image_topic, args.odometry_topic), args.calibration)
    if args.map and not recording.odometry:
        raise InputError(
            f"{args.input} has no odometry, and without it neither scale nor floor is known: leave out --map"
        )
    now = datetime.now().strftime("%Y-%m-%d_%H-%M-%S")
    folder = RunFolder.create(args.out or Path("runs") / f"{now}_{args.input.stem}")
    mount = config.robot.mount
    T_base_cam = mount_pose(mount.forward_m, mount.left_m, mount.height_m, mount.pitch_down_rad, mount.yaw_left_rad)
    assert recording.camera is not None
    slam = SequentialSlam(recording.camera, T_base_cam if recording.odometry else None, config.slam, args.seed)
    replayed = _track_all(slam, recording, T_base_cam)
    summary = _summary(slam, recording, replayed).with_values(seed=args.seed)
    folder.write_config(config, ["vsx", *sys.argv[1:]], seed=args.seed, input=str(args.input.resolve()))
    _write(folder, slam, recording, replayed)
    if args.map:
        _write_map(folder, slam, config, _estimate(replayed.results), T_base_cam)
    folder.write_summary(summary.as_dict())
    _tell(folder, summary)
    if not replayed.results or replayed.results[-1].state is TrackingState.NOT_INITIALISED:
        return FAILED
    return LOST if replayed.results[-1].state is TrackingState.LOST else DONE


def _calibrated(recording: Recording, file: Path | None) -> Recording:
    from vsx_ros.errors import CalibrationError
    from vsx_ros.io.calibration_file import read_calibration

    if file is not None:
        return dataclasses.replace(recording, camera=read_calibration(file))
    if recording.camera is None:
        raise CalibrationError(
            f"{recording.source} brings no camera calibration; give one with --calibration FILE "
            "(ROS camera_info YAML or camera.json)"
        )
    return recording


def _track_all(slam: SequentialSlam, recording: Recording, T_base_cam: SE3) -> _Replayed:
    from vsx_ros.geometry.se3 import SE3

    replayed = _Replayed([], [], [], [])
    for frame in _with_progress(recording, replayed):
        odometry = recording.odometry_at(frame.stamp_ns)
        began = time.perf_counter()
        result = slam.track(frame, odometry)
        replayed.track_ms.append((time.perf_counter() - began) * 1e3)
        replayed.results.append(result)
        replayed.expected.append(SE3.from_se2(odometry.T_odom_base) @ T_base_cam if odometry else None)
        replayed.events += slam.drain_events()
    return replayed


def _with_progress(recording: Recording, replayed: _Replayed) -> Iterator[Any]:
    """The frames; on a terminal, one line that tells how far it is."""
    shown = 0.0
    for frame in recording.frames():
        yield frame
        if sys.stderr.isatty() and time.perf_counter() - shown > _PROGRESS_EVERY_S:
            shown = time.perf_counter()
            last = replayed.results[-1]
            line = f"frame {len(replayed.results)}/{recording.frame_count}  {last.state.value}"
            print(f"\r{line}  {last.found}/{last.searched} points \x1b[K", end="", file=sys.stderr, flush=True)
    if shown:
        print("\r\x1b[K", end="", file=sys.stderr, flush=True)


def _estimate(results: list[TrackingResult]) -> list[Any]:
    from vsx_ros.geometry.stamped import StampedPose
    from vsx_ros.slam.state import TrackingState

    tracked = (TrackingState.GOOD, TrackingState.DUBIOUS)
    return [StampedPose(r.stamp_ns, r.T_world_cam) for r in results if r.T_world_cam is not None and r.state in tracked]


def _summary(slam: SequentialSlam, recording: Recording, replayed: _Replayed) -> Summary:
    from vsx_ros.evaluation.summary import tracking_summary, with_accuracy
    from vsx_ros.evaluation.tracking import find_breaks

    results = replayed.results
    kind: AlignmentKind | None = "yaw" if recording.odometry else None
    summary = tracking_summary(slam.statistics(), replayed.track_ms)
    summary = with_accuracy(summary, _estimate(results), recording.ground_truth, kind)
    return summary.with_values(
        breaks=len(find_breaks(results, replayed.expected)),
        duration_s=(results[-1].stamp_ns - results[0].stamp_ns) * 1e-9 if results else 0.0,
        stop_reason=_stop_reason(results),
        world=recording.source.name,
    )


def _stop_reason(results: list[TrackingResult]) -> str:
    """How the recording ended, in words."""
    from vsx_ros.slam.state import TrackingState

    if not results:
        return "the recording holds no image that could be used"
    last = results[-1]
    if last.state is TrackingState.NOT_INITIALISED:
        return f"the map was never started: {last.reason}"
    if last.state is TrackingState.LOST:
        tracked = max(i for i, r in enumerate(results) if r.state in (TrackingState.GOOD, TrackingState.DUBIOUS))
        return f"lost for good from frame {tracked + 1} of {len(results)}: {results[tracked + 1].reason}"
    return "the recording was tracked to its end"


def _write(folder: Any, slam: SequentialSlam, recording: Recording, replayed: _Replayed) -> None:
    """Poses, points, events and frames."""
    from vsx_ros.geometry.se3 import SE3
    from vsx_ros.geometry.stamped import StampedPose
    from vsx_ros.io.run_folder import FrameRecord, RunEvent

    estimate, snapshot = _estimate(replayed.results), slam.snapshot()
    folder.write_poses("trajectory", estimate)
    if recording.odometry:
        folder.write_poses(
            "odometry", [StampedPose(o.stamp_ns, SE3.from_se2(o.T_odom_base)) for o in recording.odometry]
        )
    if recording.ground_truth:
        folder.write_poses("groundtruth", recording.ground_truth)
    if len(snapshot.points_world):
        folder.write_points(snapshot.points_world)
    folder.write_events(RunEvent(e.stamp_ns, "slam", e.kind, e.reason) for e in replayed.events)
    folder.write_frames(
        FrameRecord(r.stamp_ns, r.state.value, r.searched, r.found, r.keyframe_added, ms)
        for r, ms in zip(replayed.results, replayed.track_ms, strict=True)
    )


def _write_map(folder: Any, slam: SequentialSlam, config: Config, estimate: list[Any], T_base_cam: SE3) -> None:
    from vsx_ros.geometry.se2 import SE2
    from vsx_ros.occupancy.ground_map import GroundMap

    snapshot = slam.snapshot()
    trail = [SE2.from_se3(pose.T @ T_base_cam.inverse()) for pose in estimate]
    observed = snapshot.points_world, snapshot.obs_keyframe, snapshot.obs_point
    folder.write_map(GroundMap(config.ground_map, config.robot).build(snapshot.T_world_cams, *observed, trail=trail))


def _tell(folder: Any, summary: Summary) -> None:
    from vsx_ros.cli.report import one_line_facts, write_report

    report = write_report(folder)
    print(summary.stop_reason)
    for line in one_line_facts(summary.as_dict()):
        print(f"  {line}")
    print(f"  report: {report}")

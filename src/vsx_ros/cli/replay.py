"""``vsx replay``: run the SLAM over a bag or an image folder

Tracks every image of a ROS 1 or ROS 2 bag or of a folder in the TUM RGB-D layout (rgb.txt, camera.json,
groundtruth.txt), in order and repeatably, and leaves a run folder with the trajectory and a report. Ctrl-C ends it with
what there is.

examples: vsx replay drive.bag --map | vsx replay rgbd_freiburg1_xyz --calibration fr1.yaml | vsx replay drive.bag --ros
--view
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from vsx_ros.cli.compiled import compile_kernels
from vsx_ros.cli.config import add_parameters
from vsx_ros.errors import ConfigError
from vsx_ros.runs.interruptible import interruptible

if TYPE_CHECKING:
    from vsx_ros.config import Config
    from vsx_ros.evaluation.summary import Summary
    from vsx_ros.evaluation.trajectory import AlignmentKind
    from vsx_ros.io.recording import Recording
    from vsx_ros.runs.record import RunRecord
    from vsx_ros.runs.session import RunWriter
    from vsx_ros.slam.slam import SequentialSlam
    from vsx_ros.slam.state import TrackingResult

_PROGRESS_EVERY_S = 0.5
_MAX_RATE = 100.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Its options."""
    help_ = "a bag (ROS 1: .bag; ROS 2: folder, .db3 or .mcap) or a folder with rgb.txt"
    add = parser.add_argument
    add("input", type=Path, metavar="INPUT", help=help_)
    add("--calibration", type=Path, metavar="FILE", help="ROS camera_info YAML or camera.json")
    add("--image-topic", metavar="T", help="image topic of the bag (default: the only one)")
    add("--odometry-topic", metavar="T", help="odometry or base poses (default: the only Odometry)")
    add("--map", action="store_true", help="also build the ground map (needs odometry)")
    add("--load-map", type=Path, metavar="FILE", help="go on in a SLAM map that --save-map wrote")
    add("--save-map", type=Path, metavar="FILE", help="at the end, save the SLAM map to go on in it")
    add("--out", type=Path, metavar="RUN", help="run folder (default runs/<date>_<name>)")
    add("--seed", type=int, default=0, metavar="N", help="seed of the SLAM's random draws (default 0)")
    add("--ros", action="store_true", help="feed the ROS nodes instead, with /clock and use_sim_time")
    add("--rate", type=float, metavar="R", help="with --ros: speed; 1 (default) real time, 0 with no image left out")
    add("--view", action="store_true", help="with --ros: serve the live view")
    add_parameters(parser)


def run(args: argparse.Namespace) -> int:
    """Replay, write the run folder, say what happened; 3 when tracking was lost for good, 1 when it never began."""
    _refuse_pace(args)
    compile_kernels()
    if args.ros:
        from vsx_ros.ros.replay import replay

        return replay(args)
    from vsx_ros.cli.ground import ground_grid
    from vsx_ros.geometry.camera import mounted
    from vsx_ros.runs.exit_codes import STOPPED, ended_well
    from vsx_ros.runs.parameters import load
    from vsx_ros.runs.replay import exit_code, new_folder, opened
    from vsx_ros.runs.report import tell_the_end, write_report
    from vsx_ros.runs.session import RunWriter
    from vsx_ros.slam.state import TrackingState

    config = load(args.config, args.set)
    recording = opened(args)
    T_base_cam = mounted(config.robot.mount)
    slam = _slam(recording, config, args)
    folder = new_folder(args, config)
    keeper = RunWriter(T_base_cam)
    record, stopped = keeper.record, _track_all(slam, recording, keeper)
    continued = str(args.load_map.resolve()) if args.load_map else None
    ending = record.results[-1].state if record.results else TrackingState.NOT_INITIALISED
    code = STOPPED if stopped else exit_code(ending)
    facts = {"seed": args.seed, "continued_map": continued, "ended_well": ended_well(code)}
    if stopped:
        facts["stop_reason"] = f"stopped by the operator after {len(record.results)} of {recording.frame_count} frames"
    summary = _summary(slam, recording, record).with_values(**facts)
    poses = (pose.T for pose in record.estimate())
    grid = ground_grid(slam.snapshot(), poses, T_base_cam, config) if args.map else None
    more: list[Callable[[], object]] = [lambda: _save_slam_map(slam, args.save_map), lambda: write_report(folder)]
    if recording.ground_truth:
        more.insert(0, lambda: folder.write_poses("groundtruth", recording.ground_truth))
    failure = keeper.finish(folder, slam, summary, None, grid, *more)
    return tell_the_end(folder, summary.as_dict(), code, failure)


def _refuse_pace(args: argparse.Namespace) -> None:
    """Raises ConfigError for a speed or a view without the nodes, and for an impossible speed."""
    if not args.ros and (args.rate is not None or args.view):
        raise ConfigError("--rate and --view go with --ros; without it every image is tracked, in order, by no node")
    if args.rate is not None and not 0.0 <= args.rate <= _MAX_RATE:
        raise ConfigError(f"--rate {args.rate}: give a number from 0 (no image left out) to {_MAX_RATE:g}")


def _slam(recording: Recording, config: Config, args: argparse.Namespace) -> SequentialSlam:
    """A new map or the one to go on in; what cannot be read or written at the end is said now."""
    from vsx_ros.errors import MapFileError
    from vsx_ros.geometry.camera import mounted
    from vsx_ros.io.slam_map_file import load_slam_map
    from vsx_ros.session import SlamSession
    from vsx_ros.slam.slam import SequentialSlam

    if args.save_map and not args.save_map.resolve().parent.is_dir():
        raise MapFileError(f"map {args.save_map} cannot be written: its folder does not exist; choose another folder")
    loaded = load_slam_map(args.load_map) if args.load_map else None
    assert recording.camera is not None
    session = SlamSession(mounted(config.robot.mount), config, loaded)
    return session.begin(SequentialSlam, recording.camera, args.seed, metric=bool(recording.odometry))


def _track_all(slam: SequentialSlam, recording: Recording, keeper: RunWriter) -> bool:
    """Every frame, with the odometry of its instant; on a terminal, one line tells how far it is. Whether Ctrl-C came
    first."""
    for reading in recording.odometry:
        keeper.record.add_odometry(reading)
    shown = 0.0
    with interruptible() as stopped:
        for number, frame in enumerate(recording.frames(), start=1):
            odometry = recording.odometry_at(frame.stamp_ns)
            began = time.perf_counter()
            result = slam.track(frame, odometry)
            track_s = time.perf_counter() - began
            keeper.frame(result, odometry, track_s, slam.statistics().u2_frames, slam.drain_events())
            if sys.stderr.isatty() and began - shown > _PROGRESS_EVERY_S:
                shown = began
                found = f"{result.found}/{result.searched} points"
                line = f"frame {number}/{recording.frame_count}  {result.state.word}  {found}"
                print(f"\r{line}\x1b[K", end="", file=sys.stderr, flush=True)
            if stopped():
                break
    if shown:
        print("\r\x1b[K", end="", file=sys.stderr, flush=True)
    return stopped()


def _summary(slam: SequentialSlam, recording: Recording, record: RunRecord) -> Summary:
    from vsx_ros.evaluation.summary import with_accuracy

    results = record.results
    kind: AlignmentKind | None = "yaw" if recording.odometry else None
    summary = with_accuracy(record.summary(slam.statistics()), record.estimate(), recording.ground_truth, kind)
    if kind is None:
        summary = summary.with_values(u2_metres=None)
    return summary.with_values(
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
        tracked = max((i for i, r in enumerate(results) if r.state.tracked), default=-1)
        return f"lost for good from frame {tracked + 2} of {len(results)}: {results[tracked + 1].reason}"
    return "the recording was tracked to its end"


def _save_slam_map(slam: SequentialSlam, path: Path | None) -> None:
    from vsx_ros.io.slam_map_file import save_slam_map

    if path is None:
        return
    slam_map = slam.slam_map()
    if slam_map is None:
        print(f"vsx: {path} is not written: there is no map, it was never started", file=sys.stderr)
    else:
        save_slam_map(slam_map, path)

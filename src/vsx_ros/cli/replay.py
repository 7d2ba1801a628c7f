"""``vsx replay``: maps from recordings."""

import argparse
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from msgspec.structs import replace as with_values

from vsx_ros.cli.compiled import SLAM, compile_kernels
from vsx_ros.cli.option_values import refuse
from vsx_ros.cli.recorded_drive import with_factors
from vsx_ros.config import Config
from vsx_ros.dense.finished_map import FinishedMap
from vsx_ros.errors import ConfigError, InputError, MapFileError
from vsx_ros.evaluation.summary import Summary, with_accuracy
from vsx_ros.evaluation.trajectory import AlignmentKind
from vsx_ros.geometry.mount import mounted
from vsx_ros.io.left_out import until_damage
from vsx_ros.io.map_export import write_planes, write_ply
from vsx_ros.io.recording import NO_ODOMETRY, Recording
from vsx_ros.io.slam_map_file import load_slam_map
from vsx_ros.runs.folder import RunFolder
from vsx_ros.runs.journal import FrameLine, RunEvent
from vsx_ros.runs.parameters import load, named
from vsx_ros.runs.process import STOPPED, Progress, ended_well, interruptible
from vsx_ros.runs.record import RunRecord
from vsx_ros.runs.report import map_given_up, replay_end, tell_the_end, write_report
from vsx_ros.runs.saved_map import save_continued
from vsx_ros.runs.self_calibration import write_self_calibration
from vsx_ros.runs.session import RunWriter
from vsx_ros.runs.start import opened_recording, replay_folder
from vsx_ros.session import SlamSession
from vsx_ros.slam.slam import SequentialSlam
from vsx_ros.slam.snapshot import SlamMap, snapshot
from vsx_ros.slam.state import TrackingState

_MAX_RATE = 100.0  # images a second, more than these cameras give


def replay(args: argparse.Namespace) -> int:
    """Replay, write the run folder, print the result; 3 when track or map was lost for good, 1 without any map."""
    _refuse_pace(args)
    if (args.input / "rgb.txt").exists():
        topics = ["image_topic"] + ["odometry_topic"] * (args.odometry_topic != NO_ODOMETRY)
        refuse(args, f"{args.input} is a folder of images, without topics", *topics)
    config, recording = _on_its_wheels(load(args.config, args.set), opened_recording(args), args)
    compile_kernels(*SLAM, *(["surfaces"] if args.map and not args.ros else []))
    if args.ros:
        from vsx_ros.ros.replay import replay

        return replay(args, config, recording)
    T_base_cam = mounted(config.robot.mount)
    session, slam = _slam(recording, config, args)
    with replay_folder(args, config) as folder:
        keeper = RunWriter(T_base_cam, folder, config=config.runs, resumable=False)
        record, (stopped, broken) = keeper.record, _track_all(session, slam, recording, keeper)
        continued = str(args.load_map.resolve()) if args.load_map else None
        usual = _stop_reason(record.frames, record.events)
        code, reason = replay_end([frame.state for frame in record.frames], usual, broken)
        if stopped:
            done = f"{len(record.frames)} of {recording.frame_count} frames"
            code, reason = STOPPED, f"stopped by the operator after {done}"
        facts = {"seed": args.seed, "continued_map": continued, "ended_well": ended_well(code), "stop_reason": reason}
        finished = finished_map(slam.slam_map(), config, args.seed) if args.map else None
        grid = finished.grid([pose.T for pose in record.estimate()]) if finished is not None else None
        note = finished.note or None if finished is not None else None
        summary = _summary(slam, recording, record).with_values(**facts, map_note=note)
        more: list[Callable[[], object]] = [
            lambda: _save_slam_map(slam, args.load_map, args.save_map),
            lambda: write_report(folder),
        ]
        more.insert(0, lambda: write_self_calibration(folder.path, session.calibration, config.robot.odometry))
        if finished is not None:
            more[:0] = _surface_files(folder, finished)
        if recording.ground_truth:
            more.insert(0, lambda: folder.write_poses("groundtruth", recording.ground_truth))
        failure = keeper.finish(folder, slam, summary, None, grid, *more)
        return tell_the_end(folder, summary.as_dict(), code, failure)


def _on_its_wheels(config: Config, recording: Recording, args: argparse.Namespace) -> tuple[Config, Recording]:
    """Both with the same factors of the wheels: those that --config and --set name, else those of the recording. One
    that does not tell its factors stays as it is."""
    recording = with_factors(recording, named(args.config, args.set))
    if len(recording.factors) == 1:
        config = with_values(config, robot=with_values(config.robot, odometry=recording.factors[0]))
    return config, recording


def _refuse_pace(args: argparse.Namespace) -> None:
    """Raises ConfigError for a speed or a view without --ros, and for an impossible speed."""
    if not args.ros and (args.rate is not None or args.view):
        raise ConfigError("--rate and --view go with --ros; without it every image is tracked, in order, by no node")
    if args.rate is not None and not 0.0 <= args.rate <= _MAX_RATE:
        raise ConfigError(f"--rate {args.rate}: give a number from 0 (no image left out) to {_MAX_RATE:g}")


def _slam(recording: Recording, config: Config, args: argparse.Namespace) -> tuple[SlamSession, SequentialSlam]:
    """The session and SLAM, in a new or loaded map. Raises errors of both map files now, not at the end."""
    if args.save_map and not args.save_map.resolve().parent.is_dir():
        raise MapFileError(f"map {args.save_map} cannot be written: its folder does not exist; choose another folder")
    loaded = load_slam_map(args.load_map) if args.load_map else None
    assert recording.camera is not None
    session = SlamSession(mounted(config.robot.mount), config, loaded)
    return session, session.begin(SequentialSlam, recording.camera, args.seed, metric=bool(recording.odometry))


def _track_all(session: SlamSession, slam: SequentialSlam, recording: Recording, keeper: RunWriter) -> tuple[bool, str]:
    """Track every frame with its odometry; on a terminal, show a progress line. Returns whether Ctrl-C was pressed, and
    why the recording could not be read to its end, or empty. Raises InputError if no image of it can be used."""
    progress, broken = Progress(sys.stderr, plain=False), list[str]()
    with interruptible() as stopped:
        for number, frame in enumerate(map(session.exposed, until_damage(recording.frames(), broken)), start=1):
            odometry = recording.odometry_at(frame.stamp_ns)
            began = time.perf_counter()
            result = session.track(frame, odometry)
            track_s = time.perf_counter() - began
            keeper.frame(result, odometry, track_s, slam.statistics().u2_frames, slam.drain_events())
            if keeper.see(frame, None):
                keeper.write_seen()
            if progress.is_due:
                found = f"{result.found}/{result.searched} points"
                progress.show(f"frame {number}/{recording.frame_count}  {result.state.word}  {found}")
            if stopped():
                break
    progress.clear()
    if broken and not keeper.record.frames:
        raise InputError(broken[0])
    return stopped(), "".join(broken)


def _summary(slam: SequentialSlam, recording: Recording, record: RunRecord) -> Summary:
    frames = record.frames
    kind: AlignmentKind | None = "yaw" if recording.odometry else None
    poses = record.estimate(), record.final(slam.slam_map())
    summary = with_accuracy(record.summary(slam.statistics()), *poses, recording.ground_truth, kind)
    if kind is None:
        summary = summary.with_values(u2_metres=None)
    return summary.with_values(
        duration_s=(frames[-1].stamp_ns - frames[0].stamp_ns) * 1e-9 if frames else 0.0, world=recording.source.name
    )


def _stop_reason(frames: Sequence[FrameLine], events: Sequence[RunEvent]) -> str:
    """How the recording ended, in words."""
    if not frames:
        return "the recording holds no image that could be used"
    last = frames[-1]
    if last.state is TrackingState.NOT_INITIALISED:
        given_up = map_given_up([(frame.stamp_ns, frame.state) for frame in frames], events)
        return given_up or f"the map was never started: {last.reason}"
    if last.state is TrackingState.LOST:
        tracked = max((i for i, r in enumerate(frames) if r.state.tracked), default=-1)
        return f"lost for good from frame {tracked + 2} of {len(frames)}: {frames[tracked + 1].reason}"
    return "the recording was tracked to its end"


def _save_slam_map(slam: SequentialSlam, before: Path | None, path: Path | None) -> None:
    if path is None:
        return
    slam_map = slam.slam_map()
    if slam_map is None:
        print(f"vsx: {path} is not written: there is no map", file=sys.stderr)
    else:
        save_continued(slam_map, before, path)


def finished_map(slam_map: SlamMap | None, config: Config, seed: int = 0) -> FinishedMap | None:
    """Surfaces and ground of a SLAM map; None without a map."""
    if slam_map is None:
        return None
    return FinishedMap(snapshot(slam_map.view), slam_map.camera, slam_map.T_base_cam, config, seed)


def _surface_files(folder: RunFolder, finished: FinishedMap) -> list[Callable[[], object]]:
    """Functions that write planes.json and dense.ply."""
    cloud = finished.cloud
    writes: list[Callable[[], object]] = [lambda: write_planes(folder.path / "planes.json", finished.facts())]
    if cloud is not None:
        writes.append(lambda: write_ply(folder.path / "dense.ply", *cloud))
    return writes

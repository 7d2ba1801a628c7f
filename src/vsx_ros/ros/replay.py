"""``vsx replay --ros``: plays a recording to the node vslam in place of a robot, in the recording's time."""

import argparse
import time
from collections.abc import Callable, Sequence
from typing import NamedTuple

import rosgraph
import rospy

from vsx_ros.config import Config
from vsx_ros.errors import ConfigError
from vsx_ros.evaluation.summary import with_accuracy
from vsx_ros.evaluation.trajectory import AlignmentKind
from vsx_ros.geometry.mount import mounted
from vsx_ros.geometry.se3 import SE3
from vsx_ros.io.recording import Recording
from vsx_ros.ros import logs, topics
from vsx_ros.ros.launch import LaunchNode, vslam
from vsx_ros.ros.left_behind import living
from vsx_ros.ros.live_run import READY_WAIT_S, LiveRun
from vsx_ros.ros.monitor import Monitor
from vsx_ros.ros.player import Player
from vsx_ros.runs.folder import RunFolder
from vsx_ros.runs.process import INTERNAL, STOPPED, ended_well
from vsx_ros.runs.report import map_given_up, replay_end, tell_the_end, write_report
from vsx_ros.runs.session import results_of_slam
from vsx_ros.runs.start import replay_folder
from vsx_ros.slam.state import TrackingState


class _Ending(NamedTuple):
    """interrupted: by the operator. dead: the node that died, or empty. broken: why the recording could not be read to
    its end, or empty."""

    interrupted: bool
    dead: str
    broken: str


def replay(args: argparse.Namespace, config: Config, recording: Recording) -> int:
    """Play everything, write the run folder, print the result; the exit code. args: options of ``vsx replay``."""
    logs.quiet_failures()
    _refuse_company()
    with replay_folder(args, config) as folder:
        slam = _slam(args, recording, folder)
        with LiveRun([slam], config, (slam.name,), folder.path / "log", view=args.view, replayed=True) as live:
            monitor, player = Monitor(emulated=False), Player(recording)
            _play(live, monitor, player, 1.0 if args.rate is None else args.rate)
            ending = _Ending(live.interrupted, live.dead, player.broken)
        return _gather(folder, recording, monitor, args, ending, mounted(config.robot.mount))


def _refuse_company() -> None:
    """Raises ConfigError if a robot or another replay already publishes at the master; one that was killed does not
    count."""
    if not rosgraph.is_master_online():
        return
    published = dict(rosgraph.Master("/vsx_replay").getSystemState()[0])
    for topic in (topics.CLOCK, topics.IMAGE, topics.ODOM):
        name = rospy.resolve_name(topic)
        if there := living(published.get(name, [])):
            raise ConfigError(
                f"{there[0]} already publishes {name} at {rosgraph.get_master_uri()}; end it, or give the "
                "replay a master of its own, e.g. ROS_MASTER_URI=http://localhost:11312"
            )


def _slam(args: argparse.Namespace, recording: Recording, folder: RunFolder) -> LaunchNode:
    files = {name: getattr(args, name) for name in ("load_map", "save_map")}
    given = {name: str(file.resolve()) for name, file in files.items() if file is not None}
    return vslam(args.seed, str(folder.path.resolve()), use_odometry=bool(recording.odometry), **given)


def _play(live: LiveRun, monitor: Monitor, player: Player, rate: float) -> None:
    """Wait for the SLAM, then play. Raises ConfigError if the SLAM does not get ready."""
    deadline_s = time.monotonic() + READY_WAIT_S

    def goes_on() -> bool:
        if live.progress.is_due and player.sent:
            stats = monitor.stats
            found = f"{stats.get('tracked', 0):.0f}/{stats.get('attempted', 0):.0f} points"
            dropped = f"{stats.get('dropped', 0):.0f} images skipped"
            live.progress.show(f"image {player.sent}/{player.count}  {monitor.slam_state}  {found}  {dropped}")
        return not live.interrupted and not live.dead

    while goes_on() and not player.ready:
        if time.monotonic() > deadline_s:
            raise ConfigError(f"vslam was not ready within {READY_WAIT_S:.0f} s; see the run's log folder")
        time.sleep(0.05)
    player.play(rate, goes_on)


def _gather(
    folder: RunFolder, recording: Recording, monitor: Monitor, args: argparse.Namespace, ending: _Ending,
    T_base_cam: SE3,
) -> int:  # fmt: skip
    """Complete and report what vslam wrote."""
    known, missing = results_of_slam(folder, T_base_cam)
    looked_at = folder.read_frames()
    states = [(frame.stamp_ns, TrackingState(frame.state)) for frame in looked_at]
    kind: AlignmentKind | None = "yaw" if recording.odometry else None
    summary = with_accuracy(known, *folder.read_trajectories(), recording.ground_truth, kind)
    code, reason = replay_end([state for _, state in states], _stop_reason(folder, states), ending.broken)
    if ending.dead:
        code, reason = INTERNAL, f"node {ending.dead} died"
    if ending.interrupted:
        code, reason = STOPPED, f"stopped by the operator after {len(looked_at)} of {recording.frame_count} frames"
    summary = summary.with_values(
        duration_s=(looked_at[-1].stamp_ns - looked_at[0].stamp_ns) * 1e-9 if looked_at else 0.0,
        stop_reason=reason,
        ended_well=ended_well(code),
        world=recording.source.name,
        seed=args.seed,
        continued_map=str(args.load_map.resolve()) if args.load_map else None,
        u2_metres=summary.u2_metres if kind else None,
    )
    writes: list[Callable[[], object]] = [lambda: folder.write_summary(summary.as_dict())]
    if recording.ground_truth:
        writes.append(lambda: folder.write_poses("groundtruth", recording.ground_truth))
    if args.map and (grid := monitor.grid) is not None:
        writes.append(lambda: folder.write_map(grid))
    kept = folder.write_what_fits(*writes, lambda: write_report(folder)) or missing
    return tell_the_end(folder, summary.as_dict(), code, kept)


def _stop_reason(folder: RunFolder, states: Sequence[tuple[int, TrackingState]]) -> str:
    """How the recording ended, in words."""
    events = [event for event in folder.read_events() if event.source == "slam"]
    last = events[-1].reason if events else "the SLAM saw no image that it could use"
    ending = states[-1][1] if states else TrackingState.NOT_INITIALISED
    if ending is TrackingState.NOT_INITIALISED:
        return map_given_up(states, events) or f"the map was never started: {last}"
    if ending is TrackingState.LOST:
        return f"lost for good: {last}"
    return "the recording was played to its end"

"""The live run behind ``vsx explore``: all nodes, an emulated robot if a world is given, a run folder at the end."""

import argparse
import os
import signal
import sys
import tempfile
import time
from collections.abc import Iterable
from pathlib import Path

from vsx_ros.errors import ConfigError, VsxError
from vsx_ros.exploration.decision import MissionState
from vsx_ros.geometry.se2 import SE2
from vsx_ros.ros import headers, launch, logs
from vsx_ros.ros.browser import open_browser
from vsx_ros.ros.dashboard.ending import Ended, show_end
from vsx_ros.ros.fork_server import ForkServer
from vsx_ros.ros.launch import LaunchNode
from vsx_ros.ros.live_run import MASTER, READY_WAIT_S, LiveRun, refuse_second_robot
from vsx_ros.ros.monitor import Monitor, MonitorJournal
from vsx_ros.ros.nodes.dashboard import TOKEN
from vsx_ros.ros.run_results import About, Ending, write_results
from vsx_ros.runs.folder import RunFolder
from vsx_ros.runs.judge import MapJudge
from vsx_ros.runs.process import DONE, FAILED, HARDWARE, INTERNAL, STOPPED, SignalFlag
from vsx_ros.runs.progress_line import progress_line
from vsx_ros.runs.report import EXIT_CODES
from vsx_ros.runs.start import DEFAULTS, begin
from vsx_ros.runs.world import save_world
from vsx_ros.sim.emulated_world import EmulatedWorld
from vsx_ros.sim.world import Start
from vsx_ros.slam.state import TrackingState

_COVERAGE_PERIOD_S = 2.0  # between comparisons with the truth
_VITAL = "mobile_base", "vslam", "explore", "emulator"
_TICK_S = 0.1  # so that Ctrl-C takes effect at once
_TRACKED = [state.word for state in TrackingState if state.tracked]
_CODES = {outcome.name: code for outcome, code in EXIT_CODES.items()}


class Coverage:
    """Share of the emulated world that the map covers, updated now and then; None on a real robot. until: the correctly
    known share at which the run may end."""

    def __init__(self, judge: MapJudge | None, until: float | None = None) -> None:
        self._judge, self.until = judge, until
        self._share: float | None = None
        self._right = 0.0
        self._judged_s = -1e9

    def is_enough(self, monitor: Monitor) -> bool:
        """Whether the run may end: enough is known, and the camera is tracked."""
        if self.until is None:
            return False
        self.of(monitor)
        return self._right >= self.until and monitor.slam_state in _TRACKED

    def of(self, monitor: Monitor) -> float | None:
        """The share, at most a few seconds old."""
        due = time.monotonic() - self._judged_s > _COVERAGE_PERIOD_S
        if self._judge is not None and monitor.grid is not None and due:
            self._judged_s = time.monotonic()
            quality = self._judge.quality(monitor.grid)
            self._share, self._right = quality.coverage, quality.coverage_correct or 0.0
        return self._share


def explore(args: argparse.Namespace, forks: ForkServer) -> int:
    """One live run, or the rest of an interrupted one; returns the exit code. If a viewer wants more of it, this
    process becomes the next session: rospy cannot begin again where it has ended. args: the options of ``vsx explore``.
    forks: starts the nodes.
    """
    logs.quiet_failures()
    folder, code, go_on = _explore(args, forks)
    if go_on:
        sys.stdout.flush()
        sys.stderr.flush()
        program = sys.orig_argv[1 : len(sys.orig_argv) - len(sys.argv[1:])]
        os.execv(sys.executable, [sys.executable, *program, *go_on_words(folder)])
    return code


def go_on_words(folder: RunFolder) -> list[str]:
    """The command line of ``vsx`` that goes on with a run that has ended, for as long again as it was to last, in the
    page that is open."""
    facts = folder.read_config()[1]
    given_s = facts.get("time")
    lasted_s = float(folder.read_summary().get("duration_s") or 0.0)
    limit = [] if given_s is None else ["--time", f"{lasted_s + float(given_s):g}"]
    until = [] if facts.get("until") is None else ["--until", "1"]  # what it was to end with is known already
    return ["explore", "--resume", str(folder.path.resolve()), "--view", "--headless", *limit, *until]


def _explore(args: argparse.Namespace, forks: ForkServer) -> tuple[RunFolder, int, bool]:
    """The folder of one run, its exit code, and whether it is to go on."""
    refuse_second_robot(_names_so_far(args))
    with begin(args) as (folder, config, world):
        # The position of a loaded map in the world is unknown.
        judge = MapJudge(world, config) if world is not None and not args.load_map else None
        journal = MonitorJournal(folder, config.robot.mount)
        lasted_s = journal.clock.elapsed_s
        if args.time is not None and lasted_s >= args.time:
            raise ConfigError(f"{folder.path} has lasted {lasted_s:.0f} s; to go on give more with --time")
        with tempfile.TemporaryDirectory(prefix="vsx-", ignore_cleanup_errors=True) as devices:
            nodes = _nodes(args, folder, world, Path(devices), journal.T_world_base)
            log = folder.path / "log"
            with LiveRun(nodes, config, _VITAL, log, view=args.view, replayed=False, forks=forks) as live:
                if live.url and not args.headless:
                    open_browser(live.url)
                monitor = Monitor(emulated=world is not None)
                ending = _watch(live, monitor, journal, Coverage(judge, args.until), args.time)
                monitor.is_ending = True
                live.progress.say(f"stopping: {ending.reason}")
        about = About(args.world, args.seed, args.planner, args.load_map)
        code = write_results(folder, config, monitor, journal, judge, ending, about)
    return folder, code, bool(live.url) and _shown(live, folder)


def _names_so_far(args: argparse.Namespace) -> list[str]:
    """The nodes of the run that are known before its folder is. The camera of a run to resume may have no node; the
    live run asks for all names once more."""
    camera = args.camera or ("ros" if args.resume else str(DEFAULTS["camera"]))
    return [node.name for node in (*launch.bringup(camera=camera), *launch.exploration())]


def _shown(live: LiveRun, folder: RunFolder) -> bool:
    """Show the end to those who look; whether somebody wants to go on."""
    stop = SignalFlag(signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    try:
        summary = folder.read_summary()
        ended = Ended(folder, summary, ended_well=bool(summary.get("ended_well")))
        if not live.interrupted:
            sys.stderr.write("the live view shows the end as long as its page is open; Ctrl-C ends it\n")
        return show_end(ended, os.environ[TOKEN], live.port, lambda: stop.came, stay=not live.interrupted)
    except VsxError as error:  # the run is over and its exit code stands
        sys.stderr.write(f"vsx: the live view cannot show the end: {error}\n")
        return False


def _nodes(
    args: argparse.Namespace, folder: RunFolder, world: EmulatedWorld | None, devices: Path, T_world_base: SE2 | None
) -> list[LaunchNode]:
    """T_world_base: where an emulated robot stood when the run was interrupted."""
    above = launch.exploration(
        args.planner, args.seed, str(folder.path.resolve()), args.load_map or "", args.room or "", args.zones or ""
    )
    if world is None:
        return [*launch.bringup(args.base, args.port, args.camera), *above]
    path = folder.path.resolve() / "world.yaml"
    if T_world_base is not None:
        path = path.with_name("world_resumed.yaml")
        start = Start(x=T_world_base.x, y=T_world_base.y, theta_rad=T_world_base.theta)
        save_world(world.starting_at(start), path)
    wires = str(devices), args.base, args.rate, args.dock or "", args.battery_pace or 1.0
    return [*launch.emulation(str(path), args.seed, *wires), *above]


def _watch(
    live: LiveRun, monitor: Monitor, journal: MonitorJournal, coverage: Coverage, limit_s: float | None
) -> Ending:
    """Wait until the mission, the time limit, the operator or a failure ends the run. Time counts from the mission's
    first status, and continues that of interrupted sessions."""
    started_s = time.monotonic()
    began_s: float | None = None
    trouble: dict[str, str] = {}
    while True:
        time.sleep(_TICK_S)
        now_s = time.monotonic()
        if began_s is None and monitor.status:
            began_s = now_s
        elapsed_s = journal.clock.elapsed_s + (now_s - began_s if began_s is not None else 0.0)
        ending = _ending(live, monitor, elapsed_s, limit_s)
        if ending is None and coverage.is_enough(monitor):
            ending = Ending(f"{100 * (coverage.until or 0.0):g} % is known", DONE)
        if ending is None and began_s is None and now_s - started_s > READY_WAIT_S:
            why = "; ".join(trouble.values()) or "see the run's log folder"
            ending = Ending(f"the robot was not ready within {READY_WAIT_S:.0f} s: {why}", HARDWARE)
        journal.keep(monitor, headers.now_ns(), elapsed_s)
        if ending is not None:
            return ending
        warnings = monitor.new_warnings()
        if began_s is not None or not monitor.emulated:  # emulated devices may appear after their drivers start looking
            for warning in warnings:
                live.progress.say(warning)
                if (node := warning.partition(":")[0]) in ("mobile_base", "camera"):
                    trouble[node] = warning
        if live.progress.is_due:
            live.progress.show(told_now(monitor, coverage.of(monitor), elapsed_s, limit_s, trouble))


def told_now(
    monitor: Monitor, coverage: float | None, elapsed_s: float, limit_s: float | None, missing: Iterable[str] = ()
) -> str:
    """The terminal's line. missing: nodes that are known to lack their device."""
    status = monitor.status
    area_m2 = monitor.grid.known_area_m2 if monitor.grid is not None else 0.0
    return progress_line(
        str(status.get("state", MissionState.STARTING.value)),
        str(status.get("reason", f"waiting for {' and '.join(missing) or 'the nodes'}")),
        known=f"{100 * coverage:.0f} % covered" if coverage is not None else f"{area_m2:.1f} m2 known",
        driven_m=monitor.distance_m, elapsed_s=elapsed_s, limit_s=limit_s, left_s=status.get("left_s"),
    )  # fmt: skip


def _ending(live: LiveRun, monitor: Monitor, elapsed_s: float, limit_s: float | None) -> Ending | None:
    status = monitor.status
    if live.interrupted:
        return Ending("stopped by the operator", STOPPED)
    if live.dead == MASTER:
        return Ending("the ROS master of this run has ended, so the robot was stopped; explore again", FAILED)
    if live.dead:
        said = monitor.last_words(live.dead)
        if said:
            return Ending(f"node {live.dead} has ended: {said}", FAILED)
        return Ending(f"node {live.dead} died; its last words are in the run's log folder", INTERNAL)
    if status.get("state") == MissionState.DONE.value:
        return Ending(str(status.get("reason")), _CODES.get(str(status.get("outcome")), INTERNAL))
    if limit_s is not None and elapsed_s >= limit_s:
        return Ending(f"time limit of {limit_s:g} s", DONE)
    return None

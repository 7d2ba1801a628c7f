"""Node ``run_folder``: keeps the folder of a run that roslaunch has started, as ``vsx explore`` does for its own.

It writes every change of state at once; at the end, after vslam's results, the map, figures, events and report.

Subscribers: those of the monitor (explore/{status,events}, vslam/{state,stats/*}, map, odom, follower/status,
    move_base/stats/plan_ms, mobile_base/hazards, /rosout, /diagnostics; of an emulator emulator/ground_truth/*).
Parameters: ~config (tree of 'vsx config'), ~run_dir (the folder; auto: the one that the launch file has made; none:
    nothing is kept), ~emulated (bool, false: is the robot that of the node emulator?), ~camera ("": that of camera)."""

import time
from pathlib import Path
from typing import Any

import rospy

from vsx_ros.config import Config
from vsx_ros.exploration.decision import MissionState
from vsx_ros.ros import calls, headers, node, threads
from vsx_ros.ros.monitor import Monitor, MonitorJournal
from vsx_ros.ros.run_results import About, Ending, write_results
from vsx_ros.runs.folder import RunFolder
from vsx_ros.runs.hold import hold
from vsx_ros.runs.judge import MapJudge
from vsx_ros.runs.process import STOPPED
from vsx_ros.runs.report import EXIT_CODES
from vsx_ros.runs.world import open_world, save_world
from vsx_ros.sim.emulated_world import EmulatedWorld

_PERIOD_S = 0.5
_RESULTS_WAIT_S = 12.0  # for vslam; roslaunch ends every node after 15 s
_CODES = {outcome.name: code for outcome, code in EXIT_CODES.items()}


class RunFolderNode:
    """Watches; ``finish`` writes, after ROS has shut down."""

    def __init__(self, config: Config) -> None:
        """Raises InputError when the folder cannot be written."""
        self._config, told = config, node.run_dir()
        self._folder = RunFolder(Path(told)) if told else None
        self._vslam_pid = 0
        if self._folder is None:
            rospy.logwarn("run_dir is none: nothing of this run is kept")
            return
        world, self._held = self._begin(self._folder), hold(self._folder.path)  # until this process ends
        self._journal = MonitorJournal(self._folder, config.robot.mount)
        self._judge = MapJudge(world, config) if world is not None and not self._about.load_map else None
        self._monitor = Monitor(emulated=world is not None)
        self._began_s: float | None = None
        rospy.loginfo("the run is kept in %s", self._folder.path)
        threads.every(_PERIOD_S, "journal", self._keep)

    def _begin(self, folder: RunFolder) -> EmulatedWorld | None:
        """Write the configuration and the emulated world of a new run; a resumed one has them, and the name of the map
        that it continued."""
        load_map, zones = (str(rospy.get_param(f"vslam/{name}", "")) for name in ("load_map", "zones"))
        name = _of_emulator("world", None)
        if folder.checkpoint.exists:
            load_map = str(folder.read_config()[1].get("load_map") or "")
        load_map, zones = (str(Path(file).resolve()) if file else "" for file in (load_map, zones))
        planner, seed = str(rospy.get_param("move_base/planner", "fov")), int(_of_emulator("seed", 0))
        self._about = About(name, seed, planner, load_map or None)
        world = open_world(str(name), seed, hard=[_of_emulator("hard", "")]) if name is not None else None
        if not (folder.path / "config.yaml").exists():
            folder.path.mkdir(parents=True, exist_ok=True)
            base, port = rospy.get_param("mobile_base/robot_type", None), rospy.get_param("mobile_base/port", None)
            folder.write_config(
                self._config, ["roslaunch"], world=name, seed=seed, base=base, port=port, planner=planner, fast=False,
                camera=rospy.get_param("~camera", "") or rospy.get_param("camera/device", "ros"), time=None, until=None,
                load_map=load_map or None, zones=zones or None, room=rospy.get_param("vslam/room", "") or None,
                dock=_of_emulator("dock", "") or None, rate=_of_emulator("rate_hz", None), eye="raster",
                battery_pace=_of_emulator("battery_pace", None), hard={} if world is None else world.hard,
            )  # fmt: skip
            if world is not None:
                save_world(world, folder.path / "world.yaml")
        return world

    def _keep(self) -> None:
        now_s = time.monotonic()
        if self._began_s is None and self._monitor.status:
            self._began_s = now_s
        elapsed_s = 0.0 if self._began_s is None else now_s - self._began_s
        self._journal.keep(self._monitor, headers.now_ns(), self._journal.clock.elapsed_s + elapsed_s)
        if not calls.is_alive(self._vslam_pid):  # also a vslam that was started again
            self._vslam_pid = calls.pid_of("vslam") or self._vslam_pid

    def close(self) -> None:
        """The stops that follow are the run's own."""
        if self._folder is not None:
            self._monitor.is_ending = True

    def finish(self) -> None:
        """Wait until vslam has ended, then write the results. On the main thread: shutdown waits for no other."""
        if self._folder is None:
            return
        deadline_s = time.monotonic() + _RESULTS_WAIT_S
        while self._vslam_pid and calls.is_alive(self._vslam_pid) and time.monotonic() < deadline_s:
            time.sleep(0.1)
        over = (status := self._monitor.status).get("state") == MissionState.DONE.value
        code = _CODES.get(str(status.get("outcome")), STOPPED) if over else STOPPED
        ending = Ending(str(status.get("reason")) if over else "stopped by the operator", code)
        write_results(self._folder, self._config, self._monitor, self._journal, self._judge, ending, self._about)


def _of_emulator(name: str, default: Any) -> Any:
    """A parameter of the emulator; of a real robot the default, though a master may have that of an earlier launch."""
    return rospy.get_param(f"emulator/{name}", default) if rospy.get_param("~emulated", False) else default


def main() -> None:
    """Entry point of scripts/run_folder."""
    built: list[RunFolderNode] = []

    def build(config: Config) -> RunFolderNode:
        built.append(RunFolderNode(config))
        return built[0]

    node.run("run_folder", build)
    for each in built:
        each.finish()

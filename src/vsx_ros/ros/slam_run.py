"""The run of the node vslam: how it resumes, what it stores while running and what it writes at the end."""

import tempfile
import threading
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeAlias

import rospy
from numpy.typing import NDArray
from std_msgs.msg import Float64MultiArray

from vsx_ros.arrays import Points3
from vsx_ros.config import Config
from vsx_ros.errors import InputError
from vsx_ros.geometry.mount import mounted
from vsx_ros.io.calibration_file import factors_from_topic
from vsx_ros.io.slam_map_file import load_slam_map, save_slam_map
from vsx_ros.occupancy.grid import OccupancyGrid
from vsx_ros.robot import Frame, Odometry
from vsx_ros.ros import logs, node, topics
from vsx_ros.ros.callbacks import subscribe
from vsx_ros.runs.folder import RunFolder
from vsx_ros.runs.places import begin_places, resume_places, rooms_known
from vsx_ros.runs.previous import PreviousSessions
from vsx_ros.runs.self_calibration import write_self_calibration
from vsx_ros.runs.session import RunWriter
from vsx_ros.session import SlamSession
from vsx_ros.slam.slam import ThreadedSlam
from vsx_ros.slam.snapshot import SlamMap
from vsx_ros.slam.state import TrackingResult

State: TypeAlias = Mapping[str, NDArray[Any]]
WriteBeside: TypeAlias = Callable[[SlamMap | None, Path], None]  # writes zones, rooms and dock beside it
_REST = 4.0  # Pause after writing, as a multiple of the writing time: the map of a 40 m x 25 m building has 120 MB


class SlamRun:
    """session: new, or in the map of ~load_map, or resumed from ~run_dir. continued: a map's file; the rooms beside it
    keep their names. map_file: that of ~run_dir. first_epoch: the odometry's epoch at the start. Raises MapFileError or
    InputError for damaged files."""

    def __init__(self, config: Config) -> None:
        self._factors = config.robot.odometry  # in the odometry, until the base tells its own
        subscribe(topics.ODOM_FACTORS, Float64MultiArray, self._on_factors, queue_size=1)
        T_base_cam, run_dir = mounted(config.robot.mount), node.run_dir()
        self._save_map = str(rospy.get_param("~save_map", ""))  # read now: the master may be gone at the end
        self._save_map_to, self._saving = Path(run_dir or tempfile.gettempdir()) / "map.vsxmap", threading.Lock()
        self._folder = RunFolder(Path(run_dir)) if run_dir else None
        load_map = str(rospy.get_param("~load_map", ""))
        self.continued = rooms_known(self._folder, load_map)
        self.map_file = self._folder.path / "map.yaml" if self._folder is not None else None
        before = PreviousSessions.of(self._folder) if self._folder is not None else None
        if before is not None and self._folder is not None:
            self.session = SlamSession(T_base_cam, config, before.saved.slam_map, before.saved.state)
            resume_places(self.session.ground, self._folder)
        else:
            path = Path(load_map) if load_map else None
            self.session = SlamSession(T_base_cam, config, load_slam_map(path) if path else None)
            zones, room = (str(rospy.get_param(name, "")) for name in ("~zones", "~room"))
            begin_places(self.session.ground, path, Path(zones) if zones else None, room)
        self._keeper = RunWriter(T_base_cam, self._folder, before, logs.log_errors, _REST, config.runs)
        self.first_epoch = 1 + self._keeper.record.odom_epoch

    def _on_factors(self, msg: Float64MultiArray) -> None:
        self._factors = factors_from_topic(msg.data, rospy.resolve_name(topics.ODOM_FACTORS))

    def see(self, frame: Frame, grid: OccupancyGrid | None) -> None:
        """Note the newest image and ground map; from the tracking thread."""
        self._keeper.see(frame, grid)

    def frame(self, slam: ThreadedSlam, result: TrackingResult, odometry: Odometry | None, track_s: float) -> None:
        """A frame was tracked, in ``track_s`` seconds; from the tracking thread."""
        events = slam.drain_events()
        if self._folder is not None:
            self._keeper.frame(result, odometry, track_s, slam.statistics().u2_frames, events)
            self._keeper.note(slam, result.stamp_ns)

    def save_map(self, slam: ThreadedSlam | None, write_beside: WriteBeside) -> str:
        """Save the map, its zones, rooms and dock as they are now, while the SLAM goes on; returns the path. Raises
        InputError or MapFileError."""
        slam_map = slam.slam_map() if slam is not None else None
        if slam_map is None:
            raise InputError("there is no map yet: it starts with the first straight drive")
        path = Path(str(rospy.get_param("~save_map_to", "")) or self._save_map_to)
        with self._saving:  # each call has a thread, and all write the same files
            save_slam_map(slam_map, path)
            write_beside(slam_map, path)
        return str(path)

    def end(
        self, slam: ThreadedSlam, driven: State, surface: Points3 | None, grid: OccupancyGrid | None,
        write_beside: WriteBeside,
    ) -> None:  # fmt: skip
        """Write the last checkpoint, what lies beside the map, the map of ~save_map and the results; if one fails, the
        others are still written. The results come last: they take longest, and can be made from the journal."""
        if frames := self._keeper.record.frames:
            self._keeper.note(slam, frames[-1].stamp_ns, now=True)
        logs.attempt(lambda: self.write(driven))
        if (map_file := self.map_file) is not None:
            logs.attempt(lambda: write_beside(slam.slam_map(), map_file))
        logs.attempt(lambda: self._write_map(slam, write_beside))
        logs.attempt(lambda: self._write_results(slam, surface, grid))

    def write(self, driven: State) -> None:
        """Write the images noted since the last call, and the map noted last, with the newest state of the ground; may
        wait for the disk for seconds."""
        self._keeper.write_seen()
        self._keeper.write(driven)

    def _write_results(self, slam: ThreadedSlam, surface: Points3 | None, grid: OccupancyGrid | None) -> None:
        if self._folder is None:
            return
        folder, known = self._folder, self._factors
        more = [lambda: write_self_calibration(folder.path, self.session.calibration, known)]
        if said := self._keeper.finish(folder, slam, None, surface, grid, *more):
            raise InputError(said)

    def _write_map(self, slam: ThreadedSlam, write_beside: WriteBeside) -> None:
        slam_map = slam.slam_map()
        if self._save_map and slam_map is not None:
            save_slam_map(slam_map, Path(self._save_map))
            write_beside(slam_map, Path(self._save_map))

"""What a mission needs to go on after an interruption, in the folder of its run."""

import threading
from pathlib import Path

import rospy

from vsx_ros.exploration.mission import Mission
from vsx_ros.exploration.saved_mission import SavedMission
from vsx_ros.geometry.se2 import SE2
from vsx_ros.ros import clock, logs, threads
from vsx_ros.ros.localization import LocalizationSubscriber
from vsx_ros.runs.folder import RunFolder

_PERIOD_S = 1.0


class MissionWriter:
    """Writes once a second where ~run_dir is given, and ``recall``s what a session before has left there."""

    def __init__(self, mission: Mission, lock: threading.Lock, where: LocalizationSubscriber) -> None:
        """lock: of the mission."""
        self._mission, self._lock, self._where = mission, lock, where
        self._writing = threading.Lock()
        self._saved: SavedMission | None = None
        run_dir = str(rospy.get_param("~run_dir", ""))
        self._checkpoint = RunFolder(Path(run_dir)).checkpoint if run_dir else None
        if self._checkpoint is not None:
            if (remembered := self._checkpoint.read_mission()) is not None:
                self._saved = SavedMission.of(remembered, self._checkpoint.path)
            threads.every(_PERIOD_S, "memory", self.write)

    def restore(self, now_ns: int, T_odom_base: SE2 | None) -> None:
        """Once, as soon as there is odometry; the caller holds the lock."""
        if self._saved is not None and T_odom_base is not None:
            self._mission.restore(now_ns, self._saved, T_odom_base)
            self._saved = None

    def write(self) -> None:
        """Write all of it now; may wait for the disk."""
        now_ns = clock.now_ns()
        T_odom_base = self._where.at(now_ns).T_odom_base
        if self._checkpoint is None or self._saved is not None or T_odom_base is None:
            return
        with self._lock:
            saved = self._mission.to_save(now_ns, T_odom_base)
        with logs.log_errors(), self._writing:
            self._checkpoint.write_mission(saved.tree(), now_ns)

"""What a mission needs to go on after an interruption, in the folder of its run."""

from __future__ import annotations

import threading
from pathlib import Path

import rospy

from vsx_ros.exploration.memory import MissionMemory
from vsx_ros.exploration.mission import Mission
from vsx_ros.geometry.se2 import SE2
from vsx_ros.ros import clock, logs, threads
from vsx_ros.ros.localization import HeardLocalization
from vsx_ros.runs.folder import RunFolder

_PERIOD_S = 1.0


class MissionKeeper:
    """Writes once a second where ~run_dir is given, and ``recall``s what a session before has left there."""

    def __init__(self, mission: Mission, lock: threading.Lock, where: HeardLocalization) -> None:
        """lock: of the mission."""
        self._mission, self._lock, self._where = mission, lock, where
        self._writing = threading.Lock()
        self._recalled: MissionMemory | None = None
        run_dir = str(rospy.get_param("~run_dir", ""))
        self._checkpoint = RunFolder(Path(run_dir)).checkpoint if run_dir else None
        if self._checkpoint is not None:
            if (remembered := self._checkpoint.read_mission()) is not None:
                self._recalled = MissionMemory.of(remembered, self._checkpoint.path)
            threads.every(_PERIOD_S, "memory", self.write)

    def recall(self, now_ns: int, T_odom_base: SE2 | None) -> None:
        """Once, as soon as there is odometry; the caller holds the lock."""
        if self._recalled is not None and T_odom_base is not None:
            self._mission.recall(now_ns, self._recalled, T_odom_base)
            self._recalled = None

    def write(self) -> None:
        """Write all of it now; may wait for the disk."""
        now_ns = clock.now_ns()
        T_odom_base = self._where.at(now_ns).T_odom_base
        if self._checkpoint is None or self._recalled is not None or T_odom_base is None:
            return
        with self._lock:
            memory = self._mission.memory(now_ns, T_odom_base)
        with logs.log_errors(), self._writing:
            self._checkpoint.write_mission(memory.tree(), now_ns)

"""The stack of the live tests, for fault benchmarks: real nodes explore an emulated office over real drivers."""

import os
import signal
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeAlias

from tables import campaign

from vsx_ros.experiments.campaign import Task, UntriedError

TESTS = Path(__file__).resolve().parents[1] / "tests" / "ros"
START_S = 15.0
"""If the robot is stopped before a map exists, it gives up."""
TRY_S = 600.0  # for one trial with a result


def home() -> Path:
    """A folder for all files of the nodes. Sets a master address for this process and its nodes. From now on SIGTERM
    raises KeyboardInterrupt, so that the nodes are ended."""
    sys.path[:0] = [str(TESTS), str(TESTS.parent)]
    from ros_ports import HOST, free_port

    signal.signal(signal.SIGTERM, signal.default_int_handler)
    folder = Path(tempfile.mkdtemp(prefix="vsxf"))
    os.environ.update(ROS_MASTER_URI=f"http://{HOST}:{free_port()}", ROS_HOSTNAME=HOST, ROS_LOG_DIR=str(folder))
    return folder


def new_stack(folder: Path) -> Any:
    """A stack that is not started yet, in its own folder within this one; call ``home`` first. ended: set it if no
    other trial can be made on it."""
    from conftest import Stack

    stack = Stack(Path(tempfile.mkdtemp(dir=folder)))
    stack.ended = False
    return stack


def wait_for_motion(stack: object, seconds: float) -> bool:
    """Whether the wheels turn, for 0.3 s already; waits for it."""
    deadline, since = time.monotonic() + seconds, 0.0
    while time.monotonic() < deadline:
        since = (since or time.monotonic()) if stack.plant.moving else 0.0
        if since and time.monotonic() - since > 0.3:
            return True
        time.sleep(0.02)
    return False


def begin(stack: object) -> None:
    """Wait until the map has started."""
    wait_for_motion(stack, 90.0)
    time.sleep(START_S)


def ready(stack: object) -> bool:
    """Wait until the robot drives; if it has given up, restart the nodes that may be the reason."""
    for restart in ((), ("explore",), ("vslam", "explore"), ("vslam", "move_base", "follower", "explore")):
        for node in restart:
            stack.kill(node)
            stack.start(node)
        if "vslam" in restart:
            begin(stack)
        if wait_for_motion(stack, 30.0):
            return True
    return False


Trial: TypeAlias = Callable[[Any], dict[str, Any] | None]


class ExploringRobot:
    """A robot for all trials of a campaign, from the first one on; another one after a trial that failed."""

    def __init__(self, trial_on: Callable[[Any], Trial], new: Callable[[Path], Any] = new_stack) -> None:
        """trial_on(stack), once it runs, makes the trials, which begin while the robot drives. One that returns None is
        repeated. new: as ``new_stack``."""
        self._folder, self._trial_on, self._new = home(), trial_on, new
        self._stack: Any = None

    def campaign(self, rows: str, tasks: Sequence[Task], out: Path | None = None) -> None:
        """As ``tables.campaign``."""
        try:
            campaign(rows, tasks, self._tried, out)
        finally:
            before = signal.signal(signal.SIGTERM, signal.SIG_IGN)  # timeout(1) sends two
            try:
                self._end()
            finally:
                signal.signal(signal.SIGTERM, before)

    def _tried(self, task: Task) -> dict[str, Any]:
        try:
            if self._stack is None:
                self._stack = self._new(self._folder)
                self._stack.up()
                self._trial = self._trial_on(self._stack)
                begin(self._stack)
            end_s = time.monotonic() + TRY_S
            while time.monotonic() < end_s and ready(self._stack):
                if (result := self._trial(task)) is not None:
                    if self._stack.ended:
                        self._end()
                    return result
            raise UntriedError("the robot does not drive as this needs")
        except Exception:
            self._end()
            raise

    def _end(self) -> None:
        if self._stack is not None:
            stack, self._stack = self._stack, None
            stack.ended = True
            stack.down()

"""The stack of the live tests, for fault benchmarks: real nodes explore an emulated office over real drivers."""

import os
import signal
import sys
import tempfile
import time
from argparse import Namespace
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from vsx_ros.experiments.rows import Store

TESTS = Path(__file__).resolve().parents[1] / "tests" / "ros"
START_S = 15.0
"""If the robot is stopped before a map exists, it gives up."""


def home() -> Path:
    """A folder for all files of the nodes. Sets a master address for this process and its nodes. From now on SIGTERM
    raises KeyboardInterrupt, so that the nodes are ended."""
    sys.path[:0] = [str(TESTS), str(TESTS.parent)]
    from ros_ports import HOST, free_port

    signal.signal(signal.SIGTERM, signal.default_int_handler)
    folder = Path(tempfile.mkdtemp(prefix="vsxf"))
    os.environ.update(ROS_MASTER_URI=f"http://{HOST}:{free_port()}", ROS_HOSTNAME=HOST, ROS_LOG_DIR=str(folder))
    return folder


def new_stack(folder: Path) -> object:
    """A stack that is not started yet, in its own folder within this one; call ``home`` first."""
    from conftest import Stack

    return Stack(Path(tempfile.mkdtemp(dir=folder)))


def wait_for_motion(stack: object, seconds: float) -> bool:
    """Whether the wheels turn, for 0.3 s already; waits for it."""
    deadline, since = time.monotonic() + seconds, 0.0
    while time.monotonic() < deadline:
        since = (since or time.monotonic()) if stack.plant.moving else 0.0
        if since and time.monotonic() - since > 0.3:
            return True
        time.sleep(0.02)
    return False


def begin(stack: object, start_s: float = START_S) -> None:
    """Wait until the map has started; not needed if the robot will not be stopped and driven again."""
    wait_for_motion(stack, 90.0)
    time.sleep(start_s)


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


def measure(
    store: Store, key: str, values: Sequence[float], args: Namespace, stack: Any,
    once_on: Callable[[Any], Callable[[float], dict[str, Any] | None]],
) -> None:  # fmt: skip
    """Measure the missing rows of the store: args.repetitions for each value (``key``), on one robot, within
    args.minutes. once_on(stack) measures one row while the robot drives; None is repeated."""
    end_s = time.monotonic() + 60.0 * args.minutes
    questions = [{key: value, "repetition": k} for k in range(args.repetitions) for value in values]
    missing = [asked for asked in questions if asked not in store]
    if not missing:
        return
    try:
        stack.up()
        once = once_on(stack)
        begin(stack)
        for asked in missing:
            found = None
            while found is None and time.monotonic() < end_s and ready(stack):
                found = once(asked[key])
            if found is None:
                break
            store.add(asked, found)
            print(asked, found, flush=True)
    finally:
        stack.down()

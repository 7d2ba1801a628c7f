"""The stack of the live tests, for benchmarks that hurt it: real nodes explore an emulated office over real drivers."""

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
"""Before a map exists, a robot that is held back gives up."""


def home() -> Path:
    """A folder for all that the nodes write; this process and its nodes get a master's address of their own. Being
    terminated is from now on an interruption, so that the nodes are ended."""
    sys.path[:0] = [str(TESTS), str(TESTS.parent)]
    from ros_ports import HOST, free_port

    signal.signal(signal.SIGTERM, signal.default_int_handler)
    folder = Path(tempfile.mkdtemp(prefix="vsxf"))
    os.environ.update(ROS_MASTER_URI=f"http://{HOST}:{free_port()}", ROS_HOSTNAME=HOST, ROS_LOG_DIR=str(folder))
    return folder


def new_stack(folder: Path) -> object:
    """A stack that is not up yet; call ``home`` first. It lives in a folder of its own within this one."""
    from conftest import Stack

    return Stack(Path(tempfile.mkdtemp(dir=folder)))


def wait_for_motion(stack: object, seconds: float) -> bool:
    """The wheels turn, and have done so for 0.3 s."""
    deadline, since = time.monotonic() + seconds, 0.0
    while time.monotonic() < deadline:
        since = (since or time.monotonic()) if stack.plant.moving else 0.0
        if since and time.monotonic() - since > 0.3:
            return True
        time.sleep(0.02)
    return False


def begin(stack: object, start_s: float = START_S) -> None:
    """Let the map start; a stack that will not be held back and driven again needs no time for that."""
    wait_for_motion(stack, 90.0)
    time.sleep(start_s)


def ready(stack: object) -> bool:
    """The robot drives; where it has given up, what could have made it give up is started again."""
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
    """Rows of what the store does not know: for each value (``key``) so many as args.repetitions, on one robot, within
    args.minutes. once_on(stack) measures one, when the robot drives; None is tried again."""
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

"""The ROS master is killed while the robot explores, and a new one starts later: what the wheels do.

python benchmarks/fault_master.py [--away 0.5 1 5 30] [--repetitions 20] [--out benchmarks/results/fault_master.jsonl]

As benchmarks/fault_nodes.py, on the same stack. A row is one repetition. ``away_s``: time without a master.
``turned_s``: how long the wheels turned after it was killed (-1: they did not stop).
``path_s``: time from the start of the new one until the stop path worked again: the service of the emergency stop, its
node and the topics of the commands are registered, and the service accepts a connection (null: not within 60 s; the
next repetition has another robot).
``moved_before``: whether the wheels, once they stood, turned before that.
``driving_s``: when the robot drove again by itself (null: not within 60 s), or ``ending``: what ended it.
``stopped``: whether 'vsx stop' then stopped it. Existing rows of the present code are not measured again.
"""

import argparse
import subprocess
import sys
import time
from collections import namedtuple
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

from exploring_robot import ExploringRobot, wait_for_motion

Away = namedtuple("Away", "away_s repetition")
AWAY_S = (0.5, 1.0, 5.0, 30.0)
PATH_WITHIN_S = DRIVES_WITHIN_S = VSX_WITHIN_S = 60.0
COMMANDS = ("safety_controller", "teleop", "navi")


def stop_path() -> bool:
    """Whether a client of the current master can stop the base."""
    import rosgraph

    from vsx_ros.ros.calls import answers_at

    master = rosgraph.Master("/fault_master")
    try:
        address = master.lookupService("/mobile_base/estop")
        master.lookupNode("/mobile_base")
        subscribed = dict(master.getSystemState()[1])
    except (OSError, rosgraph.MasterException):
        return False
    inputs = [subscribed.get(f"/cmd_vel_mux/input/{name}", []) for name in COMMANDS]
    return answers_at(address) and all("/mobile_base" in nodes for nodes in inputs)


def wait_for_stop_path(plant: Any, since_s: float, within_s: float = PATH_WITHIN_S) -> tuple[float | None, bool]:
    """When it worked again [s, monotonic], None if not within within_s [s], and whether the wheels turned after since_s
    while it surely did not."""
    moved, end_s = False, time.monotonic() + within_s
    while (asked_s := time.monotonic()) < end_s:
        if stop_path():
            return time.monotonic(), moved
        moved = moved or since_s < plant.started_s < asked_s
        time.sleep(0.002)
    return None, moved


def vsx(*words: str) -> bool:
    command = [sys.executable, "-m", "vsx_ros.cli.main", *words]
    try:
        return subprocess.run(command, check=False, capture_output=True, timeout=VSX_WITHIN_S).returncode == 0
    except subprocess.TimeoutExpired:
        return False


def stops(plant: object) -> bool:
    """Whether 'vsx stop' works; the robot may drive afterwards."""
    said = vsx("stop")
    time.sleep(0.3)
    return said and not plant.moving and vsx("stop", "--release")


def trial(stack: Any, task: Away) -> dict[str, object]:
    plant, master = stack.plant, stack._processes["rosmaster"]
    killed_s = time.monotonic()
    master.kill()
    master.wait()
    time.sleep(max(0.0, killed_s + task.away_s - time.monotonic()))
    turned_s = -1.0 if plant.moving else max(0.0, plant.stopped_s - killed_s)
    began_s = time.monotonic()
    stack.start_master()
    path_s, moved = wait_for_stop_path(plant, killed_s + turned_s)
    stack.ended = path_s is None
    drives = wait_for_motion(stack, DRIVES_WITHIN_S)
    return {
        "turned_s": round(turned_s, 3),
        "path_s": None if path_s is None else round(path_s - began_s, 3),
        "moved_before": moved,
        "driving_s": round(plant.started_s - began_s, 3) if drives else None,
        "ending": "" if drives else "; ".join(stack._explorer_said().splitlines()[-2:]),
        "stopped": stops(plant),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--away", nargs="+", type=float, default=list(AWAY_S))
    parser.add_argument("--repetitions", type=int, default=20)
    parser.add_argument("--out", type=Path, help="default: benchmarks/results/fault_master.jsonl")
    args = parser.parse_args()
    tasks = [Away(away_s, number) for number, away_s in product(range(args.repetitions), args.away)]
    ExploringRobot(lambda stack: partial(trial, stack)).campaign("fault_master", tasks, args.out)


if __name__ == "__main__":
    main()

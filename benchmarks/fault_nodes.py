"""How long the wheels turn after a node is killed, stopped or hung, seen at the emulator's end of the wire.

python benchmarks/fault_nodes.py [--repetitions 20] [--nodes mobile_base follower ...] [--how killed hung stopped]
                                 [--out benchmarks/fault_nodes.json] [--minutes M]

The real nodes explore the lab, over a real driver and a pseudo-terminal. Each repetition waits until the wheels turn,
then does it (SIGKILL, SIGSTOP or SIGINT to that process), measures until the wheels were told to stand, and mends it;
a stack whose master ended is built anew. Results are kept after each repetition; benchmarks/fault_matrix.py makes the
table of docs/reliability.md from them.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import sys
import tempfile
import time
from pathlib import Path

TESTS = Path(__file__).resolve().parents[1] / "tests" / "ros"
sys.path.insert(0, str(TESTS))

from ros_ports import HOST, free_port  # noqa: E402

NODES = ("mobile_base", "follower", "move_base", "explore", "camera", "vslam", "rosmaster")
SIGNALS = {"killed": signal.SIGKILL, "hung": signal.SIGSTOP, "stopped": signal.SIGINT}
WATCH_S = 1.5
START_S = 15.0
"""Before a map exists, a robot that is held back gives up."""


def wait_for_motion(stack: object, seconds: float) -> bool:
    """The wheels turn, and have done so for 0.3 s."""
    deadline, since = time.monotonic() + seconds, 0.0
    while time.monotonic() < deadline:
        since = (since or time.monotonic()) if stack.plant.moving else 0.0
        if since and time.monotonic() - since > 0.3:
            return True
        time.sleep(0.02)
    return False


def ready(stack: object) -> bool:
    """The robot drives; where it has given up, what could have made it give up is started anew."""
    for restart in ((), ("explore",), ("vslam", "explore"), ("vslam", "move_base", "follower", "explore")):
        for node in restart:
            stack._processes.pop(node).send_signal(signal.SIGKILL)
            stack.start(node)
        if "vslam" in restart:
            begin(stack)
        if wait_for_motion(stack, 30.0):
            return True
    return False


def begin(stack: object) -> None:
    """Let the map start."""
    wait_for_motion(stack, 90.0)
    time.sleep(START_S)


def repetition(stack: object, node: str, how: str) -> float:
    """Seconds until the wheels stand for good; -1 when they turn after WATCH_S."""
    process = stack._processes[node]
    begin_s = time.monotonic()
    process.send_signal(SIGNALS[how])
    time.sleep(WATCH_S)
    return -1.0 if stack.plant.moving else max(0.0, stack.plant.stopped_s - begin_s)


def mend(stack: object, node: str, how: str) -> None:
    process = stack._processes[node]
    if how == "hung":
        process.send_signal(signal.SIGCONT)
        return
    process.wait(10.0)
    stack._processes.pop(node)
    stack.start(node)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repetitions", type=int, default=20)
    parser.add_argument("--nodes", nargs="+", default=list(NODES), choices=NODES)
    parser.add_argument("--how", nargs="+", default=list(SIGNALS), choices=SIGNALS)
    parser.add_argument("--minutes", type=float, default=240.0)
    parser.add_argument("--out", type=Path, default=Path(__file__).with_suffix(".json"))
    args = parser.parse_args()
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    end_s = time.monotonic() + 60.0 * args.minutes
    folder = Path(tempfile.mkdtemp(prefix="vsxf"))
    os.environ.update(ROS_MASTER_URI=f"http://{HOST}:{free_port()}", ROS_HOSTNAME=HOST, ROS_LOG_DIR=str(folder))
    from conftest import Stack

    results = json.loads(args.out.read_text()) if args.out.exists() else {}
    stack = None
    try:
        for how in args.how:
            for node in args.nodes:
                turned = results.setdefault(f"{node} {how}", [])
                while len(turned) < args.repetitions and time.monotonic() < end_s:
                    if stack is None:
                        stack = Stack(Path(tempfile.mkdtemp(dir=folder)))
                        stack.up()
                        begin(stack)
                    if not ready(stack):
                        print(f"{node} {how}: the robot does not drive; next", flush=True)
                        break
                    turned.append(round(repetition(stack, node, how), 3))
                    args.out.write_text(json.dumps(results, indent=1) + "\n")
                    print(node, how, turned[-1], flush=True)
                    if node == "rosmaster" and how != "hung":
                        stack.down()
                        stack = None
                    else:
                        mend(stack, node, how)
    finally:
        if stack is not None:
            stack.down()


if __name__ == "__main__":
    main()

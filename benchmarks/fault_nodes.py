"""How long the wheels turn after a node is killed, stopped or hung, measured at the emulator's end of the wire.

python benchmarks/fault_nodes.py [--repetitions 20] [--nodes mobile_base follower ...] [--how killed hung stopped]
                                 [--out benchmarks/results/fault_nodes.jsonl]

The real nodes explore an office, over a real driver and a pseudo-terminal. Each repetition waits until the wheels turn,
sends SIGKILL, SIGSTOP or SIGINT to the process, measures until the wheels are told to stand, and repairs the stack.
A stack without master is built again (benchmarks/fault_master.py starts another master instead). A watchdog of
mobile_base ignores SIGINT, and its node replaces it; mobile_base+watchdog are both at once.
Each repetition writes a row: ``turned_s`` (-1: they did not stop), and whether the process then ended within 10 s
(``ended``); if not, the next repetition has another robot. benchmarks/tables.py makes the table of docs/reliability.md
from them.
"""

import argparse
import os
import signal
import subprocess
import time
from collections import namedtuple
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

from exploring_robot import ExploringRobot

Ending = namedtuple("Ending", "node how repetition")
NODES = (
    "mobile_base", "follower", "move_base", "explore", "camera", "vslam", "rosmaster", "watchdog",
    "mobile_base+watchdog",
)  # fmt: skip
SIGNALS = {"killed": signal.SIGKILL, "hung": signal.SIGSTOP, "stopped": signal.SIGINT}
WATCH_S, END_S = 1.5, 10.0


def victims(stack: object, node: str) -> list[int]:
    """Process ids. A watchdog is one of the two children of mobile_base."""
    if "watchdog" not in node:
        return [stack._processes[node].pid]
    base = stack._processes["mobile_base"].pid
    watchdog, _ = (
        int(child) for task in Path(f"/proc/{base}/task").glob("*/children") for child in task.read_text().split()
    )
    return [watchdog] if node == "watchdog" else [watchdog, base]


def turned_s(stack: Any, node: str, how: str) -> float:
    """Seconds until the wheels stand for good (for a watchdog, until it is replaced); -1 if they do not."""
    pids = victims(stack, node)
    begin_s = time.monotonic()
    for pid in pids:
        os.kill(pid, SIGNALS[how])
    while time.monotonic() - begin_s < WATCH_S and (stack.plant.moving or node != "watchdog"):
        time.sleep(0.005)
    return -1.0 if stack.plant.moving else max(0.0, stack.plant.stopped_s - begin_s)


def mend(stack: Any, node: str, how: str) -> bool:
    """Repair the stack. Returns False if it cannot be, because the process does not end."""
    if node == "watchdog":
        return True
    node = node.split("+")[0]
    process = stack._processes[node]
    if how == "hung":
        process.send_signal(signal.SIGCONT)
        return True
    try:
        process.wait(END_S)
    except subprocess.TimeoutExpired:
        return False
    stack._processes.pop(node)
    stack.start(node)
    return True


def trial(stack: Any, task: Ending) -> dict[str, float | bool]:
    turned = round(turned_s(stack, task.node, task.how), 3)
    if task.node == "rosmaster" and task.how != "hung":
        stack.ended = True
        return {"turned_s": turned}
    ended = mend(stack, task.node, task.how)
    stack.ended = not ended
    return {"turned_s": turned, "ended": ended}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repetitions", type=int, default=20)
    parser.add_argument("--nodes", nargs="+", default=list(NODES), choices=NODES)
    parser.add_argument("--how", nargs="+", default=list(SIGNALS), choices=SIGNALS)
    parser.add_argument("--out", type=Path, help="default: benchmarks/results/fault_nodes.jsonl")
    args = parser.parse_args()
    tasks = [
        Ending(node, how, number)
        for how, node, number in product(args.how, args.nodes, range(args.repetitions))
        if how != "stopped" or "watchdog" not in node
    ]
    ExploringRobot(lambda stack: partial(trial, stack)).campaign("fault_nodes", tasks, args.out)


if __name__ == "__main__":
    main()

"""How long the wheels turn after a node is killed, stopped or hung, measured at the emulator's end of the wire.

python benchmarks/fault_nodes.py [--repetitions 20] [--nodes mobile_base follower ...] [--how killed hung stopped]
                                 [--out benchmarks/results/fault_nodes.jsonl] [--minutes M]

The real nodes explore an office, over a real driver and a pseudo-terminal. Each repetition waits until the wheels turn,
sends SIGKILL, SIGSTOP or SIGINT to the process, measures until the wheels are told to stand, and repairs the stack.
A stack without master is built again (benchmarks/fault_master.py starts another master instead). A watchdog of
mobile_base ignores SIGINT, and its node replaces it; mobile_base+watchdog are both at once.
Each repetition writes a row; benchmarks/tables.py makes the table of docs/reliability.md from them.
"""

import argparse
import os
import signal
import time
from pathlib import Path

from exploring_robot import START_S, begin, home, new_stack, ready
from tables import RESULTS, rooms_of

from vsx_ros.experiments.rows import Store

NODES = (
    "mobile_base", "follower", "move_base", "explore", "camera", "vslam", "rosmaster", "watchdog",
    "mobile_base+watchdog",
)  # fmt: skip
SIGNALS = {"killed": signal.SIGKILL, "hung": signal.SIGSTOP, "stopped": signal.SIGINT}
WATCH_S = 1.5


def victims(stack: object, node: str) -> list[int]:
    """Process ids. A watchdog is one of the two children of mobile_base."""
    if "watchdog" not in node:
        return [stack._processes[node].pid]
    base = stack._processes["mobile_base"].pid
    watchdog, _ = (
        int(child) for task in Path(f"/proc/{base}/task").glob("*/children") for child in task.read_text().split()
    )
    return [watchdog] if node == "watchdog" else [watchdog, base]


def repetition(stack: object, node: str, how: str) -> float:
    """Seconds until the wheels stand for good (for a watchdog, until it is replaced); -1 if they do not."""
    pids = victims(stack, node)
    begin_s = time.monotonic()
    for pid in pids:
        os.kill(pid, SIGNALS[how])
    while time.monotonic() - begin_s < WATCH_S and (stack.plant.moving or node != "watchdog"):
        time.sleep(0.005)
    return -1.0 if stack.plant.moving else max(0.0, stack.plant.stopped_s - begin_s)


def mend(stack: object, node: str, how: str) -> None:
    if node == "watchdog":
        return
    node = node.split("+")[0]
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
    parser.add_argument("--out", type=Path, default=RESULTS / "fault_nodes.jsonl")
    args = parser.parse_args()
    end_s, folder = time.monotonic() + 60.0 * args.minutes, home()
    store = Store(args.out, rooms=rooms_of("fault_nodes"))
    stack = None
    try:
        for how in args.how:
            for node in args.nodes:
                if "watchdog" in node and how == "stopped":
                    continue
                last = node == "rosmaster" and how != "hung"
                for number in range(args.repetitions):
                    asked = {"node": node, "how": how, "repetition": number}
                    if asked in store or time.monotonic() > end_s:
                        continue
                    if stack is None:
                        stack = new_stack(folder)
                        stack.up()
                        begin(stack, 0.0 if last else START_S)
                    if not ready(stack):
                        print(f"{node} {how}: the robot does not drive; next", flush=True)
                        break
                    turned_s = round(repetition(stack, node, how), 3)
                    store.add(asked, {"turned_s": turned_s})
                    print(node, how, turned_s, flush=True)
                    if last:
                        stack.down()
                        stack = None
                    else:
                        mend(stack, node, how)
    finally:
        if stack is not None:
            stack.down()


if __name__ == "__main__":
    main()

"""Time from the command until the emulated robot moves.

PYTHONPATH=src:hw python benchmarks/start.py [-n 3]

Each repetition is a new 'vsx explore --world lab' with its own master, in wall-clock time: it needs an idle machine and
compiled kernels. The processor time of all its processes shows the work for two idle cores.
"""

import argparse
import os
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

MOVED_M = 0.01
PATIENCE_S = 60.0

WATCH = f"""
import math, sys, time, rosgraph, rospy
from nav_msgs.msg import Odometry
while not rosgraph.is_master_online():
    time.sleep(0.02)
print("master", time.time(), flush=True)
rospy.init_node("watch", anonymous=True)
told = set()
def heard(msg):
    p = msg.pose.pose.position
    for word, true in (("wheels", True), ("moving", math.hypot(p.x, p.y) > {MOVED_M})):
        if true and word not in told:
            told.add(word)
            print(word, time.time(), flush=True)
rospy.Subscriber("odom", Odometry, heard)
rospy.spin()
"""


def processor_s(root: int) -> float:
    """User and system time so far of all descendants of a process."""
    below: dict[int, list[tuple[int, int]]] = {}
    for entry in Path("/proc").glob("[0-9]*"):
        try:
            fields = (entry / "stat").read_text(encoding="utf-8").rsplit(")", 1)[1].split()
        except OSError:
            continue
        below.setdefault(int(fields[1]), []).append((int(entry.name), int(fields[11]) + int(fields[12])))
    ticks, parents = 0, [root]
    while parents:
        children = below.get(parents.pop(), [])
        ticks += sum(spent for _, spent in children)
        parents += [pid for pid, _ in children]
    return ticks / os.sysconf("SC_CLK_TCK")


def once(folder: Path) -> dict[str, float]:
    """Seconds from the command to the master, the first wheel report, and the first centimetre."""
    with socket.socket() as probe:
        probe.bind(("localhost", 0))
        port = probe.getsockname()[1]
    shell = {**os.environ, "ROS_MASTER_URI": f"http://localhost:{port}", "ROS_HOSTNAME": "localhost"}
    began_s, found = time.time(), {}
    explore = [
        sys.executable,
        "-m",
        "vsx_ros.cli.main",
        "explore",
        "--world",
        "lab",
        "--headless",
        "--out",
        str(folder),
    ]
    quiet = subprocess.DEVNULL
    with (
        subprocess.Popen(explore, env=shell, stdout=quiet, stderr=quiet) as explorer,
        subprocess.Popen([sys.executable, "-c", WATCH], env=shell, stdout=subprocess.PIPE, text=True) as watch,
    ):
        assert watch.stdout is not None
        patience = threading.Timer(PATIENCE_S, watch.kill)
        patience.start()
        for line in watch.stdout:
            word, at_s = line.split()
            found[word] = float(at_s) - began_s
            if word == "moving":
                found["processor"] = processor_s(explorer.pid)
                break
        patience.cancel()
        watch.kill()
        explorer.send_signal(signal.SIGINT)
        explorer.wait(60)
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-n", type=int, default=3, help="how often")
    args = parser.parse_args()
    for number in range(args.n):
        with tempfile.TemporaryDirectory(prefix="start-") as folder:
            found = once(Path(folder) / "run")
        spent_s = found.pop("processor", 0.0)
        said = ", ".join(f"{word} after {seconds:.1f} s" for word, seconds in found.items())
        print(f"{number + 1}: {said}; {spent_s:.1f} s of processor time", flush=True)


if __name__ == "__main__":
    main()

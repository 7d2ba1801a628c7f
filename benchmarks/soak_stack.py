"""The whole exploring stack for minutes on devices that fail again and again: memory of each process, and where it is.

python benchmarks/soak_stack.py [--minutes 10] [--without-faults]

Every 20 s one fault comes and goes: the camera is unplugged, silent or loses images, the base is unplugged, silent or
loses bytes. At the end: growth of memory after three minutes, process by process; the error of the SLAM's pose and
of the odometry against the emulated truth; tracebacks in the nodes' words; nodes that died.
"""

from __future__ import annotations

import argparse
import math
import random
import time

import numpy as np
from exploring_robot import home, new_stack, wait_for_motion
from fault_camera import FaultyCable

PERIOD_S, WARM_S = 20.0, 180.0
CAMERA_FAULTS, BASE_FAULTS = ("unplugged", "off", "slow"), ("unplug", "silence", "bytes")


def memory_mb(pid: int) -> float:
    with open(f"/proc/{pid}/statm", encoding="ascii") as file:
        return int(file.read().split()[1]) * 4096 / 2**20


class Truth:
    """Where the base was, at host times, and where SLAM and odometry said that it was."""

    def __init__(self, stack: object) -> None:
        import rospy
        from geometry_msgs.msg import PoseWithCovarianceStamped
        from nav_msgs.msg import Odometry

        from vsx_ros.ros import convert, topics

        self._start = stack.plant.state.T_world_base
        self._rows: list[tuple[int, float, float, float]] = []
        self.errors: dict[str, list[float]] = {"slam": [], "odometry": []}
        self._convert = convert
        stack.watch_steps(self._on_step)
        rospy.init_node("soak", anonymous=True, disable_signals=True)
        rospy.Subscriber(f"/{topics.POSE}", PoseWithCovarianceStamped, self._judge, "slam")
        rospy.Subscriber(f"/{topics.ODOM}", Odometry, self._judge, "odometry")

    def _on_step(self, state: object) -> None:
        pose = self._start.inverse() @ state.T_world_base
        self._rows.append((time.time_ns(), pose.x, pose.y, state.path_length_m))
        del self._rows[:-2000]

    def _judge(self, msg: object, name: str) -> None:
        rows = np.array(self._rows[-2000:])
        stamp_ns = msg.header.stamp.to_nsec()
        if len(rows) < 2 or not rows[0, 0] <= stamp_ns <= rows[-1, 0]:
            return
        x, y = (float(np.interp(stamp_ns, rows[:, 0], rows[:, k])) for k in (1, 2))
        pose = self._convert.se2(msg.pose.pose)
        self.errors[name].append(math.hypot(pose.x - x, pose.y - y))


def fault(stack: object, cable: FaultyCable, rng: random.Random) -> str:
    """One fault of one to two seconds."""
    kind = rng.choice(CAMERA_FAULTS + BASE_FAULTS)
    faults = stack._base.faults
    if kind in CAMERA_FAULTS:
        cable.inject(kind)
        time.sleep(1.5)
        cable.inject("")
    elif kind == "unplug":
        stack._base.unplug()
        time.sleep(1.0)
        stack._base.replug()
    elif kind == "silence":
        faults.paused = True
        time.sleep(1.0)
        faults.paused = False
    else:
        faults.drop_rate = faults.garbage_rate = 0.001
        time.sleep(2.0)
        faults.drop_rate = faults.garbage_rate = 0.0
    return kind


def soak(stack: object, cable: FaultyCable, minutes: float, faulty: bool) -> None:
    truth, rng = Truth(stack), random.Random(1)
    wait_for_motion(stack, 90.0)
    begin_s, warm = time.monotonic(), {}
    happened: list[str] = []
    warm_s = min(WARM_S, 20.0 * minutes)
    while (elapsed_s := time.monotonic() - begin_s) < 60.0 * minutes:
        if not warm and elapsed_s > warm_s:
            warm = {name: memory_mb(process.pid) for name, process in stack._processes.items()}
        time.sleep(PERIOD_S)
        if faulty:
            happened.append(fault(stack, cable, rng))
    dead = stack.dead()
    for name, process in stack._processes.items():
        if name not in dead:
            now_mb = memory_mb(process.pid)
            print(f"{name}: {now_mb:.0f} MB, {now_mb - warm[name]:+.1f} MB since {warm_s:.0f} s")
    path_m = stack.plant.state.path_length_m
    for name, errors in truth.errors.items():
        rms = float(np.sqrt(np.mean(np.square(errors))))
        print(f"{name}: {len(errors)} poses, error {rms:.3f} m rms, {max(errors):.3f} m at most, on {path_m:.1f} m")
    counts = {kind: happened.count(kind) for kind in sorted(set(happened))}
    tracebacks = stack.logs().count("Traceback")
    print(f"faults {counts}, tracebacks {tracebacks}, dead {dead}, collisions {stack.plant.collisions}", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--without-faults", action="store_true")
    args = parser.parse_args()
    stack = new_stack(home())
    cable = FaultyCable.below(stack)
    try:
        stack.up()
        soak(stack, cable, args.minutes, not args.without_faults)
    finally:
        stack.down()


if __name__ == "__main__":
    main()

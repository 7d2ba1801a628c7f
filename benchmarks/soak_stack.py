"""The whole exploring stack for an hour, while devices, nodes, master and disk fail repeatedly.

python benchmarks/soak_stack.py [--minutes 60] [--kinds camera base node master disk] [--seed 1] [--out FILE]

Every 20 s there is one fault: the camera is unplugged, silent or loses images; the base is unplugged, silent or
loses bytes; a node is killed and started again; the master is killed and started again; the disk of the run folder is
full (a tmpfs, root only). The nodes' output is on another disk, which takes all of it. After a mission that ended
another one begins. At the end it writes a row: memory growth of each process from two minutes after its start, how much
of it the map takes there, the most that its work took beside that, and the new keyframes since; the errors of the
SLAM's pose and of the odometry against the emulated truth, the latter since its counting began, because a restarted
mobile_base counts from zero; tracebacks in the nodes' output; the missions that ended, by their reason; nodes that
ended by themselves, with their last words; they are started again. The table is made by benchmarks/tables.py.
"""

import argparse
import json
import random
import subprocess
import tempfile
import time
from collections import Counter, namedtuple
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from exploring_robot import home, wait_for_motion
from fault_camera import FaultyCable, stack_with_cable
from soak_memory import MapSize, Memory
from tables import RESULTS, campaign

from vsx_ros.geometry.se2 import SE2
from vsx_ros.robot import Odometry, OdometryEpochs

Soak = namedtuple("Soak", "kinds minutes seed")
PERIOD_S = 20.0
DISK_MB = 2048  # an hour's map and its record fit; the fault fills the rest
KINDS = {
    "camera": ("unplugged", "off", "slow"),
    "base": ("unplug", "silence", "bytes"),
    "node": ("mobile_base", "camera", "vslam", "move_base", "follower", "explore"),
    "master": ("master",),
    "disk": ("disk",),
}


class Drift:
    """How far odometry is off the truth since its counting began. stretches: how often it began."""

    def __init__(self) -> None:
        self._epochs, self._T_world_odom = OdometryEpochs(), SE2()
        self._epoch, self.stretches = -1, 0

    def off_m(self, reading: Odometry, T_world_base: SE2) -> float:
        """By a reading and the truth then."""
        epoch = self._epochs.enter(reading).odom_epoch
        if epoch != self._epoch:
            self._epoch, self._T_world_odom = epoch, T_world_base @ reading.T_odom_base.inverse()
            self.stretches += 1
        return (self._T_world_odom @ reading.T_odom_base).distance_to(T_world_base)


class Truth:
    """The true pose of the base by host time, and the errors of the poses by SLAM and odometry."""

    def __init__(self, stack: object) -> None:
        import rospy
        from geometry_msgs.msg import PoseWithCovarianceStamped
        from nav_msgs.msg import Odometry as OdometryMsg

        from vsx_ros.ros import convert, operator_command, topics

        self._start = stack.plant.state.T_world_base
        self._rows: list[tuple[int, float, float, float]] = []
        self.errors: dict[str, list[float]] = {"slam": [], "odometry": []}
        self.drift, self._convert = Drift(), convert
        stack.watch_steps(self._on_step)
        operator_command.join("soak")  # its subscriptions survive a restart of the master
        rospy.Subscriber(f"/{topics.POSE}", PoseWithCovarianceStamped, self._judge_slam)
        rospy.Subscriber(f"/{topics.ODOM}", OdometryMsg, self._judge_odometry)

    def _on_step(self, state: object) -> None:
        pose = self._start.inverse() @ state.T_world_base
        self._rows.append((time.time_ns(), pose.x, pose.y, pose.theta))
        del self._rows[:-2000]

    def _at(self, stamp_ns: int) -> SE2 | None:
        """None before and after what is known."""
        rows = np.array(self._rows[-2000:])
        if len(rows) < 2 or not rows[0, 0] <= stamp_ns <= rows[-1, 0]:
            return None
        columns = rows[:, 1], rows[:, 2], np.unwrap(rows[:, 3])
        return SE2(*(float(np.interp(stamp_ns, rows[:, 0], column)) for column in columns))

    def _judge_slam(self, msg: object) -> None:
        if (truly := self._at(msg.header.stamp.to_nsec())) is not None:
            self.errors["slam"].append(self._convert.se2(msg.pose.pose).distance_to(truly))

    def _judge_odometry(self, msg: object) -> None:
        reading = self._convert.odometry(msg)
        if (truly := self._at(reading.stamp_ns)) is not None:
            self.errors["odometry"].append(self.drift.off_m(reading, truly))


class Contacts:
    """What the robot was about when its body touched something. told: a sentence for each contact."""

    def __init__(self, stack: object) -> None:
        import rospy
        from std_msgs.msg import String

        from vsx_ros.ros import topics

        self._plant, self._count, self._about = stack.plant, stack.plant.body.collisions, ""
        self.told: list[str] = []
        rospy.Subscriber(f"/{topics.EXPLORE_STATUS}", String, self._hear)

    def _hear(self, msg: object) -> None:
        status = json.loads(msg.data)
        self._about = f"{status['state']}: {status['reason']}"

    def look(self, when: str) -> None:
        """Note new contacts."""
        count, self._count = self._count, self._plant.body.collisions
        if self._count > count:
            self.told.append(f"{when}: {self._about}, at {self._plant.state.T_world_base}")
            print(self.told[-1], flush=True)


class Faults:
    """One fault at a time, of one to some seconds."""

    def __init__(self, stack: object, cable: FaultyCable, disk: Path, rng: random.Random) -> None:
        self._stack, self._cable, self._folder, self._rng = stack, cable, disk, rng

    def one_of(self, kinds: tuple[str, ...]) -> str:
        kind = self._rng.choice(kinds)
        what = self._rng.choice(KINDS[kind])
        getattr(self, f"_{kind}")(what)
        return what

    def _camera(self, what: str) -> None:
        self._cable.inject(what)
        time.sleep(1.5)
        self._cable.inject("")

    def _base(self, what: str) -> None:
        base = self._stack._base
        if what == "unplug":
            base.unplug()
            time.sleep(1.0)
            base.replug()
        elif what == "silence":
            base.paused = True
            time.sleep(1.0)
            base.paused = False
        else:
            base.drop_rate = base.garbage_rate = 0.001
            time.sleep(2.0)
            base.drop_rate = base.garbage_rate = 0.0

    def _node(self, name: str) -> None:
        self._stack.kill(name)
        time.sleep(self._rng.uniform(0.1, 2.0))
        self._stack.start(name)

    def _master(self, _: str) -> None:
        self._stack.kill("rosmaster")
        time.sleep(self._rng.uniform(0.5, 5.0))
        self._stack.start_master()

    def _disk(self, _: str) -> None:
        ballast = self._folder / "ballast"
        subprocess.run(["dd", "if=/dev/zero", f"of={ballast}", "bs=1M"], check=False, capture_output=True)
        time.sleep(8.0)
        ballast.unlink()


def tracebacks(stack: object) -> list[str]:
    """The last line of each traceback."""
    ends = []
    for block in stack.logs().split("Traceback")[1:]:
        lines = [line for line in block.splitlines()[1:] if line and not line.startswith(" ")]
        ends.append(lines[0] if lines else "?")
    return ends


def last_end(said: str) -> str:
    """The reason with which the last mission ended, in what the explorer said."""
    return said.rpartition("]: done: ")[2].partition("\n")[0]


def soak(stack: Any, faults: Faults, kinds: tuple[str, ...], minutes: float) -> dict[str, object]:
    truth, maps, memory = Truth(stack), MapSize(), Memory(stack)
    wait_for_motion(stack, 90.0)
    end_s = time.monotonic() + 60.0 * minutes
    happened, missions = Counter[str](), Counter[str]()
    died: list[str] = []
    contacts, last = Contacts(stack), ""
    while time.monotonic() < end_s:
        due_s = time.monotonic() + PERIOD_S
        while time.monotonic() < due_s:
            memory.look(maps)
            contacts.look(f"after {minutes + (time.monotonic() - end_s) / 60:.1f} minutes, last fault {last or 'none'}")
            time.sleep(1.0)
        for name in sorted(set(stack.dead()) & set(stack.nodes)):
            died.append(f"{name}: {stack.last_words(name)}")
            stack.start(name)
        if stack.mission_is_over():
            missions[last_end(stack._explorer_said())] += 1
            stack.another_mission()
        if kinds:
            last = faults.one_of(kinds)
            happened[last] += 1
            print(f"{(end_s - time.monotonic()) / 60:.0f} minutes left, {dict(happened)}", *memory.lives, flush=True)
            print(*died, sep="\n", flush=True)
    memory.look(maps)
    return {
        "faults": dict(happened),
        "tracebacks": tracebacks(stack),
        "died_by_themselves": [*died, *(f"{name}: {stack.last_words(name)}" for name in stack.dead())],
        "missions": dict(missions),
        "collisions": stack.plant.body.collisions,
        "contacts": contacts.told,
        "path_m": round(stack.plant.state.path_length_m, 1),
        "keyframes": maps.keyframes,
        "lives": [life._asdict() for life in memory.lives],
        "odometry_stretches": truth.drift.stretches,
        "error_rms_m": {k: round(float(np.sqrt(np.mean(np.square(e)))), 3) for k, e in truth.errors.items() if e},
    }


def soaked(disk: Path, task: Soak) -> dict[str, object]:
    mounted = "disk" in task.kinds
    if mounted:
        subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={DISK_MB}m", "vsx-soak", str(disk)], check=True)
    stack = stack_with_cable(disk)
    stack.words = Path(tempfile.mkdtemp(prefix="vsx-soak-"))  # a full disk would lose what they say of it
    try:
        stack.up()
        return soak(stack, Faults(stack, stack.cable, disk, random.Random(task.seed)), task.kinds, task.minutes)
    finally:
        stack.down()
        if mounted:
            subprocess.run(["umount", "-l", str(disk)], check=False)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--kinds", nargs="*", choices=tuple(KINDS), default=list(KINDS), help="none: without faults")
    parser.add_argument("--seed", type=int, default=1, help="of the faults")
    parser.add_argument("--out", type=Path, default=RESULTS / "soak_stack.jsonl")
    args = parser.parse_args()
    task = Soak(tuple(args.kinds), args.minutes, args.seed)
    print(*campaign("soak_stack", [task], partial(soaked, home()), args.out))


if __name__ == "__main__":
    main()

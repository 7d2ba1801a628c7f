"""The whole exploring stack for an hour, while devices, nodes, master and disk fail repeatedly.

python benchmarks/soak_stack.py [--minutes 60] [--kinds camera base node master disk] [--seed 1]

Every 20 s there is one fault: the camera is unplugged, silent or loses images; the base is unplugged, silent or
loses bytes; a node is killed and started again; the master is killed and started again; the disk of the run folder is
full (a tmpfs, root only). At the end it writes a row: memory growth of each process from two minutes after its start,
how much of it the map takes there, the most that its work took beside that, and the new keyframes since; the errors of
the SLAM's pose and of the odometry against the emulated truth; tracebacks in the nodes' output; nodes that ended by
themselves, with their last words; they are started again. The table is made by benchmarks/tables.py.
"""

import argparse
import contextlib
import json
import math
import random
import subprocess
import time
from collections import Counter, deque
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from exploring_robot import home, new_stack, wait_for_motion
from fault_camera import FaultyCable
from tables import RESULTS, rooms_of

from vsx_ros.experiments.rows import Store

PERIOD_S, WARM_S = 20.0, 120.0
REST_LOOKS = 60  # one a second; the least of them is memory at rest: to adjust or store a map takes more for a while
DISK_MB = 2048  # an hour's map and its record fit; the fault fills the rest
KINDS = {
    "camera": ("unplugged", "off", "slow"),
    "base": ("unplug", "silence", "bytes"),
    "node": ("mobile_base", "camera", "vslam", "move_base", "follower", "explore"),
    "master": ("master",),
    "disk": ("disk",),
}


def memory_mb(pid: int) -> float:
    """Memory of the process itself, without file pages, whose number depends on the machine's load; 0 if it ended."""
    lines: list[str] = []
    with contextlib.suppress(OSError):
        lines = Path(f"/proc/{pid}/status").read_text(encoding="ascii").splitlines()
    return sum(int(line.split()[1]) for line in lines if line.startswith(("RssAnon:", "VmSwap:"))) / 1024


def processes(stack: object) -> Iterator[tuple[str, int]]:
    """(name, process id) of master, nodes, and the child of vslam for the dense map, which run now."""
    for name, process in list(stack._processes.items()):
        if process.poll() is None:
            yield name, process.pid
        if name == "vslam":
            with contextlib.suppress(OSError):
                for task in Path(f"/proc/{process.pid}/task").glob("*/children"):
                    yield from (("dense", int(child)) for child in task.read_text(encoding="ascii").split())


class Life(NamedTuple):
    """A process after its warm-up, at rest. map_mb: of its growth, what the map takes there. working_mb: the most that
    it took beyond that. keyframes: number of new ones since then."""

    name: str
    minutes: float
    warm_mb: float
    grown_mb: float
    map_mb: float
    working_mb: float
    keyframes: int


class Look(NamedTuple):
    """Memory of a process at one moment, what the map takes of it, and the map's keyframes."""

    held_mb: float
    map_mb: float
    keyframes: int

    @property
    def beside_mb(self) -> float:
        """What is not the map."""
        return self.held_mb - self.map_mb


class Memory:
    """Memory of each process from its warm-up to its end; a restarted node counts as a new process."""

    def __init__(self, stack: object) -> None:
        self._stack = stack
        self._since: dict[tuple[str, int], float] = {}
        self._looks: dict[tuple[str, int], deque[Look]] = {}
        self._warm: dict[tuple[str, int], Look] = {}
        self._working_mb = Counter[tuple[str, int]]()
        self._lives: dict[tuple[str, int], Life] = {}

    @property
    def lives(self) -> list[Life]:
        return list(self._lives.values())

    def look(self, maps: "MapSize") -> None:
        for process in processes(self._stack):
            name, pid = process
            warm_s = time.monotonic() - self._since.setdefault(process, time.monotonic()) - WARM_S
            now = Look(memory_mb(pid), maps.held_mb(name), maps.keyframes)
            if warm_s <= 0.0 or not now.held_mb:
                continue
            looks = self._looks.setdefault(process, deque(maxlen=REST_LOOKS))
            looks.append(now)
            if len(looks) < REST_LOOKS:
                continue
            rest = min(looks, key=lambda look: look.beside_mb)
            warm = self._warm.setdefault(process, rest)
            self._working_mb[process] = max(self._working_mb[process], now.beside_mb - rest.beside_mb)
            grown_mb, map_mb, keyframes = (round(b - a, 1) for a, b in zip(warm, rest))
            self._lives[process] = Life(
                name=name, minutes=round(warm_s / 60.0, 1), warm_mb=round(warm.held_mb, 1), grown_mb=grown_mb,
                map_mb=map_mb, working_mb=round(self._working_mb[process], 1), keyframes=keyframes,
            )  # fmt: skip


class MapSize:
    """The size of the map as the stack tells it: by the SLAM in its own process and in that of the dense map; of the
    messages with ground map and points, which planner and explorer hold."""

    def __init__(self) -> None:
        import rospy
        from geometry_msgs.msg import PoseArray
        from nav_msgs.msg import MapMetaData
        from sensor_msgs.msg import PointCloud2
        from std_msgs.msg import Float32

        from vsx_ros.ros import topics

        self.keyframes, self._mb = 0, Counter[str]()
        stats = {"vslam": "map_mib", "dense": "dense_mib"}
        for name, stat in stats.items():
            rospy.Subscriber(f"/{topics.STATS}/{stat}", Float32, lambda msg, name=name: self._note(name, msg.data))
        rospy.Subscriber(f"/{topics.KEYFRAMES}", PoseArray, self._count)
        rospy.Subscriber(f"/{topics.MAP_METADATA}", MapMetaData, lambda msg: self._note("grid", msg.width * msg.height))
        rospy.Subscriber(f"/{topics.MAP_POINTS}", PointCloud2, lambda msg: self._note("points", len(msg.data)))

    def held_mb(self, process: str) -> float:
        """What this process holds of the map; 0 for those that hold nothing of it."""
        if process in ("move_base", "explore"):
            return (self._mb["grid"] + self._mb["points"]) / 2**20
        return self._mb[process]

    def _note(self, name: str, size: float) -> None:
        self._mb[name] = size

    def _count(self, msg: object) -> None:
        self.keyframes = len(msg.poses)


class Truth:
    """The true pose of the base by host time, and the poses by SLAM and odometry."""

    def __init__(self, stack: object) -> None:
        import rospy
        from geometry_msgs.msg import PoseWithCovarianceStamped
        from nav_msgs.msg import Odometry

        from vsx_ros.ros import convert, operator_command, topics

        self._start = stack.plant.state.T_world_base
        self._rows: list[tuple[int, float, float, float]] = []
        self.errors: dict[str, list[float]] = {"slam": [], "odometry": []}
        self._convert = convert
        stack.watch_steps(self._on_step)
        operator_command.join("soak")  # its subscriptions survive a restart of the master
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

    def one_of(self, kinds: list[str]) -> str:
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


def soak(stack: object, faults: Faults, kinds: list[str], minutes: float) -> dict[str, object]:
    truth, maps, memory = Truth(stack), MapSize(), Memory(stack)
    wait_for_motion(stack, 90.0)
    end_s = time.monotonic() + 60.0 * minutes
    happened: Counter[str] = Counter()
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
        "collisions": stack.plant.body.collisions,
        "contacts": contacts.told,
        "path_m": round(stack.plant.state.path_length_m, 1),
        "keyframes": maps.keyframes,
        "lives": [life._asdict() for life in memory.lives],
        "error_rms_m": {k: round(float(np.sqrt(np.mean(np.square(e)))), 3) for k, e in truth.errors.items() if e},
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--kinds", nargs="*", choices=tuple(KINDS), default=list(KINDS), help="none: without faults")
    parser.add_argument("--seed", type=int, default=1, help="of the faults")
    args = parser.parse_args()
    asked = {"kinds": args.kinds, "minutes": args.minutes, "seed": args.seed}
    store = Store(RESULTS / "soak_stack.jsonl", rooms=rooms_of("soak_stack"))
    if asked in store:
        return
    disk = home()
    mounted = "disk" in args.kinds
    if mounted:
        subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={DISK_MB}m", "vsx-soak", str(disk)], check=True)
    stack = new_stack(disk)
    cable = FaultyCable.below(stack)
    try:
        stack.up()
        store.add(asked, soak(stack, Faults(stack, cable, disk, random.Random(args.seed)), args.kinds, args.minutes))
        print(store[asked])
    finally:
        stack.down()
        if mounted:
            subprocess.run(["umount", "-l", str(disk)], check=False)


if __name__ == "__main__":
    main()

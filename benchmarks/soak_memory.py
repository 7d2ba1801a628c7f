"""How the memory of the stack's processes grows, beside what the map takes of it."""

import contextlib
import time
from collections import Counter, deque
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

WARM_S = 120.0  # after its start, from which the growth of a process counts
REST_LOOKS = 60  # one a second; the least of them is memory at rest: to adjust or store a map takes more for a while


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

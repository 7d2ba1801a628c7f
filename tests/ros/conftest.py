"""A whole stack for tests: own master, real nodes as processes, real drivers over an emulator whose wires we watch."""

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, BinaryIO

import msgspec
import pytest

pytest.importorskip("rospy")

from chromium import Chromium
from processes import StartedCopy
from ros_ports import HOST, free_port
from served_page import ServedPage
from waiting import Lateness, wait_for

from vsx_hw.bases import BASES, base_emulator
from vsx_ros.cli.compiled import DRIVE
from vsx_ros.config import RobotConfig
from vsx_ros.ros import launch
from vsx_ros.ros.emulated_base import BodyPlant, BodyState
from vsx_ros.ros.emulation import RenderSettings, pose_row
from vsx_ros.ros.environment import THREADS
from vsx_ros.ros.fork_server import ForkServer, Request
from vsx_ros.ros.master_watch import master_watch
from vsx_ros.runs.folder import RunFolder
from vsx_ros.runs.world import open_world

CHECKOUT = Path(__file__).resolve().parents[2]
sys.path.append(str(CHECKOUT / "benchmarks"))  # file_samples
WORLD, SEED = "office", 1  # large enough to be explored as long as the tests last


class WatchedPlant(BodyPlant):
    """The wheels at the far end of the wire; remembers what they were told last, and when that changed.

    left_blocked: the left wheel does not turn, whatever it is told.
    """

    def __init__(self, *args: Any) -> None:
        self.commanded = (0.0, 0.0)
        self.left_blocked = False
        self.stopped_s = self.started_s = time.monotonic()
        super().__init__(*args)

    def set_wheel_speeds(self, left_m_s: float, right_m_s: float) -> None:
        if self.moving and (left_m_s, right_m_s) == (0.0, 0.0):
            self.stopped_s = time.monotonic()
        if not self.moving and (left_m_s, right_m_s) != (0.0, 0.0):
            self.started_s = time.monotonic()
        self.commanded = (left_m_s, right_m_s)
        super().set_wheel_speeds(0.0 if self.left_blocked else left_m_s, right_m_s)

    @property
    def moving(self) -> bool:
        return self.commanded != (0.0, 0.0)


class Stack:
    """Nodes by name, started as a live run does; ``kill`` is SIGKILL, ``start`` brings a node back."""

    def __init__(self, folder: Path) -> None:
        self.environment = {
            **os.environ,
            **THREADS,
            "ROS_MASTER_URI": os.environ["ROS_MASTER_URI"],
            "ROS_HOSTNAME": HOST,
            "ROS_HOME": str(folder),
            "PYTHONPATH": os.pathsep.join(p for p in sys.path if p),
        }
        self._folder = self.words = folder  # words: where each process writes what it says
        self.lateness = Lateness()
        self._forks = ForkServer(*DRIVE)
        self._processes: dict[str, subprocess.Popen[bytes] | StartedCopy] = {}
        world = open_world(WORLD, SEED)
        self.plant = WatchedPlant(world, SEED, RobotConfig(), self._on_step, BASES["kobuki"].wheel_base_m)
        self._base = base_emulator("kobuki", self.plant, str(folder / "base"), SEED)
        self._camera: subprocess.Popen[bytes] | None = None
        self._watchers: list[Callable[[BodyState], None]] = []
        self.nodes = {
            node.name: node
            for node in [
                *launch.bringup("auto", str(folder / "base"), f"emulator:{folder / 'camera'}"),
                *launch.exploration(seed=SEED, run_dir=str(folder / "run")),
            ]
        }

    def up(self) -> None:
        self.start_master()
        self.start_ns, start_monotonic_ns = time.time_ns(), time.monotonic_ns()
        settings = RenderSettings(
            world=WORLD,
            seed=SEED,
            hard="",
            socket=str(self._folder / "camera"),
            rate_hz=15.0,
            start_ns=self.start_ns,
            robot=RobotConfig(),
        )
        child = [sys.executable, "-m", "vsx_ros.ros.emulation"]
        self._camera = subprocess.Popen(
            child, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, env=self.environment, bufsize=0
        )
        assert self._camera.stdin is not None
        self._camera.stdin.write(msgspec.json.encode(settings) + b"\n")
        self._base.start(start_monotonic_ns)
        for name in self.nodes:
            self.start(name)

    def start_master(self) -> None:
        """At the address that all nodes know; another one knows nobody."""
        import rosgraph

        command = ["rosmaster", "--core", "-p", os.environ["ROS_MASTER_URI"].rsplit(":", 1)[1]]
        with self._log("rosmaster") as log:
            self._processes["rosmaster"] = subprocess.Popen(
                command, env=self.environment, stdout=log, stderr=log, start_new_session=True
            )
        self.wait(lambda: rosgraph.is_master_online(), "the master")

    def watch_steps(self, watcher: Callable[[BodyState], None]) -> None:
        """Call it with every step of the emulated body, on the emulator's thread."""
        self._watchers.append(watcher)

    def start(self, name: str) -> None:
        import rospy

        node = self.nodes[name]
        for key, value in node.params.items():
            rospy.set_param(f"/{name}/{key}", value)
        request = Request([str(CHECKOUT / "scripts" / name), f"__name:={name}"], self.environment, str(self._folder))
        with self._log(name) as log:
            copy = self._forks.start(request, [log.fileno(), log.fileno()])
        assert copy is not None, f"the fork server started no {name}"
        self._processes[name] = StartedCopy(copy)

    def kill(self, name: str, end: signal.Signals = signal.SIGKILL) -> None:
        self._processes.pop(name).send_signal(end)

    def another_mission(self) -> None:
        """An exploration that remembers nothing of the one before; the map stays."""
        self.kill("explore")
        run = RunFolder(Path(self.nodes["explore"].params["run_dir"]))
        (run.checkpoint.path / "mission.json").unlink(missing_ok=True)
        self.start_explorer()

    def start_explorer(self) -> None:
        """Start it and wait until it decides: the wheels may still turn for a goal that it did not send."""
        starts = self._explorer_said().count("/explore: ready")
        self.start("explore")
        self.wait(lambda: self._explorer_said().count("/explore: ready") > starts, "the explorer to be ready")

    def mission_is_over(self) -> bool:
        """Whether the explorer has said why it ended, and was not started since."""
        said = self._explorer_said()
        return said.rfind("]: done: ") > said.rfind("/explore: ready")

    def _explorer_said(self) -> str:
        log = self.words / "explore.txt"
        return log.read_text(encoding="utf-8", errors="replace") if log.exists() else ""

    def dead(self) -> list[str]:
        return [name for name, process in self._processes.items() if process.poll() is not None]

    def last_words(self, name: str) -> str:
        lines = (self.words / f"{name}.txt").read_text(encoding="utf-8", errors="replace").strip().splitlines()
        return lines[-1] if lines else ""

    def logs(self) -> str:
        return "".join(file.read_text(encoding="utf-8", errors="replace") for file in self.words.glob("*.txt"))

    def down(self) -> None:
        self._base.close()
        if self._camera is not None:
            self._camera.kill()
        for process in self._processes.values():
            process.send_signal(signal.SIGINT)
        deadline_s = time.monotonic() + 4.0
        for process in self._processes.values():
            try:
                process.wait(max(0.1, deadline_s - time.monotonic()))
            except subprocess.TimeoutExpired:
                os.killpg(process.pid, signal.SIGKILL)
        self._forks.close()

    def wait(self, condition: Callable[[], object], what: str, within_s: float | None = None) -> None:
        """within_s: how soon it must come, on a machine that runs every thread at once."""

        def said() -> str:
            return "\n".join(["the explorer said", *self._explorer_said().splitlines()[-10:]])

        wait_for(condition, what, said, within_s=within_s)

    def wait_for_stop(self, since_s: float, within_s: float) -> None:
        """The wheels stood since then, though they may turn again by now; within_s: see ``wait``."""
        self.wait(lambda: not self.plant.moving or self.plant.stopped_s > since_s, "the wheels to stand")
        stopped_s = self.plant.stopped_s
        assert stopped_s - since_s < within_s + self.lateness.between(since_s, stopped_s)

    def stands_for(self, seconds: float) -> bool:
        """Whether the wheels stand, and turn for no moment of this time either."""
        started_s = self.plant.started_s
        if self.plant.moving:
            return False
        time.sleep(seconds)
        return self.plant.started_s == started_s

    def wait_until_driving(self) -> None:
        """The wheels turn, and have done so for a moment; what tests before did to the robot may have ended its
        mission, then there is another."""

        def driving() -> bool:
            for _ in range(10):
                if not self.plant.moving:
                    if self.mission_is_over():
                        self.another_mission()
                    return False
                time.sleep(0.03)
            return True

        self.wait(driving, "the robot to drive")

    def _log(self, name: str) -> BinaryIO:
        return (self.words / f"{name}.txt").open("ab")

    def _on_step(self, state: BodyState) -> None:
        for watcher in self._watchers:
            watcher(state)
        pose = state.T_world_base
        if self._camera is not None and self._camera.stdin is not None and self._camera.poll() is None:
            row = pose_row(0).pack(state.time_ns, pose.x, pose.y, pose.theta, state.path_length_m)
            self._camera.stdin.write(row)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """What changes rospy itself comes first, before this process is a node. What uses the one robot of all tests comes
    late, so that it explores on two cores of its own and beside no other run; what sends it home comes last."""
    for item in items:
        alone = item.get_closest_marker("ros") is not None and item.get_closest_marker("light") is None
        if "stack" in getattr(item, "fixturenames", ()) and not alone:
            raise pytest.UsageError(f"nothing may run beside the live stack: mark {item.nodeid} ros and not light")
    items.sort(
        key=lambda item: (
            item.get_closest_marker("ends_mission") is not None,
            "stack" in getattr(item, "fixturenames", ()),
            item.get_closest_marker("changes_rospy") is None,
        )
    )


@pytest.fixture(scope="session")
def stack(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stack]:
    """One bring-up for all tests; rospy allows one node a process, so this is the only test process with one."""
    import rospy

    folder = tmp_path_factory.mktemp("s", numbered=True)
    os.environ.update(ROS_MASTER_URI=f"http://{HOST}:{free_port()}", ROS_HOSTNAME=HOST, ROS_LOG_DIR=str(folder))
    running = Stack(folder)
    starter = threading.Thread(target=running.up)
    try:
        starter.start()
        starter.join()
        rospy.init_node("observer", disable_signals=True)
        master_watch()
        yield running
    finally:
        rospy.signal_shutdown("tests are over")
        running.down()


@pytest.fixture
def page(browser: Chromium) -> Iterator[ServedPage]:
    served = ServedPage(browser)
    yield served
    served.close()

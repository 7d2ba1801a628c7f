"""A base alone at a master of its own: emulated wheels in this process, nodes as a user of ROS starts them."""

import json
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import rosgraph
from processes import Processes
from ros_ports import HOST, free_port

from vsx_hw.bases import BASES, base_emulator
from vsx_ros.config import RobotConfig
from vsx_ros.ros import topics
from vsx_ros.ros.emulated_base import BodyPlant
from vsx_ros.runs.world import open_world

CHECKOUT = Path(__file__).resolve().parents[2]

HAND = f"""
import time
import rospy
from geometry_msgs.msg import Twist
rospy.init_node("hand", disable_signals=True)
hand = rospy.Publisher("{topics.COMMAND_TELEOP}", Twist, queue_size=1)
forwards = Twist()
forwards.linear.x = 0.05
while True:
    hand.publish(forwards)
    time.sleep(0.05)
"""
"""A node that drives by hand, slowly. It knows nothing of masters: its connection to the base outlives them."""


class CountedPlant(BodyPlant):
    """The wheels at the far end of the wire; remembers the highest speed that they were told [m/s], how often they
    began to turn, and what ``turned_again`` said at that moment."""

    fastest_m_s, starts = 0.0, 0
    turns = could_be_stopped = False

    @staticmethod
    def turned_again() -> bool:
        return True

    def set_wheel_speeds(self, left_m_s: float, right_m_s: float) -> None:
        turn = (left_m_s, right_m_s) != (0.0, 0.0)
        if turn and not self.turns:
            self.starts += 1
            self.could_be_stopped = self.turned_again()
        self.turns = turn
        self.fastest_m_s = max(self.fastest_m_s, abs(left_m_s), abs(right_m_s))
        super().set_wheel_speeds(left_m_s, right_m_s)

    def stands_for(self, seconds: float) -> bool:
        """Whether the wheels stand, and turn for no moment of this time either."""
        starts = self.starts
        if self.turns:
            return False
        time.sleep(seconds)
        return self.starts == starts


class LoneBase:
    """``port`` is the serial port of the base; ``close`` ends all that was started."""

    def __init__(self, folder: Path, kind: str = "kobuki") -> None:
        self.processes = Processes(folder, f"http://{HOST}:{free_port()}", ROS_HOSTNAME=HOST)
        self.port = str(folder / "base")
        self.plant = CountedPlant(open_world("lab", 1), 1, RobotConfig(), lambda _: None, BASES[kind].wheel_base_m)
        self.emulator = base_emulator(kind, self.plant, self.port, 1)
        self.emulator.start(time.monotonic_ns())
        self.uri = self.processes.environment["ROS_MASTER_URI"]
        self.master_port = self.uri.rsplit(":", 1)[1]
        self.start_master()

    def start_master(self) -> None:
        """At the same address each time; another one knows nobody."""
        self._master = self.processes.start("master", "rosmaster", "--core", "-p", self.master_port)
        self.processes.wait(lambda: rosgraph.is_master_online(self.uri), "the master")

    def kill_master(self) -> None:
        self._master.kill()
        self._master.wait()

    def start(self, node: str, *words: str) -> subprocess.Popen[bytes]:
        return self.processes.start(node, sys.executable, str(CHECKOUT / "scripts" / node), *words)

    def run(self, node: str, *words: str) -> subprocess.CompletedProcess[str]:
        return self.processes.run(sys.executable, str(CHECKOUT / "scripts" / node), *words)

    def observe(self, program: str, *words: str) -> Any:
        """What a program of Python prints, as JSON; it is a node of its own, since a process can be but one."""
        done = self.processes.run(sys.executable, "-c", program, *words)
        assert done.returncode == 0, done.stderr + self.processes.logs()
        return json.loads(done.stdout)

    def graph(self) -> tuple[dict[str, list[str]], dict[str, list[str]]]:
        """Topic -> publishers and topic -> subscribers, as the master has them."""
        published, subscribed, _ = rosgraph.Master("/test", self.uri).getSystemState()
        return dict(published), dict(subscribed)

    def close(self) -> None:
        self.processes.end()
        self.emulator.close()

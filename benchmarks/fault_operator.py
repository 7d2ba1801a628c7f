"""Does an exploring robot yield to its operator, blame nothing for it, and explore on by itself?

python benchmarks/fault_operator.py [--what "emergency stop" teleop goal] [--held 300] [--repetitions 10]

As benchmarks/fault_nodes.py, on the same stack: real nodes and drivers, an emulated office. While the robot drives, the
operator presses the emergency stop, or turns the base by teleop, for so many seconds; or a client of move_base sends
it to the place where it began, which is driven to. A row is one repetition: the time until the mission says so
(``said_s``), whether status, base and event name the operator (``told``), the goals that the explorer gave meanwhile
(``goals``), the views that were blacklisted because of it (``blacklisted``), whether a goal was reached (``reached``;
null: there was none), and the time until the robot explores on after the end (``went_on_s``; null: not within two
minutes; from an emergency stop: after its release).
"""

import argparse
import time
from collections import namedtuple
from collections.abc import Callable
from itertools import product
from pathlib import Path
from typing import Any

from exploring_robot import ExploringRobot

from vsx_ros.robot import EMERGENCY_STOP

Taking = namedtuple("Taking", "what held_s repetition")
WHATS = (EMERGENCY_STOP, "teleop", "goal")
SAID_WITHIN_S, ON_WITHIN_S, GOAL_S, TELEOP_RAD_S = 10.0, 120.0, 300.0, 0.3


class Operator:
    """Create it once a stack is running."""

    def __init__(self, stack: Any) -> None:
        import actionlib
        import rospy
        from geometry_msgs.msg import Twist
        from mission_listener import MissionListener
        from move_base_msgs.msg import MoveBaseAction
        from std_srvs.srv import SetBool

        from vsx_ros.ros import operator_command, topics

        operator_command.join("operator")
        self._stack, self._held_s, self._heard = stack, 0.0, MissionListener()
        self._estop = rospy.ServiceProxy(f"/{topics.ESTOP}", SetBool)
        self._keys, self._turn = rospy.Publisher(f"/{topics.COMMAND_TELEOP}", Twist, queue_size=1), Twist()
        self._turn.angular.z = TELEOP_RAD_S
        self._reached: bool | None = None
        self._client = actionlib.SimpleActionClient(f"/{topics.MOVE_BASE_ACTION}", MoveBaseAction)

    def trial(self, task: Taking) -> dict[str, Any] | None:
        """One row; None if the robot is not on the way to a view."""
        heard, what, self._held_s = self._heard, task.what, task.held_s
        if heard.status.get("state") != "mapping":
            return None
        heard.events.clear()
        self._reached = None
        begun_s = time.monotonic()
        said_s = {EMERGENCY_STOP: self._stop, "teleop": self._teleop, "goal": self._goal}[what]()
        goals, told = sum("driving" in event["reason"] for event in heard.events), self._told
        if what == EMERGENCY_STOP:
            self._estop(False)
        ended_s = time.monotonic()
        on = self._until(lambda: heard.status["state"] == "mapping" and self._stack.plant.moving, ON_WITHIN_S)
        return {
            "said_s": None if said_s is None else round(said_s - begun_s, 2), "told": told, "goals": goals,
            "blacklisted": len(heard.blamed()), "reached": self._reached,
            "went_on_s": round(time.monotonic() - ended_s, 2) if on else None,
        }  # fmt: skip

    def _stop(self) -> float | None:
        self._estop(True)
        said_s = self._said("held")
        time.sleep(self._held_s)
        self._told = self._named(EMERGENCY_STOP)
        return said_s

    def _teleop(self) -> float | None:
        said_s, end_s = None, time.monotonic() + self._held_s
        while time.monotonic() < end_s:
            self._keys.publish(self._turn)
            time.sleep(0.05)
            said_s = time.monotonic() if said_s is None and self._heard.status["state"] == "held" else said_s
        self._told = self._named("teleop")
        return said_s

    def _goal(self) -> float | None:
        from actionlib_msgs.msg import GoalStatus
        from move_base_msgs.msg import MoveBaseGoal

        from vsx_ros.geometry.se2 import SE2
        from vsx_ros.ros import convert, topics

        self._client.wait_for_server()
        self._client.send_goal(MoveBaseGoal(convert.pose_stamped(topics.MAP_FRAME, time.time_ns(), SE2())))
        said_s = self._said("user goal")
        self._told = "/vsx_operator" in self._heard.status["reason"]
        self._until(lambda: self._client.get_state() > GoalStatus.ACTIVE, GOAL_S)
        self._reached = self._client.get_state() == GoalStatus.SUCCEEDED
        return said_s

    def _said(self, state: str) -> float | None:
        return time.monotonic() if self._until(lambda: self._heard.status["state"] == state, SAID_WITHIN_S) else None

    def _named(self, by: str) -> bool:
        """Whether status, base and one event name who holds the wheels."""
        heard = self._heard
        events = [event["reason"] for event in heard.events if event["state"] == "held"]
        return by in heard.status["reason"] and heard.held.get("by") == by and len(events) == 1 and by in events[0]

    @staticmethod
    def _until(condition: Callable[[], bool], seconds: float) -> bool:
        end_s = time.monotonic() + seconds
        while not condition():
            if time.monotonic() > end_s:
                return False
            time.sleep(0.02)
        return True


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--what", nargs="+", default=list(WHATS), choices=WHATS)
    parser.add_argument("--held", type=float, default=300.0, help="seconds of an emergency stop or of teleop")
    parser.add_argument("--repetitions", type=int, default=10)
    parser.add_argument("--out", type=Path, help="default: benchmarks/results/fault_operator.jsonl")
    args = parser.parse_args()
    tasks = [Taking(what, args.held, number) for number, what in product(range(args.repetitions), args.what)]
    ExploringRobot(lambda stack: Operator(stack).trial).campaign("fault_operator", tasks, args.out)


if __name__ == "__main__":
    main()

"""Does an exploring robot yield to its operator, blame nothing for it, and explore on by itself?

python benchmarks/fault_operator.py [--what "emergency stop" teleop goal] [--held 300] [--repetitions 10]

As benchmarks/fault_nodes.py, on the same stack: real nodes and drivers, an emulated office. While the robot drives, the
operator presses the emergency stop, or turns the base by teleop, for so many seconds; or a client of move_base sends
it to the place where it began, which is driven to. A row is one repetition: the time until the mission says so
(``said_s``), whether status, base and event name the operator (``told``), the goals that the explorer gave meanwhile
(``goals``), the views that were blacklisted because of it (``blacklisted``), whether a goal was reached (``reached``;
null: there was none), and the time until the robot explores on after the end (``went_on_s``; null: not within two
minutes; from an emergency stop: after its release). Until the end of an emergency stop or of teleop the wheels are
watched at the emulator's end of the base's wire: when they first did as the operator says (``obeyed_s``; null: never),
that is, stood or turned the base on the spot, and later how long they turned otherwise (``else_s``), and how long they
stood although he drove (``idle_s``; null: he did not).
"""

import argparse
import time
from collections import namedtuple
from collections.abc import Callable
from itertools import product
from pathlib import Path
from typing import Any

from exploring_robot import ExploringRobot

from vsx_hw.bases import BASES
from vsx_ros.robot import EMERGENCY_STOP

Taking = namedtuple("Taking", "what held_s repetition")
WHATS = (EMERGENCY_STOP, "teleop", "goal")
SAID_WITHIN_S, ON_WITHIN_S, GOAL_S, TELEOP_RAD_S = 10.0, 120.0, 300.0, 0.3
TELEOP_M_S = 0.5 * BASES["kobuki"].wheel_base_m * TELEOP_RAD_S  # of a wheel
SLACK_M_S = 0.005  # commands on the wire are whole numbers


class HeldWheels:
    """What the wheels are told while the operator holds them. turn_m_s: the speed of the right wheel that he wants, the
    left one's being opposite; 0: to stand."""

    def __init__(self, turn_m_s: float) -> None:
        self._turn_m_s = turn_m_s
        self._began_ns = self._last_ns = 0
        self._obeyed_s: float | None = None
        self._idle_s = self._else_s = 0.0

    def step(self, time_ns: int, commanded: tuple[float, float]) -> None:
        """Take what the wheels (left, right) [m/s] are told since the step before."""
        self._began_ns, last_ns = self._began_ns or time_ns, self._last_ns or time_ns
        self._last_ns, stands = time_ns, commanded == (0.0, 0.0)
        turns = abs(commanded[0] + self._turn_m_s) + abs(commanded[1] - self._turn_m_s) <= SLACK_M_S
        obeys = turns if self._turn_m_s else stands
        if self._obeyed_s is None:
            self._obeyed_s = 1e-9 * (time_ns - self._began_ns) if obeys else None
        elif not obeys:
            self._idle_s += 1e-9 * (time_ns - last_ns) * stands
            self._else_s += 1e-9 * (time_ns - last_ns) * (not stands)

    @property
    def result(self) -> dict[str, float | None]:
        return {
            "obeyed_s": None if self._obeyed_s is None else round(self._obeyed_s, 3),
            "else_s": round(self._else_s, 3),
            "idle_s": round(self._idle_s, 3) if self._turn_m_s else None,
        }


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
        self._held: HeldWheels | None = None
        stack.watch_steps(self._on_step)
        self._client = actionlib.SimpleActionClient(f"/{topics.MOVE_BASE_ACTION}", MoveBaseAction)

    def _on_step(self, state: Any) -> None:
        if (held := self._held) is not None:
            held.step(state.time_ns, self._stack.plant.commanded)

    def trial(self, task: Taking) -> dict[str, Any] | None:
        """One row; None if the robot does not drive to a view."""
        heard, what, self._held_s = self._heard, task.what, task.held_s
        if heard.status.get("state") != "mapping" or not self._stack.plant.moving:
            return None
        heard.events.clear()
        self._reached = None
        wheels = HeldWheels(TELEOP_M_S if what == "teleop" else 0.0)
        begun_s = time.monotonic()
        self._held = wheels if what != "goal" else None
        said_s = {EMERGENCY_STOP: self._stop, "teleop": self._teleop, "goal": self._goal}[what]()
        self._held = None
        goals, told = sum("driving" in event["reason"] for event in heard.events), self._told
        if what == EMERGENCY_STOP:
            self._estop(False)
        ended_s = time.monotonic()
        on = self._until(lambda: heard.status["state"] == "mapping" and self._stack.plant.moving, ON_WITHIN_S)
        return {
            "said_s": None if said_s is None else round(said_s - begun_s, 2), "told": told, "goals": goals,
            "blacklisted": len(heard.blamed()), "reached": self._reached,
            "went_on_s": round(time.monotonic() - ended_s, 2) if on else None,
            **(wheels.result if what != "goal" else dict.fromkeys(wheels.result)),
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

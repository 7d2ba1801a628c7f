"""Node ``teleop``: drives with the keyboard; its priority is above the exploration and below the safety controller.

Publishers: cmd_vel_mux/input/teleop, only while a key is held.
Parameters: ~v_m_s (0.2), ~omega_rad_s (0.6); ``vsx teleop`` sets them with --v and --omega.

Arrow keys or w a s d move, space stops, + and - change the speed, q ends. Releasing the key stops the robot."""

import atexit
import os
import select
import sys
import termios
import time
import tty

import rospy
from geometry_msgs.msg import Twist

from vsx_ros.control.keyboard import KEYS, KeyboardDrive, keys
from vsx_ros.errors import ConfigError
from vsx_ros.robot import STOP, VelocityCommand
from vsx_ros.ros import convert, node, threads, topics
from vsx_ros.ros.environment import export_ros_address
from vsx_ros.runs.process import DONE

_PERIOD_S = 0.05  # a command is valid for 0.5 s


class TeleopNode:
    """Reads the terminal on a thread, and restores its settings however the process ends. Raises ConfigError if there
    is no terminal."""

    def __init__(self, v_m_s: float, omega_rad_s: float) -> None:
        if not sys.stdin.isatty():
            raise ConfigError("there is no keyboard; start teleop in a terminal of its own, not from a launch file")
        self._publisher = rospy.Publisher(topics.COMMAND_TELEOP, Twist, queue_size=1, tcp_nodelay=True)
        self._drive = KeyboardDrive(v_m_s, omega_rad_s)
        self._input = sys.stdin.fileno()
        self._terminal = termios.tcgetattr(self._input)
        atexit.register(self._give_back)
        tty.setcbreak(self._input)
        sys.stderr.write(f"{KEYS}\n")
        self._say_speed()
        threads.worker("keyboard", self._loop)

    def _loop(self) -> None:
        driving = False
        while not rospy.is_shutdown():
            for key in self._pressed_keys():
                self._drive.press(key, time.monotonic())
                if key in ("+", "-"):
                    self._say_speed()
                elif key == "q":
                    rospy.signal_shutdown("ended by the operator")
            speeds = self._drive.speeds(time.monotonic())
            if speeds is not None or driving:
                self._publisher.publish(convert.twist(VelocityCommand(*speeds) if speeds is not None else STOP))
            driving = speeds is not None

    def _pressed_keys(self) -> list[str]:
        """Keys that arrive within one period. Never waits longer, because the robot drives meanwhile."""
        if not select.select([self._input], [], [], _PERIOD_S)[0]:
            return []
        content = os.read(self._input, 1024)
        if not content:
            rospy.signal_shutdown("the terminal is closed")
        return keys(content.decode(errors="replace"))

    def _say_speed(self) -> None:
        sys.stderr.write(f"\r{self._drive.v_m_s:.2f} m/s {self._drive.omega_rad_s:.2f} rad/s ")
        sys.stderr.flush()

    def _give_back(self) -> None:
        termios.tcsetattr(self._input, termios.TCSADRAIN, self._terminal)

    def close(self) -> None:
        """Stop, and restore the terminal."""
        self._publisher.publish(convert.twist(STOP))
        self._give_back()
        sys.stderr.write("\n")


def main() -> None:
    """Entry point of scripts/teleop."""
    speeds = ("~v_m_s", 0.2), ("~omega_rad_s", 0.6)
    node.run("teleop", lambda _: TeleopNode(*(float(rospy.get_param(name, default)) for name, default in speeds)))


def teleop(v_m_s: float, omega_rad_s: float) -> int:
    """``vsx teleop``: run the node at these speeds until it ends."""
    export_ros_address()
    node.run("teleop", lambda _: TeleopNode(v_m_s, omega_rad_s))
    return DONE

"""Node ``teleop``: drive with the keyboard, above the exploration and below the safety controller.

Publishers: cmd_vel_mux/input/teleop, only while a key is held.
Parameters: ~v_m_s (0.2), ~omega_rad_s (0.6).

Arrow keys or w a s d move, space stops, + and - change the speed, q ends. Releasing the key stops the robot.
"""

from __future__ import annotations

import select
import sys
import termios
import time
import tty

import rospy
from geometry_msgs.msg import Twist

from vsx_ros.config import Config
from vsx_ros.robot import STOP, VelocityCommand
from vsx_ros.ros import convert, process, topics

_PERIOD_S = 0.05
# A held key repeats 10 to 30 times a second after a first pause of up to half a second.
_HELD_FOR_S = 0.55
_FASTER = 1.1
_KEYS = {
    "w": (1.0, 0.0),
    "s": (-1.0, 0.0),
    "a": (0.0, 1.0),
    "d": (0.0, -1.0),
    "\x1b[A": (1.0, 0.0),
    "\x1b[B": (-1.0, 0.0),
    "\x1b[D": (0.0, 1.0),
    "\x1b[C": (0.0, -1.0),
}


class TeleopNode:
    """Reads the terminal on a thread; needs one."""

    def __init__(self, _: Config) -> None:
        self._publisher = rospy.Publisher(topics.COMMAND_TELEOP, Twist, queue_size=1, tcp_nodelay=True)
        self._v, self._omega = float(rospy.get_param("~v_m_s", 0.2)), float(rospy.get_param("~omega_rad_s", 0.6))
        self._command, self._until_s = STOP, 0.0
        self._terminal = termios.tcgetattr(sys.stdin) if sys.stdin.isatty() else None
        if self._terminal is None:
            rospy.signal_shutdown("teleop needs a terminal: start it by itself, not from a launch file")
            return
        tty.setcbreak(sys.stdin)
        sys.stderr.write("arrows or w a s d: drive   space: stop   + -: speed   q: quit\n")
        process.worker("keyboard", self._loop)

    def _loop(self) -> None:
        driving = False
        while not rospy.is_shutdown():
            key = self._key()
            if key:
                self._pressed(key)
            held = time.monotonic() < self._until_s
            if held or driving:
                self._publisher.publish(convert.twist(self._command if held else STOP))
            driving = held

    def _key(self) -> str:
        """The newest key within one period; arrows are three characters."""
        if not select.select([sys.stdin], [], [], _PERIOD_S)[0]:
            return ""
        key = sys.stdin.read(1)
        return key + sys.stdin.read(2) if key == "\x1b" else key

    def _pressed(self, key: str) -> None:
        if key in _KEYS:
            forward, left = _KEYS[key]
            self._command = VelocityCommand(forward * self._v, left * self._omega)
            self._until_s = time.monotonic() + _HELD_FOR_S
        elif key == " ":
            self._command, self._until_s = STOP, time.monotonic() + _HELD_FOR_S
        elif key in "+-":
            factor = _FASTER if key == "+" else 1.0 / _FASTER
            self._v, self._omega = self._v * factor, self._omega * factor
            sys.stderr.write(f"\r{self._v:.2f} m/s {self._omega:.2f} rad/s ")
        elif key == "q":
            rospy.signal_shutdown("ended by the operator")

    def close(self) -> None:
        """Stop, and give the terminal back as it was."""
        self._publisher.publish(convert.twist(STOP))
        if self._terminal is not None:
            termios.tcsetattr(sys.stdin, termios.TCSADRAIN, self._terminal)


def main() -> None:
    """Entry point of scripts/teleop."""
    process.run("teleop", TeleopNode)

"""Dead man's handle between nodes: whoever wants motion says so again and again; silence stops the robot.

A killed process cannot say that it is gone. So nothing in this stack moves because of one message alone: the
follower drives only while vslam and move_base renew their leases, move_base pursues a goal of a client that
holds a lease only while the client renews it. Nor can a thread that hangs: where another one renews, it does so only
for as long as the thread that decides has promised.
"""

import math
import time

import rospy
from std_msgs.msg import String

PERIOD_S = 0.05  # six to a lease of 0.3 s


class Lease:
    """One holder's side."""

    def __init__(self, topic: str, holder: str) -> None:
        self._publisher = rospy.Publisher(topic, String, queue_size=1, tcp_nodelay=True)
        self._message = String(holder)
        self._released = False
        self._until_s = 0.0

    def promise(self, seconds: float) -> None:
        """``keep`` may renew for so long from now: said again and again by the thread that decides."""
        self._until_s = time.monotonic() + seconds

    def keep(self) -> None:
        """Renew as long as it was promised; for a thread that does nothing else."""
        if time.monotonic() < self._until_s:
            self.renew()

    def renew(self) -> None:
        """Ask for ``LEASE_S`` more (navigation/follower.py); call it at least every ``PERIOD_S``."""
        if not self._released:
            self._publisher.publish(self._message)

    def release(self) -> None:
        """Never ask again: the holder is leaving, which takes a while."""
        self._released = True


class LeaseWatch:
    """The other side: who renewed lately. Counts on the monotonic clock, whatever ROS time does."""

    def __init__(self, topic: str) -> None:
        self._renewed_s: dict[str, float] = {}
        rospy.Subscriber(topic, String, lambda msg: self.grant(msg.data), queue_size=20, tcp_nodelay=True)

    def grant(self, holder: str) -> None:
        """Count as if the holder had just renewed: he did something else that shows he is there."""
        self._renewed_s[holder] = time.monotonic()

    def is_known(self, holder: str) -> bool:
        """Whether the holder ever renewed."""
        return holder in self._renewed_s

    def age_s(self, holder: str) -> float:
        """Time since the holder renewed [s]; infinite where it never did."""
        return time.monotonic() - self._renewed_s.get(holder, -math.inf)

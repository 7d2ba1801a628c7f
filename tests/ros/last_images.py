"""What a camera that died leaves under way: with each of its images, vslam renews the lease of the follower."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import rospy
from geometry_msgs.msg import PoseWithCovarianceStamped
from std_msgs.msg import String

from vsx_ros.navigation.lease import ImageLease
from vsx_ros.ros import topics

if TYPE_CHECKING:
    from conftest import Stack


_ENOUGH = 13  # renewals: the lease goes by so many
_STOP_S = 0.2  # from the end of the lease to standing wheels


class LastImages:
    """Listens from the time that the camera is well."""

    def __init__(self, stack: Stack) -> None:
        self._renewed_s: list[float] = []
        self._lease = ImageLease()
        self._stamps_ns: list[int] = []
        self._subscribers = [
            rospy.Subscriber(f"/{topics.FOLLOWER_LEASE}", String, self._on_renewal, tcp_nodelay=True),
            rospy.Subscriber(f"/{topics.POSE}", PoseWithCovarianceStamped, self._on_pose, tcp_nodelay=True),
        ]
        stack.wait(lambda: len(self._renewed_s) >= _ENOUGH and self._stamps_ns, "vslam to use images")

    def _on_renewal(self, msg: String) -> None:
        if msg.data == "vslam":
            self._renewed_s.append(time.monotonic())
            self._lease.see(time.monotonic_ns(), 0.0)

    def _on_pose(self, msg: PoseWithCovarianceStamped) -> None:
        self._stamps_ns.append(msg.header.stamp.to_nsec())

    def last_s(self, died_s: float, died_ns: int) -> float:
        """When the last of them reached the follower, on the clock of died_s. None was taken after the camera died at
        died_ns [ns, host's time]."""
        for subscriber in self._subscribers:
            subscriber.unregister()
        assert max(self._stamps_ns) <= died_ns, "a pose by an image that the camera cannot have taken"
        return max(died_s, *self._renewed_s)

    @property
    def stop_within_s(self) -> float:
        """After the last image: 0.5 s, more on a computer that uses fewer than six images a second (``lease.py``)."""
        return self._lease.length_s + _STOP_S

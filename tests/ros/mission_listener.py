"""What the explorer and the base tell about the operator."""

import json
from typing import Any

import rospy
from std_msgs.msg import String

from vsx_ros.exploration.decision import MissionState
from vsx_ros.ros import topics

RECOVERING, YIELDED = MissionState.RECOVERING.value, (MissionState.HELD.value, MissionState.USER_GOAL.value)


class MissionListener:
    """status, held: the newest. events: all, oldest first."""

    def __init__(self) -> None:
        self.status: dict[str, Any] = {}
        self.held: dict[str, Any] = {}
        self.events: list[dict[str, Any]] = []
        self._subscribers = [
            rospy.Subscriber(f"/{topics.EXPLORE_STATUS}", String, lambda msg: self.status.update(json.loads(msg.data))),
            rospy.Subscriber(f"/{topics.EXPLORE_EVENTS}", String, lambda msg: self.events.append(json.loads(msg.data))),
            rospy.Subscriber(f"/{topics.OPERATOR_HOLD}", String, lambda msg: self.held.update(json.loads(msg.data))),
        ]

    def blamed(self) -> list[str]:
        """Why views were blacklisted until the explorer chose its next drive after the operator; what happens on that
        one is its own affair. So is a camera that loses the map, after which the mission recovers."""
        reasons, yielded = [], False
        for event, after in zip(self.events, [*self.events[1:], {}], strict=True):
            yielded = yielded or event["state"] in YIELDED
            if yielded and event["state"] not in YIELDED and "driving" in event["reason"]:
                break
            if "blacklisted for" in event["reason"] and after.get("state") != RECOVERING:
                reasons.append(event["reason"])
        return reasons

    def close(self) -> None:
        for subscriber in self._subscribers:
            subscriber.unregister()

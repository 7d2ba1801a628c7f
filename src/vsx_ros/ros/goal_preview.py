"""Goals that are planned before anybody drives to them: the service move_base/preview_goal, and its texts."""

import json
import math
from typing import Any

import numpy as np
from std_msgs.msg import String

from vsx_ros.errors import InputError
from vsx_ros.geometry.se2 import SE2
from vsx_ros.limits import FAR_M
from vsx_ros.planning.path import Refusal, TimedPlan
from vsx_ros.robot import MAP_FRAME
from vsx_ros.ros import headers, topics
from vsx_ros.ros.callbacks import json_number, json_object, offer_text
from vsx_ros.ros.planning_thread import PlanningThread
from vsx_ros.ros.situation import LocalizationSubscriber

_LEAST_STEP_M, _POINTS = 0.05, 200  # of a path that is shown


def goal_pose(x: float, y: float, heading_rad: float | None, here: SE2) -> SE2:
    """The goal in the map; without a heading [rad], the robot looks there the way it came from here."""
    return SE2(x, y, math.atan2(y - here.y, x - here.x) if heading_rad is None else heading_rad)


def asked_goal(text: str, here: SE2) -> SE2:
    """The goal of a text in JSON: x, y [m], and heading_rad if it matters. Raises InputError for anything else."""
    tree = json_object(String(text), "x", "y")
    x, y = (json_number(tree, name, FAR_M, "m") for name in ("x", "y"))
    heading_rad = None if tree.get("heading_rad") is None else json_number(tree, "heading_rad", 2.0 * math.pi, "rad")
    return goal_pose(x, y, heading_rad, here)


def preview(goal: SE2, way: TimedPlan) -> dict[str, Any]:
    """goal: x, y [m], heading [rad]. points: x, y of the path [m], at most some hundred. length_m, seconds: of the
    drive."""
    path = way.plan.path
    samples = path.sample(max(_LEAST_STEP_M, path.length_m / _POINTS))
    points = samples[:: 1 + len(samples) // (2 * _POINTS), :2]
    shown = np.vstack([points, samples[-1:, :2]]).round(3).tolist()
    seconds = round(float(way.trajectory.times_s[-1]), 1)
    return {"goal": [goal.x, goal.y, goal.theta], "points": shown, "length_m": path.length_m, "seconds": seconds}


class GoalPreview:
    """Services: move_base/preview_goal (AddDiagnostics: JSON {"x": 1.0, "y": 2.0}; on success the message is JSON, as
    of ``preview``, else the reason)."""

    def __init__(self, planner: PlanningThread, where: LocalizationSubscriber) -> None:
        self._planner, self._where = planner, where
        offer_text(topics.PREVIEW_GOAL, self._preview)

    def _preview(self, text: str) -> str:
        here = self._where.at(headers.now_ns()).pose(MAP_FRAME)
        if here is None:
            raise InputError("the robot does not know yet where it is in the map; wait until the camera tracks")
        goal = asked_goal(text, here)
        way = self._planner.way(here, goal)
        if isinstance(way, Refusal):
            raise InputError(way.reason)
        return json.dumps(preview(goal, way))

"""A zone that is drawn on the live page across the way of the robot, and where the robot really is beside it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import rospy
from chromium import Chromium
from geometry_msgs.msg import PoseWithCovarianceStamped
from served_page import window_place
from waiting import PATIENCE_S, wait_for

from vsx_ros.config import Config
from vsx_ros.geometry.se2 import SE2
from vsx_ros.occupancy.zoned_grid import entered
from vsx_ros.occupancy.zones import Zone
from vsx_ros.ros import convert, topics
from vsx_ros.ros.emulated_base import BodyState

if TYPE_CHECKING:
    from conftest import Stack

_FROM_M, _AT_LEAST_M = 1.3, 0.9  # the zone's middle ahead of the base's, as it is begun and as it is saved
_STOP_M = 0.25  # in which the robot stops, with the time until it knows of the zone
_SQUARE_M = 0.25 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
_CELL_M, _BODY_M = Config().ground_map.resolution_m, Config().robot.radius_m
_KEPT = 2000  # newest true poses


class TrueOutline:
    """driven_m, entered: of the true body since ``keep_out_of``: its way, and its steps in the zone."""

    def __init__(self, stack: Stack) -> None:
        self._start_ns, self._states = stack.start_ns, [stack.plant.state]
        self._zone: list[Zone] = []
        self.driven_m, self.entered = 0.0, 0
        stack.watch_steps(self._watch)

    def keep_out_of(self, zone: Zone) -> None:
        """zone: in the map, which lies in the world as where the robot believes to be, and is, now."""
        believed = rospy.wait_for_message(f"/{topics.POSE}", PoseWithCovarianceStamped, timeout=PATIENCE_S)
        time_ns = believed.header.stamp.to_nsec() - self._start_ns
        true = min(list(self._states), key=lambda state: abs(state.time_ns - time_ns))
        assert abs(true.time_ns - time_ns) < 1e8, "the emulator's time is the host's"
        T_world_map = true.T_world_base @ convert.se2(believed.pose.pose).inverse()
        corners = (T_world_map @ np.array(zone.points)).tolist()
        self._zone = [zone._replace(points=tuple((x, y) for x, y in corners))]

    def end(self) -> None:
        """The zone is going."""
        self._zone = []

    def _watch(self, state: BodyState) -> None:
        if self._zone:
            self.driven_m += state.path_length_m - self._states[-1].path_length_m
            pose = state.T_world_base
            self.entered += bool(entered(self._zone, pose.x, pose.y, _BODY_M, _CELL_M))
        self._states = [*self._states[-_KEPT:], state]


def draw_across_the_plan(browser: Chromium, stack: Stack) -> bool:
    """By clicks on the open page, a square of half a metre ahead on the way that is driven. Whether there was such a
    way, and the time to draw it; a zone that came too late to stop before it is removed."""
    here = browser.evaluate("known.pose.slice(0, 2)")
    plan = np.array(browser.evaluate("known.plan")).reshape(-1, 2)
    away_m = np.hypot(*(plan - here).T)
    ahead = [k for k in range(len(plan) - 1) if k > away_m.argmin() and away_m[k] > _FROM_M]
    if not ahead:
        return False
    place, after = plan[ahead[0]].tolist(), plan[ahead[0] + 1].tolist()
    square = SE2(*place, float(np.arctan2(after[1] - place[1], after[0] - place[0]))) @ _SQUARE_M
    browser.click("#drawZone")
    for corner in square.tolist():
        for kind in ("Moved", "Pressed", "Released"):
            browser.mouse(kind, *window_place(browser, *corner))
    x, y, drawn = browser.evaluate("[...known.pose.slice(0, 2), draft.points.length]")
    if drawn != 4 or not stack.plant.moving or np.hypot(place[0] - x, place[1] - y) < _AT_LEAST_M:
        browser.key("Escape")
        return False
    browser.click("#saveZone")
    browser.wait("$('said').textContent.startsWith('Zone ') && draft === null")
    x, y = browser.evaluate("known.pose.slice(0, 2)")
    to_edge_m = np.hypot(place[0] - x, place[1] - y) + _SQUARE_M.min()
    if to_edge_m > _BODY_M + _STOP_M:
        return True
    browser.wait("known.zones.zones.length === 1")
    remove = "document.querySelector('#zones button')?.click(), known.zones.zones.length === 0"
    wait_for(lambda: browser.evaluate(remove), "the zone to be removed", pause_s=0.2)  # the button asks back
    return False

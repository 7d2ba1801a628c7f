"""The robot's trail, and what to try, step by step, when the camera is lost (the paper's robot stops there): back along
the trail, on to its place with most known landmarks in view, then to the sides, then once around on the spot. It never
drives over ground that was neither driven nor known."""

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from vsx_ros.config import Config
from vsx_ros.exploration.decision import Situation
from vsx_ros.exploration.utility import traversable_cells
from vsx_ros.exploration.view_selector import ViewSelector
from vsx_ros.geometry.se2 import SE2
from vsx_ros.occupancy.grid import OccupancyGrid

_TURN_RAD = 0.2  # between poses of the trail on a bend; spacing / _TURN_RAD converts radians to metres
SPOT_TURN = SE2(0.0, 0.0, math.pi / 4.0)  # If all arcs are blocked: a turning round body touches nothing new
_TRAIL_M = 5.0  # longest
_SAMPLES = 8  # number of checked places on the arc, every 5 cm
_ARCS, _TURNS = 4, round(2.0 * math.pi / SPOT_TURN.theta)  # turns: once around
_MOST_STEPS = 40  # back: for a robot that does not move, or whose steps are all cut short
_NEAR_M = 0.05  # a shorter rest of the way back is not worth a drive
_HOLD_NS, _AGAIN_NS = 1_000_000_000, 10_000_000_000  # tracked for the first, it is over; lost within the second, not


class Trail:
    """The driven ground, which is surely free, by odometry: poses at least spacing_m [m] or a turn on the spot apart,
    oldest first. Driving back along it shortens it."""

    def __init__(self, spacing_m: float) -> None:
        self._spacing_m = spacing_m
        self._capacity = max(2, int(_TRAIL_M / spacing_m))
        self.poses: list[SE2] = []
        self._epoch: int | None = None

    def enter_epoch(self, odom_epoch: int) -> bool:
        """Whether the epoch has changed; then the poses are not known any more, and are dropped."""
        other = self._epoch not in (None, odom_epoch)
        self._epoch = odom_epoch
        if other:
            self.clear()
        return other

    def behind(self, T_odom_base: SE2, odom_epoch: int) -> list[SE2]:
        """The poses relative to the base, at a pose of this epoch; none if the trail is of another one."""
        known = self._epoch in (None, odom_epoch)
        return [T_odom_base.inverse() @ pose for pose in self.poses] if known else []

    def clear(self) -> None:
        """The base was carried: the trail is not behind it any more."""
        self.poses.clear()

    def add(self, T_odom_base: SE2) -> None:
        """Append the pose when it is far enough from the last one."""
        last = self.poses[-1] if self.poses else None
        near = last is not None and last.distance_to(T_odom_base) < self._spacing_m
        if last is None or not near or abs(last.angle_to(T_odom_base)) >= _TURN_RAD:
            self.poses.append(T_odom_base)
            del self.poses[: -self._capacity]

    @property
    def length_m(self) -> float:
        """Length of the trail [m]."""
        return sum(a.distance_to(b) for a, b in pairwise(self.poses))

    @property
    def leads_away(self) -> bool:
        """Whether driving back along it moves the base; after turns on the spot it would only undo them."""
        return self.length_m > _NEAR_M

    def driven_back_to(self, T_odom_base: SE2) -> None:
        """Shorten the trail of a robot that backs along it to the robot's present pose."""
        poses, per_rad_m = self.poses, self._spacing_m / _TURN_RAD

        def off_m(pose: SE2) -> float:
            return pose.distance_to(T_odom_base) + per_rad_m * abs(pose.angle_to(T_odom_base))

        while len(poses) > 1 and off_m(poses[-2]) <= off_m(poses[-1]):
            poses.pop()

    def back(self, distance_m: float) -> SE2 | None:
        """The pose about distance_m [m] before the end. It is nearer where the robot changed between ahead and reverse
        or turned on the spot: a drive that cuts this corner would leave the trail. If the trail ends with a turn, the
        pose before the turn. None on a short trail."""
        if len(self.poses) < 2:
            return None
        at, back_m, before = len(self.poses) - 1, 0.0, 0
        while at > 0 and back_m < distance_m - 0.5 * self._spacing_m:
            step = self.poses[at - 1].inverse() @ self.poses[at]
            moved_m = step.distance_to(SE2())
            kind = 0 if moved_m < 0.5 * self._spacing_m else 1 if step.x > 0.0 else -1
            if at < len(self.poses) - 1 and kind != before:
                break
            before, back_m, at = kind, back_m + moved_m, at - 1
        return self.poses[at]


def escape_arc(
    grid: OccupancyGrid, T_map_base: SE2, radius_m: float, bend_rad_m: float, length_m: float, ahead: bool
) -> SE2 | None:
    """The pose, relative to the base, after an arc on which a body of radius_m [m] touches only known free ground.
    ahead: whether ahead is tried before back; left is tried before right. None when all four arcs are blocked."""
    room = traversable_cells(grid, radius_m)
    way = 1.0 if ahead else -1.0
    for sign, turn in ((way, 1.0), (-way, 1.0), (way, -1.0), (-way, -1.0)):
        steps = np.linspace(0.0, length_m, _SAMPLES)[1:]
        arc = [SE2.exp(float(sign * s), float(turn * s * bend_rad_m)) for s in steps]
        places = [T_map_base @ pose for pose in arc]
        cells = grid.cells(np.array([(place.x, place.y) for place in places]))
        if grid.contains(cells).all() and room[cells[:, 0], cells[:, 1]].all():
            return arc[-1]
    return None


class Recovery:
    """``next`` returns one small drive at a time; between two drives the camera has time to recognise a place."""

    def __init__(self, config: Config, views: ViewSelector) -> None:
        """views: of the same robot."""
        self._config, self._radius_m, self._views = config.exploration, config.robot.radius_m, views
        self._bend_rad_m = config.planner.phi_rad_m  # of the arcs to the sides
        self._over_ns, self._is_displaced = -_AGAIN_NS, False
        self.owes_a_step = False
        """Whether to continue although the camera is tracked."""
        self.is_on_trail = True
        """Whether it drives back along the trail; else what it drives belongs to the trail, too."""
        self.begin(0)

    def observe(self, situation: Situation, trail: Trail) -> None:
        """After being lifted the robot may stand anywhere: neither trail nor map show what is around it until the
        camera knows the place."""
        if situation.lifted:
            trail.clear()
        self._is_displaced = situation.lifted or (self._is_displaced and not situation.slam_state.tracked)

    def begin(self, now_ns: int) -> None:
        """The camera is lost. If it was found shortly before, continue with at least one step; else start afresh."""
        self._tracked_since_ns: int | None = None
        self.is_on_trail = True
        self.owes_a_step = now_ns < self._over_ns + _AGAIN_NS
        if not self.owes_a_step:
            self._steps = self._arcs = self._turns = 0
            self._lost_at_m: float | None = None
            self._best_at_m: float | None = None

    def is_over(self, now_ns: int, tracked: bool) -> bool:
        """Whether the camera of a standing robot has been tracked for a second: with little in view, tracking comes and
        goes."""
        if self.owes_a_step or not tracked:
            self._tracked_since_ns = None
            return False
        if self._tracked_since_ns is None:
            self._tracked_since_ns = now_ns
        if now_ns < self._tracked_since_ns + _HOLD_NS:
            return False
        self._over_ns = now_ns
        return True

    def next(self, trail: Trail, situation: Situation) -> tuple[SE2, str] | None:
        """The next pose of the base in the frame odom, and why; None when nothing is left to try."""
        self.owes_a_step, self._tracked_since_ns = False, None
        situation = situation._replace(T_map_base=None) if self._is_displaced else situation
        step_m, left_m = self._config.backtrack_step_m, trail.length_m
        if self._lost_at_m is None:
            self._lost_at_m = left_m
        self._steps += 1
        if self._steps > _MOST_STEPS or not self.is_on_trail:
            return self._look_elsewhere(situation)
        backed_m = self._lost_at_m - left_m
        if backed_m < self._config.backtrack_max_m:
            goal = trail.back(step_m)
            if goal is not None:
                return goal, f"lost: back along the trail, after {max(backed_m, 0.0):.1f} m of it"
        if self._best_at_m is None:
            self._best_at_m = left_m - self._way_to_best(trail.poses, situation)
        if left_m > self._best_at_m + _NEAR_M:
            goal = trail.back(min(step_m, left_m - self._best_at_m))
            if goal is not None:
                return goal, "lost: on to the place on the trail that shows most known landmarks"
        return self._look_elsewhere(situation)

    def _way_to_best(self, trail: Sequence[SE2], situation: Situation) -> float:
        """Distance back [m] to the place on the trail with most known landmarks in view; 0 at its end or without a
        map."""
        if situation.grid is None or situation.T_map_base is None or situation.T_odom_base is None or not trail:
            return 0.0
        T_map_odom = situation.T_map_base @ situation.T_odom_base.inverse()
        poses = np.array([(T_map_odom @ pose).as_array() for pose in trail])
        counts = self._views.count_landmarks(situation.grid, poses, situation.landmarks_world)[::-1]
        back = int(counts.argmax())
        return sum(a.distance_to(b) for a, b in zip(trail[::-1][:back], trail[::-1][1:]))

    def _look_elsewhere(self, situation: Situation) -> tuple[SE2, str] | None:
        """Over free ground to the sides, then around on the spot: a round body touches nothing new, and there is no
        tracking that could be lost."""
        assert situation.T_odom_base is not None
        self.is_on_trail = False
        if self._arcs < _ARCS and situation.grid is not None and situation.T_map_base is not None:
            self._arcs += 1
            place, ahead, step_m = situation.T_map_base, self._arcs % 2 == 0, self._config.backtrack_step_m
            arc = escape_arc(situation.grid, place, self._radius_m, self._bend_rad_m, step_m, ahead)
            if arc is not None:
                return situation.T_odom_base @ arc, "lost: turning to look elsewhere"
        if self._turns == _TURNS:
            return None
        self._turns += 1
        return situation.T_odom_base @ SPOT_TURN, f"lost: looking around on the spot ({self._turns} of {_TURNS})"

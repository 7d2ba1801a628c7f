"""What one segment of the paper's method can reach, in closed form."""

import math
from dataclasses import dataclass

from vsx_ros.errors import PlanningError
from vsx_ros.geometry.se2 import SE2, wrap_angle

_EXACT = 1e-9


def check_question(start: SE2, goal: SE2, phi: float) -> None:
    """Raise PlanningError for poses that are not finite or a phi that is not positive."""
    for name, pose in (("start", start), ("goal", goal)):
        if not pose.is_finite():
            raise PlanningError(f"{name} pose ({pose.x}, {pose.y}, {pose.theta}) is not finite; give three numbers")
    if not (math.isfinite(phi) and phi > 0.0):
        raise PlanningError(f"phi = {phi} rad/m: the bound on the change of view must be positive and finite")


@dataclass(frozen=True, slots=True)
class Feasibility:
    """Verdict of the closed form; margin_m: how far inside (positive) or outside the cone the goal lies."""

    ok: bool
    margin_m: float
    reason: str


def feasible(start: SE2, goal: SE2, phi: float, reverse: bool = False) -> Feasibility:
    """Whether one segment in one direction with monotone heading can join the poses: the paper's reach, exactly.

    Eq. (7)-(8) make the heading monotone and (11) forbids reversing, so the segment is the minimal arc
    E = (sin|d|, sign(d) (1 - cos d)) / phi plus a (1, 0) + b (cos d, sin d) with a, b >= 0 for the heading change d:
    the goal must lie in the cone of start and goal direction behind the arc. Raises PlanningError as ``connect``.
    """
    check_question(start, goal, phi)
    relative = start.inverse() @ goal
    x, y, d = relative.x, relative.y, wrap_angle(relative.theta)
    if reverse:  # the mirrored problem: x -> -x, theta -> -theta
        x, d = -x, -d
    way = "in reverse" if reverse else "forwards"
    half_circle = math.pi - abs(d) < _EXACT  # then either way round will do
    sign = 1.0 if (y if half_circle else d) >= 0.0 else -1.0
    gx = x - math.sin(abs(d)) / phi
    gy = sign * y - (1.0 - math.cos(d)) / phi
    angle = abs(d)
    if math.sin(angle) < 1e-9:
        ok = abs(gy) <= _EXACT and gx >= -_EXACT if angle < 1.0 else gy >= -_EXACT
        margin = -math.hypot(min(gx, 0.0), gy) if angle < 1.0 else gy
        words = "straight line" if angle < 1.0 else "half circle"
        return Feasibility(ok, 0.0 if ok and angle < 1.0 else margin, f"{words} {way}: off by {abs(margin):.3f} m")
    b = gy / math.sin(angle)
    a = gx - b * math.cos(angle)
    margin = min(a, b) * math.sin(angle)
    if min(a, b) >= -_EXACT:
        return Feasibility(True, margin, f"{math.degrees(angle):.1f} deg {way}, {margin:.3f} m inside the cone")
    which = "behind the arc along the start direction" if a < b else "short of the arc along the goal direction"
    return Feasibility(
        False,
        margin,
        f"a turn of {math.degrees(d):.1f} deg {way} at phi {phi:g} rad/m needs more room: "
        f"the goal lies {-margin:.3f} m outside the reachable cone ({which})",
    )

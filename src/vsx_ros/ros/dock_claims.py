"""Who else wants the base while it docks or charges."""

import rospy

from vsx_ros.navigation.docking import Docking
from vsx_ros.navigation.docking_state import DockingState
from vsx_ros.navigation.energy import ChargeKeeper
from vsx_ros.robot import OperatorHold
from vsx_ros.ros.situation import hear_user_goals


class DockClaims:
    """Held wheels and goals of others than dock and exploration end a docking. A base on its dock leaves it first; a
    goal waits meanwhile (``DockHold``). Subscribers: move_base/{goal,status}."""

    def __init__(self, keeper: ChargeKeeper) -> None:
        self._keeper, self._heeded = keeper, ""
        self._goals = hear_user_goals(rospy.get_name(), rospy.resolve_name("explore"))

    def heed(self, now_ns: int, docking: Docking, hold: OperatorHold | None, docked: bool) -> None:
        """docked: whether the contacts touch. A goal counts once, when it comes: the next docking is newer than it. If
        held wheels ended the way off the dock, it counts again. While a contact flickers it has not come yet."""
        goal, flickers = self._goals.current, docking.state is DockingState.DOCKED and not docked
        if hold is not None:
            self._heeded = "" if docking.state is DockingState.UNDOCKING else self._heeded
            docking.cancel(now_ns, hold.words())
        elif goal is not None and goal.identity != self._heeded and not flickers:
            self._heeded = goal.identity
            if docking.state.rests and not docked:
                return
            self._keeper.put_off(now_ns)
            if docking.state is DockingState.UNDOCKING:
                return
            docking.cancel(now_ns, f"{goal.client} has sent a goal to move_base")
            if docked:
                docking.undock(now_ns)

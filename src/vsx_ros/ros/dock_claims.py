"""Who else wants the base while it docks, charges, or stands on its dock."""

import rospy

from vsx_ros.navigation.docking import Docking
from vsx_ros.navigation.docking_state import DockingState
from vsx_ros.navigation.energy import ChargeKeeper
from vsx_ros.robot import OperatorHold
from vsx_ros.ros.situation import hear_user_goals


def stands_on_dock(docking: Docking, docked: bool) -> bool:
    """Whether the base rests on a dock that it can leave, and does not charge there by ``docking``: it was there when
    the node began, was put there, or was kept from leaving. docked: whether the contacts touch."""
    return docked and docking.state.rests and docking.state is not DockingState.DOCKED and not docking.in_vain


class DockClaims:
    """Held wheels and goals of others than dock and exploration end a docking. A base on its dock leaves it first; a
    goal waits meanwhile (``DockHold``). Subscribers: move_base/{goal,status}."""

    def __init__(self, keeper: ChargeKeeper) -> None:
        self._keeper, self._heeded = keeper, ""
        self._goals = hear_user_goals(rospy.get_name(), rospy.resolve_name("explore"))

    def heed(self, now_ns: int, docking: Docking, hold: OperatorHold | None, docked: bool) -> None:
        """docked: whether the contacts touch. A goal counts once, when it comes: the next docking is newer than it. If
        the wheels were held on the way off the dock, or meanwhile put the base there, it counts again. While a contact
        flickers it has not come yet."""
        goal, flickers = self._goals.current, docking.state is DockingState.DOCKED and not docked
        if hold is not None:
            again = docking.state is DockingState.UNDOCKING or stands_on_dock(docking, docked)
            self._heeded = "" if again else self._heeded
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

    def holds(self, docking: Docking, docked: bool) -> bool:
        """Whether nobody else may move the base: ``docking`` does, or the next goal is to leave the dock first. One
        that has counted is not held again: it would wait for ever."""
        goal = self._goals.current
        has_counted = goal is not None and goal.identity == self._heeded
        return docking.state.holds or (stands_on_dock(docking, docked) and not has_counted)

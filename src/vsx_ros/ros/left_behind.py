"""What killed processes leave at the master: names of nodes that are gone, and a ROS time that stands."""

from collections.abc import Iterable

import rosgraph

from vsx_ros.ros import topics
from vsx_ros.ros.calls import answers_at

_SIMULATED = "/use_sim_time"


def living(names: Iterable[str]) -> list[str]:
    """Those of these nodes that still listen. names: full ones. Raises OSError when no master answers."""
    master, found = rosgraph.Master("/vsx"), []
    for name in names:
        try:
            address = master.lookupNode(name)
        except rosgraph.MasterException:
            continue
        if answers_at(address):
            found.append(name)
    return found


def end_standing_time() -> str:
    """What is said before nodes start at a master with /use_sim_time and without a living publisher of /clock, where
    they would wait at time zero; else an empty text. Of a publisher that is gone, a killed replay, the parameter is
    deleted; without any, somebody may be about to play a bag."""
    master = rosgraph.Master("/vsx")
    if not rosgraph.is_master_online() or not master.hasParam(_SIMULATED) or master.getParam(_SIMULATED) is not True:
        return ""
    publishers = dict(master.getSystemState()[0]).get(topics.CLOCK, [])
    if living(publishers):
        return ""
    if not publishers:
        return (
            f"ROS time stands: {_SIMULATED} is set and nobody publishes {topics.CLOCK}; 'rosparam delete {_SIMULATED}' "
            "and start again, or play a bag with --clock"
        )
    master.deleteParam(_SIMULATED)
    return f"ROS time stood: {publishers[0]}, which has set {_SIMULATED}, is gone; the parameter is deleted"

"""Goals of users in the frames of their tools are planned in the map: the nodes stop before a wall that it shows."""

import pytest

pytest.importorskip("rospy")

import numpy as np
from driving import CONFIG, open_floor
from move_base_msgs.msg import MoveBaseGoal
from wires import BEGIN_NS, OverError, Wires

from vsx_ros.geometry.se2 import SE2
from vsx_ros.occupancy.grid import OCCUPIED, OccupancyGrid
from vsx_ros.ros import convert, topics
from vsx_ros.ros.nodes.follower import FollowerNode
from vsx_ros.ros.nodes.move_base import MoveBaseNode

pytestmark = pytest.mark.changes_rospy

AHEAD = SE2(1.4, 0.0, 0.0)


def walled() -> OccupancyGrid:
    """Half a metre ahead a wall from side to side."""
    grid = open_floor()
    row, column = grid.cells(np.array([[0.5, 0.0]]))[0]
    assert grid.data[row, column] == 0
    data = grid.data.copy()
    data[:, column : column + 10] = OCCUPIED
    return OccupancyGrid(data, grid.resolution, grid.origin_x, grid.origin_y)


def driven(frame: str, grid: OccupancyGrid | None, monkeypatch: pytest.MonkeyPatch) -> tuple[float, tuple[str, str]]:
    """How far a base drove for this goal [m], and how that ended. grid: the map; None: the camera tracks nothing."""
    wires = Wires(monkeypatch)
    FollowerNode(CONFIG)
    MoveBaseNode(CONFIG)
    wires.camera = grid is not None
    wires.go_on(0.5)
    if grid is not None:
        wires.say(topics.MAP, convert.grid_msg(grid, topics.MAP_FRAME, wires.base.now_ns))
    wires.server.send(MoveBaseGoal(convert.pose_stamped(frame, wires.base.now_ns, AHEAD)))
    wires.until_ns = BEGIN_NS + 25 * 10**9
    with pytest.raises(OverError):
        wires.server.run()
    [end] = wires.server.ended
    return wires.base.pose.x, end


@pytest.mark.parametrize("frame", [topics.MAP_FRAME, topics.ODOM_FRAME, topics.BODY_FRAME, topics.BASE_FRAME])
def test_no_goal_leads_through_a_known_wall(frame: str, monkeypatch: pytest.MonkeyPatch) -> None:
    way_m, (end, _) = driven(frame, walled(), monkeypatch)
    assert end == "aborted"
    assert way_m < 0.05


@pytest.mark.parametrize("frame", [topics.ODOM_FRAME, topics.BODY_FRAME])
def test_over_open_floor_they_are_driven_to(frame: str, monkeypatch: pytest.MonkeyPatch) -> None:
    way_m, (end, _) = driven(frame, open_floor(), monkeypatch)
    assert end == "succeeded"
    assert way_m == pytest.approx(AHEAD.x, abs=0.1)


@pytest.mark.parametrize("frame", [topics.ODOM_FRAME, topics.BODY_FRAME])
def test_without_a_map_they_are_refused_in_words(frame: str, monkeypatch: pytest.MonkeyPatch) -> None:
    way_m, (end, reason) = driven(frame, None, monkeypatch)
    assert (way_m, end) == (0.0, "aborted")
    assert f"a goal in frame {frame!r} is planned in the map, and the robot does not know yet where it is" in reason


def test_a_client_that_asks_for_it_is_driven_without_the_map(monkeypatch: pytest.MonkeyPatch) -> None:
    way_m, (end, _) = driven(topics.BLIND_FRAME, walled(), monkeypatch)
    assert end == "succeeded"
    assert way_m == pytest.approx(AHEAD.x, abs=0.1)

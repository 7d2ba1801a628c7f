"""What is measured in lock-step is what drives: the same scenes through the nodes and through the lock-step navigator
end alike, with the same speeds and stops."""

import numpy as np
import pytest

pytest.importorskip("rospy")

from driving import CONFIG, Scene, lock_step, open_floor, with_post
from move_base_msgs.msg import MoveBaseGoal
from wires import BEGIN_NS, OverError, Wires

from vsx_ros.geometry.se2 import SE2
from vsx_ros.ros import convert, topics
from vsx_ros.ros.nodes.follower import FollowerNode
from vsx_ros.ros.nodes.move_base import MoveBaseNode

pytestmark = pytest.mark.changes_rospy

AHEAD, ASIDE = SE2(3.0, 0.0, 0.0), SE2(1.0, -1.5, -1.5)
OPEN = (0.0, open_floor())
SCENES = {
    "a goal": Scene(((0.2, AHEAD),)),
    "a post half a metre ahead": Scene(((0.2, AHEAD),), (OPEN, (4.0, with_post(1.38, 0.0)))),
    "a post far ahead": Scene(((0.2, AHEAD),), (OPEN, (3.0, with_post(1.8, 0.0)))),
    "tracking lost for two seconds": Scene(((0.2, AHEAD),), lost=(4.0, 6.0)),
    "cancelled": Scene(((0.2, AHEAD),), cancelled=4.0),
    "another goal while driving": Scene(((0.2, AHEAD), (4.0, ASIDE))),
}
SECONDS = 40.0


def live(scene: Scene, seconds: float, monkeypatch: pytest.MonkeyPatch) -> tuple[np.ndarray, list[tuple[str, str]]]:
    """The rows of the base under the nodes, and how the goals ended."""
    wires = Wires(monkeypatch)
    FollowerNode(CONFIG)
    MoveBaseNode(CONFIG)
    goals, maps, cancelled = list(scene.goals), list(scene.maps), [scene.cancelled]

    def happen() -> None:
        now_s = 1e-9 * (wires.base.now_ns - BEGIN_NS)
        wires.state = scene.state(now_s)
        while maps and maps[0][0] <= now_s:
            wires.say(topics.MAP, convert.grid_msg(maps.pop(0)[1], topics.MAP_FRAME, wires.base.now_ns))
        while goals and goals[0][0] <= now_s:
            pose = convert.pose_stamped(topics.MAP_FRAME, wires.base.now_ns, goals.pop(0)[1])
            wires.server.send(MoveBaseGoal(pose))
        while cancelled and cancelled[0] <= now_s:
            cancelled.pop()
            wires.server.cancel()

    wires.at_each_step, wires.until_ns = happen, BEGIN_NS + round(1e9 * seconds)
    with pytest.raises(OverError):
        wires.server.run()
    rows = np.array(wires.base.rows)
    rows[:, 0] -= 1e-9 * BEGIN_NS
    return rows, wires.server.ended


def stops(rows: np.ndarray) -> np.ndarray:
    """When [s] and where (x, y) [m] the base came to rest after it had driven."""
    fast, found = False, []
    for row in rows:
        if abs(row[3]) > 0.1:
            fast = True
        elif fast and abs(row[3]) < 0.005:
            fast = False
            found.append(row[:3])
    return np.array(found).reshape(-1, 3)


def speed_at(rows: np.ndarray, times: np.ndarray) -> np.ndarray:
    return np.interp(times, rows[:, 0], rows[:, 3])


@pytest.mark.parametrize("name", SCENES)
def test_nodes_and_lock_step_drive_alike(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = SCENES[name]
    fast, run = lock_step(scene, SECONDS)
    slow, ended = live(scene, SECONDS, monkeypatch)
    expected = {"succeeded": "succeeded", "aborted": "preempted"}[run.navigator.state.value]
    assert ended[-1][0] == expected, ended
    at_fast, at_slow = stops(fast)[0], stops(slow)[0]
    assert abs(at_fast[0] - at_slow[0]) < 0.3
    assert np.hypot(*(at_fast[1:] - at_slow[1:])) < 0.05
    assert np.hypot(*(fast[-1, 1:3] - slow[-1, 1:3])) < 0.05
    times = np.arange(0.0, min(at_fast[0], at_slow[0]), 0.05)
    shifts = np.arange(-0.3, 0.31, 0.05)
    apart = [np.abs(speed_at(fast, times) - speed_at(slow, times + shift)).mean() for shift in shifts]
    assert min(apart) < 0.01, "mean difference of the speeds until the first stop [m/s]"


def test_what_comes_to_light_half_a_metre_ahead_is_not_touched_by_the_nodes(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = SCENES["a post half a metre ahead"]
    rows, _ = live(scene, 10.0, monkeypatch)
    stop = stops(rows)[0]
    before = rows[rows[:, 0] < stop[0], 1]
    at = rows[rows[:, 0] <= scene.maps[1][0]][-1]
    grid = scene.maps[1][1]
    post_x = float(grid.centres(np.argwhere(grid.data))[:, 0].min()) - 0.5 * grid.resolution
    assert post_x - at[1] < 0.5
    assert at[3] > 0.29, "at full speed"
    assert post_x - before.max() - CONFIG.robot.radius_m > 0.1

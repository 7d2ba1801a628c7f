"""Messages become what the page draws; messages that lie are refused by name."""

import base64
import json
import math
import threading
from collections.abc import Callable
from typing import Any

import pytest

pytest.importorskip("rospy")

import cv2
import numpy as np
from geometry_msgs.msg import Point, PoseArray
from std_msgs.msg import String
from visualization_msgs.msg import Marker, MarkerArray
from waiting import wait_for

from vsx_ros.errors import InputError
from vsx_ros.exploration.utility import View
from vsx_ros.geometry.mount import mount_pose
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3
from vsx_ros.occupancy.grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from vsx_ros.occupancy.unknown_ground import Frontier
from vsx_ros.robot import Frame
from vsx_ros.ros import convert, topics
from vsx_ros.ros.callbacks import json_object
from vsx_ros.ros.dashboard import feed
from vsx_ros.ros.mission_output import frontier_markers
from vsx_ros.ros.slam_messages import drawn
from vsx_ros.slam.snapshot import TrackedFeatures


def grid() -> OccupancyGrid:
    cells = np.full((10, 20), UNKNOWN, np.int8)
    cells[2:5, 4:10] = FREE
    cells[2, 4] = OCCUPIED
    return OccupancyGrid(cells, 0.5, -3.0, 1.0)


def test_the_map_is_cut_to_what_is_known_and_stays_in_place() -> None:
    told = feed.grid(convert.grid_msg(grid(), "map", 1))
    assert (told["x"], told["y"], told["resolution"]) == (-3.0 + 4 * 0.5, 1.0 + 2 * 0.5, 0.5)
    png = cv2.imdecode(np.frombuffer(base64.b64decode(told["png"]), np.uint8), cv2.IMREAD_UNCHANGED)
    assert png.shape == (3, 6, 4)
    colours, counts = np.unique(png.reshape(-1, 4), axis=0, return_counts=True)
    assert sorted(counts) == [1, 17]
    assert (png[2, 0] == colours[np.argmin(counts)]).all()  # the lowest row of the map is the last of the picture


def test_a_map_without_knowledge_is_one_transparent_pixel() -> None:
    nothing = OccupancyGrid(np.full((4, 4), UNKNOWN, np.int8), 0.1, 0.0, 0.0)
    told = feed.grid(convert.grid_msg(nothing, "map", 1))
    png = cv2.imdecode(np.frombuffer(base64.b64decode(told["png"]), np.uint8), cv2.IMREAD_UNCHANGED)
    assert png.shape == (1, 1, 4)
    assert png[0, 0, 3] == 0


@pytest.mark.parametrize("heading", [-2.5, 0.0, 1.0, 3.0])
def test_keyframes_look_where_their_camera_looks(heading: float) -> None:
    T_world_cam = SE3.from_se2(SE2(1.0, 2.0, heading)) @ mount_pose(0.0, 0.0, 0.5, 0.2)
    [[x, y, looks]] = feed.keyframes(PoseArray(poses=[convert.pose_msg(T_world_cam)]))
    assert (x, y) == (1.0, 2.0)
    assert math.cos(looks - heading) == pytest.approx(1.0, abs=1e-4)
    assert feed.keyframes(PoseArray()) == []


def test_planes_are_their_corners_from_above() -> None:
    wall = [Point(x, 2.0, z) for x, z in ((0, 0), (3, 0), (3, 2), (0, 0), (3, 2), (0, 2))]
    told = feed.planes(MarkerArray([Marker(action=Marker.DELETEALL), Marker(type=Marker.TRIANGLE_LIST, points=wall)]))
    assert told == [[[0, 2], [3, 2], [3, 2], [0, 2]]]  # a line, there and back


def test_frontiers_come_with_their_utility() -> None:
    border = Frontier(np.array([[2, 9], [3, 9]]), np.zeros(2), 1.0)
    views = [View(SE2(1.0, 2.0, 0.0), 4.0, 2.0, 30, 0.5), View(SE2(0.0, 0.0, 0.0), 1.0, 4.0, 30, 0.25)]
    told = feed.frontiers(frontier_markers(grid(), [border], views, 1, 2.0))
    assert told["borders"] == [[[1.75, 2.25], [1.75, 2.75]]]
    assert [view["utility"] for view in told["views"]] == [0.5, 0.25]
    assert told["views"][0]["text"] == "v 4.0 m2, d 4.0 m, landmarks x 0.50, U 0.50"


def test_a_long_plan_is_thinned_and_keeps_its_ends() -> None:
    poses = [SE2(0.01 * k, 0.0, 0.0) for k in range(1001)]
    told = feed.plan(convert.path_msg("map", 1, poses))
    assert len(told) < 250
    assert (told[0], told[-1]) == ([0.0, 0.0], [10.0, 0.0])
    assert feed.plan(convert.path_msg("odom", 1, poses)) == []


@pytest.mark.parametrize("count", [0, 1, 2, 1999, 2000, 50_000])
def test_the_way_is_thinned_and_ends_where_the_robot_is(count: int) -> None:
    told = feed.way(convert.path_msg("map", 1, [SE2(0.05 * k, 0.0, 0.0) for k in range(count)]))
    assert min(count, 1000) <= len(told) <= 2001
    assert told[:1] + told[-1:] == [[round(0.05 * k, 2), 0.0] for k in (0, count - 1) if count]


def test_the_way_is_broken_where_the_robot_was_carried() -> None:
    pieces = [0.0, 0.1], [3.0], [5.0, 5.4]
    told = feed.way(convert.path_msg("map", 1, [SE2(x, 1.0, 0.0) for piece in pieces for x in piece]))
    assert told == [[0.0, 1.0], [0.1, 1.0], None, [3.0, 1.0], None, [5.0, 1.0], [5.4, 1.0]]


def test_a_page_that_is_opened_late_gets_the_way_so_far(monkeypatch: pytest.MonkeyPatch) -> None:
    heard: dict[str, Callable[[Any], None]] = {}
    board, over = feed.Board(), threading.Event()
    monkeypatch.setattr(feed, "subscribe", lambda topic, kind, act, **options: heard.setdefault(topic, act))
    monkeypatch.setattr(feed.rospy, "is_shutdown", over.is_set)
    feed.Feed(board).viewers(1)
    wait_for(lambda: topics.PLAN_MS in heard and f"{topics.STATS}/latency_ms" in heard, "the topics")
    over.set()
    heard[topics.SLAM_PATH](convert.path_msg("map", 1, [SE2(0.0, 0.0, 0.0), SE2(0.3, 0.2, 1.0)]))  # it is latched
    ways = [json.loads(note.text) for note in board.newer_than(0, 0.0) if note.subject == "way"]
    assert ways == [[[0, 0], [0.3, 0.2]]]


@pytest.mark.parametrize("data", ["", "{", "[1]", "null", "3", '{"state": "mapping"}', "[" * 10_000])
def test_status_that_is_no_object_is_refused(data: str) -> None:
    with pytest.raises(InputError, match="JSON"):
        json_object(String(data), "state", "reason")


def test_numbers_that_are_not_finite_are_refused() -> None:
    assert json.loads(feed.text({"a": [1, 2.5]})) == {"a": [1, 2.5]}
    with pytest.raises(InputError, match="finite"):
        feed.text({"tracked_ratio": math.nan})


def test_found_points_are_green_circles_and_missed_ones_red_crosses() -> None:
    dark = np.zeros((60, 80), np.uint8)
    picture = drawn(Frame(1, dark), TrackedFeatures(np.array([[20.2, 30.4]]), np.array([[60.0, 10.0], [-50.0, 900.0]])))
    assert picture.shape == (60, 80, 3)
    blue, green, red = picture[30, 24]
    assert green > max(blue, red)
    blue, green, red = picture[10, 60]
    assert red > max(blue, green)
    assert not picture[30, 20].any()  # the point itself stays visible
    assert not drawn(Frame(1, dark), None).any()

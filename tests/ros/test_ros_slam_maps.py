"""What rviz and other people's navigation are shown of the dense map."""

import math
import time
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("rospy")

from sensor_msgs.msg import LaserScan

from vsx_ros.config import Config
from vsx_ros.control.localization import LocalizationState
from vsx_ros.dense.densify import UPDATE_EVERY_S
from vsx_ros.dense.planes import Plane, PlaneKind
from vsx_ros.geometry.se2 import SE2
from vsx_ros.kernels.dense.plane_fits import in_plane_axes
from vsx_ros.occupancy.grid import OCCUPIED, OccupancyGrid
from vsx_ros.robot import Odometry
from vsx_ros.ros import headers, slam_maps, topics
from vsx_ros.ros.slam_clock import SlamClock
from vsx_ros.ros.slam_maps import DenseMapping, plane_markers, scan_msg

NORMAL = np.array([-1.0, 0.0, 0.0])


def test_a_plane_is_a_rectangle_as_large_as_its_extent_after_all_former_ones_are_wiped_away() -> None:
    extent = np.array([-1.0, 2.0, 0.0, 0.5])
    axes, rows = in_plane_axes(NORMAL), np.zeros(0, np.int64)
    plane = Plane(7, NORMAL, -2.0, np.eye(3), PlaneKind.WALL, axes, extent, rows)
    clear, marker = plane_markers((plane,), "map", 5).markers
    assert clear.action == clear.DELETEALL
    assert (marker.id, marker.header.frame_id, len(marker.points)) == (7, "map", 6)
    corners = np.array([[p.x, p.y, p.z] for p in marker.points])
    assert corners[:, 0] == pytest.approx(2.0)
    assert np.ptp(corners, axis=0) == pytest.approx([0.0, 3.0, 0.5])
    assert len(np.unique(corners, axis=0)) == 4


def test_the_scan_has_a_beam_for_each_bearing_from_the_base() -> None:
    data = np.zeros((80, 80), np.int8)
    data[:, 60] = OCCUPIED
    scan = scan_msg(OccupancyGrid(data, 0.05, -2.0, -2.0), SE2(0.0, 0.0, math.pi / 2), 4.5, 9)
    assert scan.header.frame_id == topics.BASE_FRAME
    assert scan.header.stamp.to_nsec() == 9
    beams = round((scan.angle_max - scan.angle_min) / scan.angle_increment) + 1
    assert beams == len(scan.ranges) == 720
    assert scan.ranges[540] == pytest.approx(1.025, abs=0.01)
    assert math.isinf(scan.ranges[180])


@pytest.mark.parametrize("T_map_base", [None, SE2(1.0, 0.5, 0.2)])
def test_the_scan_has_the_stamp_of_the_place_that_it_is_made_at(
    T_map_base: SE2 | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Making the maps takes long, and the base drives on meanwhile."""
    scans: list[LaserScan] = []
    listened = SimpleNamespace(get_num_connections=lambda: 1, publish=scans.append)
    silent = SimpleNamespace(get_num_connections=lambda: 0)
    monkeypatch.setattr(slam_maps.rospy, "Publisher", lambda name, *_, **__: listened if name == "scan" else silent)
    monkeypatch.setattr(headers, "now_ns", lambda: 9_000_000_000)
    grid = OccupancyGrid(np.zeros((80, 80), np.int8), 0.05, -2.0, -2.0)
    where = LocalizationState(T_map_base, odometry=Odometry(7_600_000_000, SE2()))
    session = SimpleNamespace(where=where, ground=SimpleNamespace(start=SE2()))
    DenseMapping(Config(), SlamClock()).publish(SimpleNamespace(), grid, session)  # type: ignore[arg-type]  # only these are asked
    assert [scan.header.stamp.to_nsec() for scan in scans] == [7_600_000_000]


@pytest.mark.parametrize(("keyframes", "calls_each"), [(10, 1), (800, 1), (1600, 2), (4000, 5)])
def test_a_map_of_a_building_is_densified_less_often(
    keyframes: int, calls_each: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    now_s, jitter = [1000.0], np.random.default_rng(1)
    monkeypatch.setattr(slam_maps.rospy, "Publisher", lambda *_, **__: None)
    monkeypatch.setattr(time, "monotonic", lambda: now_s[0] + jitter.uniform(-0.1, 0.1))
    updates: list[int] = []

    def update(_: object) -> tuple[object, None]:
        updates.append(1)
        return SimpleNamespace(is_due=lambda _: True), None

    dense = DenseMapping(Config(), SlamClock())
    dense._process = SimpleNamespace(update=update)  # type: ignore[assignment]  # only update is asked
    seen = SimpleNamespace(keyframe_ids=np.arange(keyframes))  # only ids are asked
    for _ in range(60):
        dense.refresh(lambda: seen)
        now_s[0] += UPDATE_EVERY_S
    assert len(updates) == 60 // calls_each

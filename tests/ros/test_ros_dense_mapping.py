"""What rviz and other people's navigation are shown of the dense map."""

from __future__ import annotations

import math

import numpy as np
import pytest

pytest.importorskip("rospy")

from vsx_ros.dense.planes import Plane, PlaneKind, in_plane_axes
from vsx_ros.geometry.se2 import SE2
from vsx_ros.occupancy.grid import OCCUPIED, OccupancyGrid
from vsx_ros.ros import topics
from vsx_ros.ros.dense_mapping import plane_markers, scan_msg

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

"""The line that tells how a live run is going names what it waits for."""

from types import SimpleNamespace

import pytest

pytest.importorskip("rospy")

from vsx_ros.ros.run import told_now


def monitor(status):
    return SimpleNamespace(stats={}, status=status, grid=None, slam_state="NOT_INITIALISED", distance_m=0.0)


@pytest.mark.parametrize(
    ("status", "missing", "told"),
    [
        ({}, {}, "waiting for the nodes"),
        ({}, {"camera": "no such port"}, "waiting for camera"),
        ({}, {"camera": "no such port", "mobile_base": "silent"}, "waiting for camera and mobile_base"),
        ({"reason": "coming to rest"}, {"camera": "no such port"}, "coming to rest"),
    ],
)
def test_the_line_begins_with_the_reason_or_with_what_is_missing(status, missing, told):
    line = told_now(monitor(status), None, 3.0, 60.0, missing)
    assert line == f"starting: {told} | 0.0 m2 known | 0.0 m | 3/60 s"


def test_what_the_status_tells_is_in_the_line():
    line = told_now(monitor({"state": "mapping", "reason": "on the way [U = 1]", "left_s": 250}), 0.41, 85.0, None)
    assert line == "mapping: on the way | 41 % covered | 0.0 m | 85 s, ~4 min left"

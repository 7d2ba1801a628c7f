"""The line that tells how a run is going names what it waits for."""

from types import SimpleNamespace

import pytest

pytest.importorskip("rospy")

from vsx_ros.ros.monitor import progress_line


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
def test_the_line_ends_with_the_reason_or_with_what_is_missing(status, missing, told):
    assert progress_line(monitor(status), None, 3.0, 60.0, missing).rsplit(" | ", 1)[1] == told

"""The line that tells how a run is going names what it waits for."""

from types import SimpleNamespace

import pytest

pytest.importorskip("rospy")

from vsx_ros.ros.progress import progress_line


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
    line = progress_line(monitor(status), None, 3.0, 60.0, missing)
    assert line == f"starting: {told} | 0.0 m2 known | 0.0 m | 3/60 s"


def test_a_long_reason_is_cut_to_a_terminal_and_its_figures_are_left_out():
    reason = "driving 3.0 m to look at 4.1 m2 of unknown ground, which lies behind a shelf"
    status = {"state": "mapping", "reason": f"{reason} [U = v/d = 1]"}
    line = progress_line(monitor(status), 0.41, 85.0, 300.0)
    assert len(line) == 79
    assert line.startswith("mapping: driving 3.0 m to look at 4.1 m2")
    assert line.endswith("... | 41 % covered | 0.0 m | 85/300 s")
    assert "U =" not in progress_line(monitor({**status, "reason": "on the way [U = 1]"}), None, 1.0, None)


@pytest.mark.parametrize(("left_s", "told"), [(None, "85 s"), (20, "85 s, ~1 min left"), (250, "85 s, ~4 min left")])
def test_the_time_left_is_told_where_it_is_known(left_s, told):
    line = progress_line(monitor({"state": "mapping", "reason": "on the way", "left_s": left_s}), 0.41, 85.0, None)
    assert line == f"mapping: on the way | 41 % covered | 0.0 m | {told}"

"""One state of the tracking has one word, on the topics and in the report's legend; what is told beside it arrives."""

import re

import numpy as np
import pytest

pytest.importorskip("rospy")

from vsx_ros.evaluation.report import timeline
from vsx_ros.evaluation.report_data import ReportData
from vsx_ros.ros.convert import ahead_and_stuck, state_msg, tracking_state
from vsx_ros.slam.state import TrackingState


def test_the_legend_says_what_the_topic_says() -> None:
    frames = [(i * 10**9, state.value, 10, 5, False, 1.0, None) for i, state in enumerate(TrackingState)]
    drawn = timeline(ReportData({}, {}, "", [], frames, [], [], None, np.zeros((0, 3))))
    live = [state_msg(state, "").name for state in TrackingState]
    assert re.findall(r'class="key"[^>]*>([^<]+)<', drawn) == live
    assert [tracking_state(state_msg(state, "")) for state in TrackingState] == list(TrackingState)


@pytest.mark.parametrize("told", [("", ""), ("half of it", ""), ("", "stuck: the wheels turned"), ("half", "stuck")])
def test_what_hides_the_map_and_that_the_base_is_stuck_are_told_apart(told: tuple[str, str]) -> None:
    assert ahead_and_stuck(state_msg(TrackingState.GOOD, "why", *told)) == told

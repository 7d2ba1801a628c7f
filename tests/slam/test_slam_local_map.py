"""Which frames become keyframes."""

from types import SimpleNamespace
from typing import Any

import numpy as np

from vsx_ros.config import Config
from vsx_ros.geometry.se3 import SE3
from vsx_ros.slam.keyframe import Observations
from vsx_ros.slam.local_map import becomes_keyframe, may_grow
from vsx_ros.slam.map import Map
from vsx_ros.slam.state import TrackingState
from vsx_ros.slam.track import Track, nothing_tracked


def track(found: int) -> Track:
    """Of 100 points searched."""
    level, identity = np.zeros(found, np.int64), SE3.identity()
    return nothing_tracked("", identity)._replace(
        state=TrackingState.DUBIOUS, rows=np.arange(found), uv=np.zeros((found, 2)), level=level,
        searched_rows=np.arange(100), settled=np.ones(found, np.bool_),
    )  # fmt: skip


def test_only_the_third_keyframe_need_not_wait_while_the_map_is_in_view():
    view, config = Map().view(), Config().slam.keyframes
    for n, at_once in ((2, True), (3, False)):
        young = view._replace(keyframes=(None,) * n)
        assert may_grow(config, young, track(60), 2, 0.03) is at_once
        assert may_grow(config, young, track(60), config.min_gap_frames, 0.03)
        assert may_grow(config, young, track(60), 1, config.min_gap_s)
    assert may_grow(config, young, track(40), 2, 0.03)  # the map is about to get out of view
    assert not may_grow(config, young, track(40), 1, 0.03)


def test_a_frame_in_doubt_becomes_a_keyframe_if_its_points_fit():
    config, away = Config().slam.keyframes, SE3.exp(np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0]))
    only: Any = SimpleNamespace(T_world_cam=away, median_depth=1.0, observations=Observations.none())
    view: Any = SimpleNamespace(
        keyframes=[only], living=np.zeros(1, np.int64), centres=away.translation[None], depths=np.ones(1),
        R_world_cam=away.rotation[None],
    )  # fmt: skip
    few_fit = track(45)._replace(searched_rows=np.arange(200), sigma_px=1.0)
    assert becomes_keyframe(config, view, few_fit, 0)
    assert not becomes_keyframe(config, view, few_fit._replace(sigma_px=3.0), 0)
    assert not becomes_keyframe(config, view, few_fit._replace(settled=np.arange(45) < 30), 0)

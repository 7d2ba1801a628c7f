"""Which frames become keyframes, and which keyframe is followed."""

import math
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from vsx_ros.arrays import IntArray
from vsx_ros.config import Config
from vsx_ros.geometry.camera import kernel_camera, nominal_camera
from vsx_ros.geometry.se3 import SE3
from vsx_ros.slam.keyframe import FrameData, KeyFrame, MapView, Observations
from vsx_ros.slam.local_map import FOLLOWED, PRESENT_PASS, LocalMap, becomes_keyframe, may_grow
from vsx_ros.slam.map import Map
from vsx_ros.slam.state import TrackingState
from vsx_ros.slam.track import Track, nothing_tracked
from vsx_ros.vision.corners import CornerDetector
from vsx_ros.vision.pyramid import build_pyramid, small_image


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
    frame = textured_frame()
    assert becomes_keyframe(config, view, few_fit, 0, frame)
    assert not becomes_keyframe(config, view, few_fit._replace(sigma_px=3.0), 0, frame)
    assert not becomes_keyframe(config, view, few_fit._replace(settled=np.arange(45) < 30), 0, frame)


def textured_frame() -> FrameData:
    image = cv2.GaussianBlur(np.random.default_rng(1).integers(0, 256, (480, 640), np.uint8), (0, 0), 2.0)
    pyramid = build_pyramid(cv2.normalize(image, None, 0, 255, cv2.NORM_MINMAX))
    corners = CornerDetector().detect(pyramid)
    return FrameData(0, pyramid, corners, small_image(pyramid), None, kernel_camera(nominal_camera(640, 480)))


def looking(turn_deg: float, rows: IntArray) -> KeyFrame:
    """A keyframe at the origin, turned about its vertical axis, that sees the points (rows)."""
    pose = SE3.exp(np.array([0.0, 0.0, 0.0, 0.0, math.radians(turn_deg), 0.0]))
    none = np.zeros((len(rows), 2))
    return KeyFrame(0, None, pose, Observations(rows, none, none, np.zeros(len(rows), np.int64)), 1.0, 0)


def view_of(*keyframes: KeyFrame) -> MapView:
    """Keyframes with 400 points."""
    poses = [k.T_world_cam for k in keyframes]
    return Map().view()._replace(
        keyframes=keyframes, living=np.arange(len(keyframes)), R_world_cam=np.array([T.rotation for T in poses]),
        centres=np.array([T.translation for T in poses]), depths=np.ones(len(keyframes)), points=np.zeros((400, 3)),
        alive=np.ones(400, np.bool_),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("columns", "turn_deg", "newer", "expected"),
    [
        (20, 12.0, PRESENT_PASS, False),
        (20, 12.0, PRESENT_PASS - 1, True),
        (20, 35.0, PRESENT_PASS, True),
        (10, 12.0, PRESENT_PASS, True),
        (10, 5.0, PRESENT_PASS, False),
    ],
)
def test_what_an_earlier_pass_has_mapped_becomes_a_keyframe_only_after_a_large_step(columns, turn_deg, newer, expected):
    """columns: of the image's 20, in which points were found. newer: keyframes made since, which look elsewhere."""
    uv = np.stack(np.meshgrid(32.0 * np.arange(columns) + 16.0, 32.0 * np.arange(15) + 16.0), axis=-1).reshape(-1, 2)
    uv = np.concatenate([uv, uv])[:300]
    rows = np.arange(300)
    found = track(0)._replace(
        state=TrackingState.GOOD, rows=rows, uv=uv, searched_rows=rows, settled=np.ones(300, np.bool_),
        T_world_cam=looking(turn_deg, rows).T_world_cam,
    )  # fmt: skip
    view = view_of(looking(0.0, rows), *[looking(180.0, np.arange(300, 400))] * newer)
    assert becomes_keyframe(Config().slam.keyframes, view, found, 0, textured_frame()) is expected


def test_the_reference_follows_the_view_though_another_keyframe_sees_more_of_the_found_points():
    behind = looking(0.0, np.arange(300))
    ahead = [looking(38.0 + k, np.arange(220, 400)) for k in range(FOLLOWED)]
    local = LocalMap(view_of(behind, *ahead), 0)
    found = track(0)._replace(rows=np.arange(150, 300), T_world_cam=looking(38.0, np.arange(0)).T_world_cam)
    assert local.follow(found) == 1
    assert local.follow(found._replace(rows=np.arange(200))) == 0, "no other one sees any of these"
    few = LocalMap(view_of(behind, *ahead[:3]), 0)
    assert few.follow(found) == 0, "it is among the nearest, and sees more"

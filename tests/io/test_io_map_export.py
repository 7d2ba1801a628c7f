"""Exports of a map whose culled keyframes have no images any more."""

import os
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest

from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.geometry.se3 import SE3
from vsx_ros.io.map_export import write_colmap
from vsx_ros.slam.snapshot import MapSnapshot, Rays

CAMERA = PinholeCamera(160, 120, 130.0, 130.0, 79.5, 59.5)


def three_images() -> MapSnapshot:
    """Of the middle one no image is left."""
    poses = tuple(SE3(np.eye(3), np.array([0.1 * k, 0.0, 0.0])) for k in range(3))
    points = np.array([[0.1, 0.0, 2.0], [0.2, 0.1, 2.0]])
    keyframe, point = np.array([0, 0, 1, 1, 2]), np.array([0, 1, 0, 1, 0])  # 1 is culled; point 1 is left to 0 alone
    rays = Rays(ids=np.arange(3), T_world_cams=poses, keyframe=keyframe, point=point, level=np.zeros(5, np.int64))
    uv = np.concatenate([CAMERA.project(poses[0].inverse() @ points), CAMERA.project(poses[2].inverse() @ points[:1])])
    return MapSnapshot(
        version=1, keyframe_ids=np.array([0, 2]), keyframe_stamps_ns=np.array([0, 2]),
        T_world_cams=(poses[0], poses[2]), images=(np.zeros((120, 160), np.uint8),) * 2,
        point_ids=np.array([7, 9]), points_world=points, obs_keyframe=np.array([0, 0, 1]),
        obs_point=np.array([0, 1, 0]), obs_uv=uv, obs_level=np.zeros(3, np.int64), all_rays=rays,
    )  # fmt: skip


def test_colmap_gets_the_points_that_two_images_show(tmp_path: Path) -> None:
    write_colmap(tmp_path, CAMERA, three_images())
    lines = {path.name: path.read_text().splitlines() for path in tmp_path.rglob("*.txt")}
    number, *_, error_px, first, _, second, _ = lines["points3D.txt"][1].split()
    assert (len(lines["points3D.txt"]), number, first, second) == (2, "7", "1", "3")
    assert float(error_px) < 1e-3
    assert [line.split()[2::3] for line in lines["images.txt"][2::2]] == [["7", "-1"], ["7"]]


def test_an_interrupted_export_is_not_taken_for_a_whole_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_colmap(tmp_path, CAMERA, three_images())
    monkeypatch.setattr(os, "replace", replacing := Mock(side_effect=[None, KeyboardInterrupt]))
    with pytest.raises(KeyboardInterrupt):
        write_colmap(tmp_path, CAMERA, three_images())
    assert replacing.call_count == 2
    assert not (tmp_path / "images.txt").exists(), "it names images of two times"

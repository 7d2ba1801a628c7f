"""Corners followed before there is a map, and the earlier frames that they are compared with."""

import numpy as np
import pytest
from textured_planes import CAMERA, SCENE, frame, moved, picture

from vsx_ros.config import Config
from vsx_ros.geometry.se3 import SE3
from vsx_ros.slam.initialization import Initializer
from vsx_ros.slam.trails import FEW_TRAILS, REFERENCES, SPACING_NS, Trails
from vsx_ros.slam.two_view_reconstruction import InitialMap, TwoViewReconstruction

CONFIG = Config().slam.initialization
TWO_VIEWS = TwoViewReconstruction(CAMERA, CONFIG)


def seen(k, x=0.0, yaw=0.0):
    """The k-th frame, a tenth of a second after the one before."""
    return frame(k * SPACING_NS, picture(moved(x=x, yaw=yaw), SCENE))


@pytest.fixture(scope="module")
def sideways():
    """Trails through eight frames, 1.5 cm apart, and where each was seen from."""
    places = 0.015 * np.arange(8)
    trails = Trails(seen(0))
    for k, x in enumerate(places[1:].tolist(), start=1):
        trails.follow(seen(k, x))
        trails.extend()
    return trails, places


def test_the_oldest_and_the_newest_reference_stay_and_gaps_are_even(sideways):
    stamps = [reference.data.stamp_ns // SPACING_NS for reference in sideways[0].references]
    assert len(stamps) == REFERENCES
    assert (stamps[0], stamps[-1]) == (0, 7)
    assert stamps == sorted(stamps)
    assert max(np.diff(stamps)) <= 3


def test_trails_are_where_the_planes_say(sideways):
    trails, places = sideways
    for reference in trails.references[:-1]:
        rows = reference.rows
        assert len(rows) >= FEW_TRAILS // 2
        at = places[reference.data.stamp_ns // SPACING_NS]
        shift = reference.uv[rows] - trails.positions[rows]
        near, far = (525.0 * (places[-1] - at) / depth for depth in (1.5, 2.6))
        assert far * 0.8 < np.median(shift[:, 0]) < near * 1.1
        assert np.median(np.abs(shift[:, 1])) < 0.3


def test_corners_of_a_reference_are_whole_pixels_and_match_the_newest_frame(sideways):
    trails, _ = sideways
    reference = trails.references[2]
    candidates, uv = trails.corners(reference, trails.straighten(reference))
    assert 150 < len(uv) == len(candidates.uv) == len(candidates.patches)
    whole = (candidates.uv + 0.5) / 2.0 ** candidates.level[:, None] - 0.5
    assert np.abs(whole - np.rint(whole)).max() < 1e-9
    fine = candidates.level == 0
    centres = candidates.patches[fine, 12, 12]
    column, row = candidates.uv[fine].astype(int).T
    assert np.array_equal(centres, reference.data.pyramid.level(0)[row, column])
    assert np.median(np.abs((candidates.uv - uv)[:, 1])) < 0.3


def test_a_resting_camera_needs_no_second_reference():
    trails = Trails(seen(0))
    for k in range(1, 4):
        trails.follow(seen(k))
        trails.extend()
    assert len(trails.references) == 1


def swayed(places):
    """What an initializer makes of a sway, and the frame number of the first of the pair."""
    initializer = Initializer(None, CONFIG)
    for k, x in enumerate(places):
        got = initializer.add(seen(k, x))
        got = got if isinstance(got, str) else TWO_VIEWS.reconstruct(got)
        if isinstance(got, InitialMap):
            return k, got.pair.first.stamp_ns // SPACING_NS, got
    return None, None, got


def test_a_sway_starts_between_its_turning_points():
    """Neither way from the middle is far enough; the way from one end to the other is."""
    straight = swayed(np.arange(0.0, 0.4, 0.01).tolist())
    needed = 0.01 * (straight[0] - straight[1])
    reach = 0.55 * needed
    there, back = np.linspace(0.0, -reach, 6), np.linspace(-reach, reach, 11)[1:]
    assert swayed(there.tolist())[0] is None
    newest, first, got = swayed([*there, *back])
    assert newest is not None
    assert first > 0
    T = got.poses[0].inverse() @ got.poses[1]
    assert np.degrees(np.arccos(T.translation[0] / np.linalg.norm(T.translation))) < 5.0
    assert np.degrees(T.rotation_angle_to(SE3.identity())) < 1.0


def test_turning_on_the_spot_starts_from_no_reference():
    initializer = Initializer(None, CONFIG)
    yaws = 0.05 * np.sin(np.arange(12) * 0.6)
    said = [initializer.add(seen(k, yaw=float(yaw))) for k, yaw in enumerate(yaws)]
    assert all(isinstance(word, str) for word in said)
    assert "turns in place" in said[-1]

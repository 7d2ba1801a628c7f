"""The size that a map tells is what its memory takes."""

import pickle
import tracemalloc
from dataclasses import replace
from weakref import ref

import numpy as np
import pytest

from vsx_ros.arrays import packed
from vsx_ros.config import Config
from vsx_ros.slam import place_recognition
from vsx_ros.slam.place_recognition import PlaceRecognizer
from vsx_ros.slam.slam import SequentialSlam
from vsx_ros.vision.corners import describe


def memory_of(thing: object) -> int:
    """Bytes that a copy of it takes which shares nothing."""
    written = pickle.dumps(thing)
    tracemalloc.start()
    again = pickle.loads(written)  # noqa: S301 (written here)
    taken, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert type(again) is type(thing)
    return taken


@pytest.fixture(scope="module")
def slam(arc_drive):
    slam = SequentialSlam(arc_drive.camera, arc_drive.T_base_cam, Config().slam)
    for frame, odometry, _ in arc_drive.frames:
        slam.track(frame, odometry)
    return slam


def test_a_map_tells_the_memory_that_it_takes_and_less_when_it_is_culled(arc_drive, slam):
    view = slam.slam_map().view
    assert len(view.living) >= 3
    assert view.nbytes == pytest.approx(memory_of(view), rel=0.03)
    world = slam.slam_map().resumed(arc_drive.camera, arc_drive.T_base_cam)
    culled = view.keyframes[-1]
    world.cull_keyframe(len(view.keyframes) - 1)
    gone = view.nbytes - world.view().nbytes
    image = culled.data.pyramid.pixels.nbytes
    assert image < gone < 1.5 * image


def test_what_is_remembered_of_places_is_counted_and_leaves_with_the_map(slam):
    view, places, before = slam.slam_map().view, slam._front.recovery.places, slam.nbytes
    some = view.living[:3]
    places.ranked(view.keyframes[0].data.small, view, some)
    tiny = slam.nbytes - before
    assert tiny == len(some) * 20 * 15 * 4
    rows, features = places.described(view.keyframes[int(some[1])])
    assert slam.nbytes - before - tiny == len(rows) * (features.bits.shape[1] + 4)
    world = slam.slam_map().resumed(slam._camera, slam._mount)
    world.cull_keyframe(int(some[1]))
    places.ranked(view.keyframes[0].data.small, world.view(), some[:1])
    assert slam.nbytes - before - len(rows) * (features.bits.shape[1] + 4) == tiny - 20 * 15 * 4


def test_a_described_keyframe_keeps_no_observations_and_is_described_anew_with_others(slam, monkeypatch):
    places, described = PlaceRecognizer(slam._camera, slam._front._tracker), []
    monkeypatch.setattr(place_recognition, "describe", lambda *of: described.append(1) or describe(*of))
    keyframe = slam.slam_map().view.keyframes[0]
    rows, features = places.described(keyframe)
    again, the_same = places.described(keyframe)
    assert np.array_equal(rows, again)
    assert all(map(np.array_equal, features, the_same))
    other = replace(keyframe, observations=packed(keyframe.observations.where(keyframe.observations.level == 0)))
    fewer, _ = places.described(other)
    assert 0 < len(fewer) < len(rows)
    kept = ref(other.observations.rows)
    del other
    assert kept() is None
    assert np.array_equal(places.described(keyframe)[0], rows)
    assert len(described) == 3

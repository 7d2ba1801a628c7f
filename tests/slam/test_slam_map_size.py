"""The size that a map tells is what its memory takes."""

import pickle
import tracemalloc

import pytest

from vsx_ros.config import Config
from vsx_ros.slam.slam import SequentialSlam


def memory_of(thing: object) -> int:
    """Bytes that a copy of it takes which shares nothing."""
    written = pickle.dumps(thing)
    tracemalloc.start()
    again = pickle.loads(written)  # noqa: S301 (written here)
    taken, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert type(again) is type(thing)
    return taken


def test_a_map_tells_the_memory_that_it_takes_and_less_when_it_is_culled(arc_drive):
    slam = SequentialSlam(arc_drive.camera, arc_drive.T_base_cam, Config().slam)
    for frame, odometry, _ in arc_drive.frames:
        slam.track(frame, odometry)
    view = slam.slam_map().view
    assert len(view.living) >= 3
    assert view.nbytes == pytest.approx(memory_of(view), rel=0.03)
    world = slam.slam_map().resumed(arc_drive.camera, arc_drive.T_base_cam)
    culled = view.keyframes[-1]
    world.cull_keyframe(len(view.keyframes) - 1)
    gone = view.nbytes - world.view().nbytes
    image = culled.data.pyramid.pixels.nbytes
    assert image < gone < 1.5 * image

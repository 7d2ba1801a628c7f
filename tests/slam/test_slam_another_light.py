"""A map made in one light, and the camera in another."""

import math

import msgspec
import numpy as np
import pytest

from vsx_ros.config import Config
from vsx_ros.robot import STOP
from vsx_ros.sim.generate import generate_world
from vsx_ros.sim.lighting import light_named
from vsx_ros.sim.robot import EmulatedRobot
from vsx_ros.sim.world import Start
from vsx_ros.slam.frontend import FrontEnd
from vsx_ros.slam.place_recognition import Recognition, likeness, structure
from vsx_ros.slam.recovery import Recovery
from vsx_ros.slam.slam import SequentialSlam
from vsx_ros.vision.pyramid import build_pyramid, small_image

CONFIG = Config().slam
SEED, FRAMES = 12, 30  # of the arc's lab; two seconds


@pytest.fixture(scope="module")
def arc_map(arc_drive):
    """The map of the arc, and T_world_map."""
    slam = SequentialSlam(arc_drive.camera, arc_drive.T_base_cam, CONFIG, 1)
    results = [slam.track(frame, odometry) for frame, odometry, _ in arc_drive.frames]
    return slam.slam_map(), arc_drive.frames[-1][2] @ results[-1].T_world_cam.inverse()


def put_down(drive, k, light):
    """The robot at frame k of the drive, in another light."""
    T = (drive.frames[k][2] @ drive.T_base_cam.inverse()).matrix()
    start = Start(x=T[0, 3], y=T[1, 3], theta_rad=math.atan2(T[1, 0], T[0, 0]))
    world = msgspec.structs.replace(generate_world("lab", SEED), start=start, lighting=light_named(light, SEED))
    return EmulatedRobot(world, SEED)


@pytest.mark.parametrize(("light", "k"), [("dim", 30), ("dim", 100), ("day", 60), ("night", 100)])
def test_a_camera_put_down_in_another_light_is_found_where_it_is(arc_drive, arc_map, light, k):
    slam_map, T_world_map = arc_map
    robot = put_down(arc_drive, k, light)
    slam = SequentialSlam(arc_drive.camera, arc_drive.T_base_cam, CONFIG, 1, slam_map)
    for _ in range(FRAMES):
        seen = robot.step(STOP)
        result = slam.track(seen.frame, seen.odometry)
        if result.state.tracked:
            break
    assert result.state.tracked
    error = (T_world_map @ result.T_world_cam).inverse() @ robot.truth.T_world_cam
    assert np.linalg.norm(error.translation) < 0.05


def test_small_images_are_compared_without_the_light():
    rng = np.random.default_rng(0)
    places = rng.normal(0.0, 20.0, (8, 30, 40)).astype(np.float32)
    gain = np.linspace(0.3, 1.5, 40, dtype=np.float32)
    light = np.linspace(-60.0, 60.0, 40, dtype=np.float32)
    known = np.stack([structure(place) for place in places])
    for k, place in enumerate(places):
        like = likeness(structure(gain * place + light), known)
        assert np.argmax(like) == k
        assert like[k] > 0.8
        assert like[k] > 3.0 * np.delete(like, k).max()


@pytest.mark.parametrize(("width", "height"), [(128, 96), (160, 120), (176, 144), (640, 480)])
def test_places_of_every_image_size_are_compared(width, height):
    rng = np.random.default_rng(0)
    images = [rng.integers(0, 256, (height, width)).astype(np.uint8) for _ in range(4)]
    known = np.stack([structure(small_image(build_pyramid(image))) for image in images])
    for k, place in enumerate(known):
        like = likeness(place, known)
        assert np.argmax(like) == k
        assert like[k] == pytest.approx(1.0, abs=1e-3)


def test_a_likely_place_is_confirmed_by_the_next_frame_without_another_search(arc_drive, arc_map, monkeypatch):
    slam_map, _ = arc_map
    front = FrontEnd(arc_drive.camera, arc_drive.T_base_cam, CONFIG, 0)
    relocalizer = Recovery(arc_drive.camera, None, CONFIG, front._tracker, front._motion)._relocalizer
    first, second = (front._preprocessor.take(*arc_drive.frames[k][:2], metric=True) for k in (30, 31))
    likely = relocalizer.places.ranked(first.small, slam_map.view, slam_map.view.living)
    monkeypatch.setattr(Recognition, "is_certain", lambda self, config: False)
    monkeypatch.setattr(relocalizer.places, "ranked", lambda small, view, among: likely[:1])
    assert relocalizer.relocalize(first, slam_map.view, None) is None
    monkeypatch.setattr(relocalizer.places, "ranked", lambda small, view, among: likely[:0])
    assert relocalizer.relocalize(second, slam_map.view, None) is not None

"""What camera, wheels or calibration may do wrong: a clear error or a marked gap, never a silently wrong pose."""

import dataclasses
import math
from typing import NamedTuple

import numpy as np
import pytest

from vsx_ros.config import Config
from vsx_ros.errors import CalibrationError, InputError
from vsx_ros.evaluation.trajectory import align
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3
from vsx_ros.robot import Frame
from vsx_ros.slam.slam import SequentialSlam
from vsx_ros.slam.state import SlamEvent, TrackingResult, TrackingState
from vsx_ros.slam.threads import ThreadedSlam

CONFIG = Config().slam
TRACKED = (TrackingState.GOOD, TrackingState.DUBIOUS)
FIRST, LAST = 60, 75


class Run(NamedTuple):
    """Results by frame, None where it was refused; events; worst error [m] of a pose said to be tracked."""

    results: list[TrackingResult | None]
    refused: list[str]
    events: list[SlamEvent]
    worst_m: float

    def states(self, first, last=None):
        return [r.state for r in self.results[first:last] if r is not None]

    def reasons(self, kind):
        return [e.reason for e in self.events if e.kind == kind]


def run(drive, change):
    """Track a drive with ``change(k, frame, odometry)``; the map's frame is that of the first drawn poses."""
    slam = SequentialSlam(drive.camera, drive.T_base_cam, CONFIG, 1)
    results, refused = [], []
    for k, (frame, odometry, _) in enumerate(drive.frames):
        try:
            results.append(slam.track(*change(k, frame, odometry)))
        except InputError as error:
            results.append(None)
            refused.append(str(error))
    placed = [
        (r.T_world_cam.translation, truth.translation)
        for r, (_, _, truth) in zip(results, drive.frames)
        if r is not None and r.state in TRACKED
    ]
    worst = 0.0
    if placed:
        seen, true = (np.array(positions) for positions in zip(*placed))
        to_truth = align(seen[:30], true[:30], "yaw")
        worst = float(np.linalg.norm(to_truth.apply(seen) - true, axis=1).max())
    return Run(results, refused, slam.drain_events(), worst)


def between(first, last, image=None, odometry=None):
    """A change of image or odometry in the frames first to last - 1."""

    def change(k, frame, reading):
        if first <= k < last and image is not None:
            frame = frame._replace(image=image(frame.image))
        if first <= k < last and odometry is not None:
            reading = odometry(reading)
        return frame, reading

    return change


def saturated(image):
    return np.clip(image.astype(np.int64) * 8, 0, 255).astype(np.uint8)


def noise(image):
    return np.random.default_rng(int(image.sum())).integers(0, 256, image.shape).astype(np.uint8)


BLIND = {
    "black": np.zeros_like,
    "white": lambda image: np.full_like(image, 255),
    "dark": lambda image: (image // 32).astype(np.uint8),
    "saturated": saturated,
    "noise": noise,
}


@pytest.mark.parametrize("name", BLIND)
def test_images_that_show_nothing_are_marked_and_overcome(arc_drive, name):
    done = run(arc_drive, between(FIRST, LAST, image=BLIND[name]))
    assert set(done.states(FIRST + 3, LAST)) == {TrackingState.LOST}
    assert set(done.states(LAST + 5)) <= set(TRACKED)
    assert len(done.reasons("lost")) == len(done.reasons("relocalised")) == 1
    assert done.worst_m < 0.03


@pytest.mark.parametrize("name", BLIND)
def test_a_start_without_anything_to_see_waits(arc_drive, name):
    done = run(arc_drive, between(0, 35, image=BLIND[name]))
    assert set(done.states(0, 35)) == {TrackingState.NOT_INITIALISED}
    assert any("sees too little" in reason for reason in done.reasons("refused"))
    assert done.results[-1].state is TrackingState.GOOD
    assert done.worst_m < 0.03


def test_half_of_the_picture_is_enough(arc_drive):
    def covered(image):
        image = image.copy()
        image[:, :320] = 0
        return image

    done = run(arc_drive, between(FIRST, 999, image=covered))
    # Near the end of the drive the open half shows fewer than twenty points: then the wheels carry the pose, marked.
    lost = [state for state in done.states(FIRST) if state is TrackingState.LOST]
    assert len(lost) <= 5
    assert done.worst_m < 0.03


@pytest.mark.parametrize("kind", [SequentialSlam, ThreadedSlam])
def test_images_of_another_kind_are_refused_by_name(arc_drive, kind):
    slam = kind(arc_drive.camera, arc_drive.T_base_cam, CONFIG, 1)
    frame, odometry, _ = arc_drive.frames[0]
    image = frame.image
    slam.track(frame, odometry)
    bad = {
        "320x240": image[::2, ::2].copy(),
        "uint8 of shape \\(480, 640, 3\\)": np.dstack([image] * 3),
        "float64": image / 255.0,
        "uint16": image.astype(np.uint16),
        "too small": np.zeros((0, 0), np.uint8),
        "NoneType": None,
        "list": image[:2].tolist(),
    }
    for words, picture in bad.items():
        with pytest.raises(InputError, match=words):
            slam.track(Frame(frame.stamp_ns + 1_000_000, picture), odometry)
    if kind is ThreadedSlam:
        slam.close()
    assert slam.statistics().frames == 1


def test_images_in_strides_or_read_only_are_as_good(arc_drive):
    def strided(image):
        wide = np.zeros((480, 1280), np.uint8)
        wide[:, ::2] = image
        wide.flags.writeable = False
        return wide[:, ::2]

    plain = run(arc_drive, lambda k, frame, odometry: (frame, odometry))
    done = run(arc_drive, between(0, 999, image=strided))
    assert done.results[-1].T_world_cam.matrix().tobytes() == plain.results[-1].T_world_cam.matrix().tobytes()


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda o: o._replace(T_odom_base=SE2(math.nan, 0.0, 0.0)), "not a number"),
        (lambda o: o._replace(T_odom_base=SE2(0.0, 0.0, math.inf)), "not a number"),
        (lambda o: o._replace(omega=-math.inf), "not a number"),
        (lambda o: o._replace(v=1e9), "cannot be"),
        (lambda o: o._replace(T_odom_base=SE2(1e300, 0.0, 0.0)), "cannot be"),
        (lambda o: o._replace(stamp_ns=o.stamp_ns - 10**9), "s older than"),
        (lambda o: o._replace(stamp_ns=o.stamp_ns + 10**9), "s newer than"),
    ],
)
def test_odometry_that_cannot_be_is_left_out(arc_drive, spoil, words):
    done = run(arc_drive, between(FIRST, LAST, odometry=spoil))
    gaps = done.reasons("gap")
    assert len(gaps) == LAST - FIRST
    assert all(words in gap for gap in gaps)
    assert set(done.states(FIRST)) <= set(TRACKED)
    assert done.worst_m < 0.03


@pytest.mark.parametrize("jump", [SE2(3.0, 0.0, 0.0), SE2(0.3, 0.0, 0.0), SE2(0.0, 0.0, 2.0)])
@pytest.mark.parametrize("last", [FIRST + 1, 999])
def test_odometry_that_jumps_is_counted_on(arc_drive, jump, last):
    moved = between(FIRST, last, odometry=lambda o: o._replace(T_odom_base=jump @ o.T_odom_base))
    done = run(arc_drive, moved)
    assert len(done.reasons("gap")) == (2 if last == FIRST + 1 else 1)
    assert all("odometry jumped" in gap for gap in done.reasons("gap"))
    assert set(done.states(FIRST)) <= set(TRACKED)
    assert done.worst_m < 0.02


def test_odometry_that_jumps_before_the_start_does_not_hinder_it(arc_drive):
    done = run(
        arc_drive, between(10, 999, odometry=lambda o: o._replace(T_odom_base=SE2(3.0, 0.0, 0.0) @ o.T_odom_base))
    )
    assert done.results[-1].state is TrackingState.GOOD
    assert done.worst_m < 0.02


def test_stamps_that_do_not_advance_are_refused_and_leave_no_trace(arc_drive):
    def back(k, frame, odometry):
        shift = -(10**9) if FIRST <= k < FIRST + 5 else 0
        return frame._replace(stamp_ns=frame.stamp_ns + shift), odometry

    done = run(arc_drive, back)
    assert len(done.refused) == 5
    assert all("is not after" in text for text in done.refused)
    assert set(done.states(FIRST)) <= set(TRACKED)
    assert done.worst_m < 0.02


def test_images_that_change_size_or_type_on_the_way_are_refused_and_overcome(arc_drive):
    def other(k, frame, odometry):
        pictures = {FIRST: frame.image[::2, ::2].copy(), FIRST + 1: frame.image.astype(np.float32)}
        return frame._replace(image=pictures.get(k, frame.image)), odometry

    done = run(arc_drive, other)
    assert len(done.refused) == 2
    assert "image of 320x240 does not fit the calibration for 640x480" in done.refused[0]
    assert "float32" in done.refused[1]
    assert set(done.states(FIRST)) <= set(TRACKED)
    assert done.worst_m < 0.02


def test_a_stamp_from_the_future_is_a_marked_gap_and_what_follows_it_is_refused(arc_drive):
    def ahead(k, frame, odometry):
        return frame._replace(stamp_ns=frame.stamp_ns + (10**10 if k == FIRST else 0)), odometry

    done = run(arc_drive, ahead)
    assert any("no frame for 10." in reason for reason in done.reasons("gap"))
    assert len(done.refused) == len(arc_drive.frames) - FIRST - 1
    assert all("is not after the one before" in text for text in done.refused)
    assert done.worst_m < 0.02


def test_minutes_without_a_frame_are_a_marked_gap(arc_drive):
    def later(k, frame, odometry):
        shift = 300 * 10**9 if k >= FIRST else 0
        return frame._replace(stamp_ns=frame.stamp_ns + shift), odometry._replace(stamp_ns=odometry.stamp_ns + shift)

    done = run(arc_drive, later)
    assert done.reasons("gap") == ["no frame for 300.1 s"]
    assert set(done.states(FIRST)) <= set(TRACKED)
    assert done.worst_m < 0.02


@pytest.mark.parametrize("last", [LAST, 999])
def test_a_camera_that_hangs_while_the_wheels_turn_is_found_out(arc_drive, last):
    hung = arc_drive.frames[FIRST - 1][0].image
    done = run(arc_drive, between(FIRST, last, image=lambda image: hung))
    assert any("the camera hangs" in reason for reason in done.reasons("gap"))
    assert set(done.states(FIRST + 3, last)) == {TrackingState.LOST}
    assert done.worst_m < 0.03
    if last == LAST:
        assert set(done.states(LAST + 5)) <= set(TRACKED)


def test_a_standing_robot_may_send_the_same_image_again(arc_drive):
    frame, odometry, _ = arc_drive.frames[FIRST]
    slam = SequentialSlam(arc_drive.camera, arc_drive.T_base_cam, CONFIG, 1)
    for seen, wheels, _ in arc_drive.frames[: FIRST + 1]:
        moving = slam.track(seen, wheels)
    standing = []
    for k in range(1, 11):
        stamp_ns = frame.stamp_ns + k * 66_000_000
        standing.append(
            slam.track(Frame(stamp_ns, frame.image), odometry._replace(stamp_ns=stamp_ns, v=0.0, omega=0.0))
        )
    assert all(result.state in TRACKED for result in standing)
    # Half the readout at 0.14 m/s and 0.34 rad/s: once the image counts as taken in motion, then as taken at rest.
    halt, *rest = (result.T_world_cam.translation for result in standing)
    assert np.linalg.norm(halt - moving.T_world_cam.translation) < 0.01
    assert max(np.linalg.norm(after - halt) for after in rest) < 0.003
    assert not [e for e in slam.drain_events() if e.kind == "gap"]


@pytest.mark.parametrize("last", [LAST, 999])
def test_wheels_that_stand_while_the_image_moves_are_not_believed(arc_drive, last):
    stuck = arc_drive.frames[FIRST - 1][1].T_odom_base
    still = between(FIRST, last, odometry=lambda o: o._replace(T_odom_base=stuck, v=0.0, omega=0.0))
    done = run(arc_drive, still)
    assert any("contradict the images" in reason for reason in done.reasons("gap"))
    assert set(done.states(FIRST)) <= set(TRACKED)
    assert done.worst_m < 0.04


@pytest.mark.parametrize("share", [0.7, 1.3, 2.0])
def test_wheels_that_slip_are_not_believed(arc_drive, share):
    counted = [arc_drive.frames[39][1].T_odom_base]
    for (_, before, _), (_, after, _) in zip(arc_drive.frames[39:90], arc_drive.frames[40:91]):
        motion = before.T_odom_base.inverse() @ after.T_odom_base
        counted.append(counted[-1] @ SE2(share * motion.x, share * motion.y, motion.theta))
    rest = counted[-1] @ arc_drive.frames[90][1].T_odom_base.inverse()

    def slipping(k, frame, odometry):
        if k < 40:
            return frame, odometry
        T = counted[k - 39] if k < 91 else rest @ odometry.T_odom_base
        return frame, odometry._replace(T_odom_base=T, v=odometry.v * (share if k < 91 else 1.0))

    done = run(arc_drive, slipping)
    assert any("contradict the images" in reason for reason in done.reasons("gap"))
    assert set(done.states(FIRST)) <= set(TRACKED)
    assert done.worst_m < 0.04


@pytest.mark.parametrize("kind", [SequentialSlam, ThreadedSlam])
@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"fx": 5.0, "fy": 5.0}, "view of 178 deg"),
        ({"fx": 5e4, "fy": 5e4}, "view of 0.733 deg"),
        ({"fy": 5000.0}, "focal lengths"),
        ({"cx": -5000.0}, "principal point"),
        ({"distortion": (5.0, -100.0, 0.0, 0.0, 0.0)}, "distortion"),
    ],
)
def test_a_calibration_that_cannot_be_is_refused_at_once(arc_drive, kind, change, words):
    camera = dataclasses.replace(arc_drive.camera, **change)
    with pytest.raises(CalibrationError, match=words):
        kind(camera, arc_drive.T_base_cam, CONFIG)


@pytest.mark.parametrize(
    ("rotation", "translation", "words"),
    [
        (np.eye(3), [math.nan, 0.0, 0.3], "not finite"),
        (np.full((3, 3), math.nan), [0.0, 0.0, 0.3], "not finite"),
        (2.0 * np.eye(3), [0.0, 0.0, 0.3], "no rotation"),
        (-np.eye(3), [0.0, 0.0, 0.3], "no rotation"),
        (np.eye(3), [-90.0, 0.0, 310.0], "in metres"),
    ],
)
def test_a_mount_that_cannot_be_is_refused_at_once(arc_drive, rotation, translation, words):
    with pytest.raises(CalibrationError, match=words):
        SequentialSlam(arc_drive.camera, SE3(rotation, np.array(translation)), CONFIG)


def test_a_calibration_of_another_size_is_refused_with_the_first_image(arc_drive):
    camera = dataclasses.replace(arc_drive.camera, width=1280, height=960)
    slam = SequentialSlam(camera, arc_drive.T_base_cam, CONFIG)
    with pytest.raises(InputError, match="640x480 does not fit the calibration for 1280x960"):
        slam.track(*arc_drive.frames[0][:2])

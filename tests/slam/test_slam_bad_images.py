"""What a camera may do wrong: a clear error or a marked gap, never a silently wrong pose."""

import numpy as np
import pytest
from spoilt_drives import CONFIG, FIRST, LAST, TRACKED, between, run

from vsx_ros.errors import InputError
from vsx_ros.robot import Frame
from vsx_ros.slam.slam import SequentialSlam, ThreadedSlam
from vsx_ros.slam.state import TrackingState


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


def test_a_camera_that_hangs_on_a_straight_way_is_not_found_in_its_last_picture(straight_drive):
    """Ahead nothing leaves the picture: its points were found again in it, and the wheels blamed for the difference."""
    first, last = 70, 85
    hung = straight_drive.frames[first - 1][0].image
    done = run(straight_drive, between(first, last, image=lambda image: hung))
    for result in done.results[first:last]:
        assert result.state in (TrackingState.DUBIOUS, TrackingState.LOST)
        assert result.found == 0
        assert not result.keyframe_added
        assert "the camera hangs" in result.reason
    assert not [gap for gap in done.reasons("gap") if "odometry" in gap]
    assert set(done.states(last + 5)) <= set(TRACKED)
    assert done.worst_m < 0.03


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

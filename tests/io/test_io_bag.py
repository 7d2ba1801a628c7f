"""What is found in a bag, by type and by name."""

from dataclasses import replace

import numpy as np
import pytest
from ros1_bags import SCENE, compressed, image, write
from rosbags.rosbag1 import Writer

from vsx_ros.io.bag import open_recording


def test_frames_odometry_and_calibration_are_found_by_type(drive):
    recording = open_recording(drive)
    frames = list(recording.frames())
    assert [f.stamp_ns for f in frames] == [i * 10**8 + 5 * 10**7 for i in range(5)]
    assert all(np.array_equal(f.image, SCENE) for f in frames)
    assert recording.image_topic == "/camera/rgb/image_raw"
    assert (recording.camera.fx, recording.camera.distortion[0]) == (30.0, 0.1)
    assert [o.T_odom_base.x for o in recording.odometry] == pytest.approx([0, 0.02, 0.04, 0.06, 0.08])
    assert (recording.odometry[0].v, recording.odometry[0].omega) == (0.2, 0.1)


def test_messages_interleave_by_stamp(drive):
    stamps = [m.stamp_ns for m in open_recording(drive).messages()]
    assert stamps == sorted(stamps)
    assert len(stamps) == 10


@pytest.mark.parametrize("compression", [Writer.CompressionFormat.BZ2, Writer.CompressionFormat.LZ4])
def test_compressed_bags_and_images(tmp_path, compression):
    messages = [("/c/image/compressed", compressed(i * 10**7 + 1)) for i in range(3)]
    frames = list(open_recording(write(tmp_path / "c.bag", messages, compression)).frames())
    assert len(frames) == 3
    assert np.array_equal(frames[2].image, SCENE)


def read(path) -> tuple[list[int], list[str]]:
    """The stamps of a recording's images, and what it tells."""
    said: list[str] = []
    frames = [f.stamp_ns for f in replace(open_recording(path), tell=said.append).frames()]
    return frames, said


def test_images_that_are_swapped_are_sorted_and_a_doubled_one_is_told(tmp_path):
    stamps = [10, 30, 20, 30, 40]
    frames, said = read(write(tmp_path / "o.bag", [("/image", image(s)) for s in stamps]))
    assert frames == [10, 20, 30, 40]
    assert [text.partition(": ")[2] for text in said] == [
        "1 of 5 images left out: their stamps are those of others or out of order"
    ]
    assert read(write(tmp_path / "good.bag", [("/image", image(s)) for s in (10, 30, 20)])) == ([10, 20, 30], [])


def test_images_that_come_too_late_are_counted(tmp_path):
    stamps = [*range(10, 30), 5, 6, *range(30, 40)]
    frames, said = read(write(tmp_path / "l.bag", [("/image", image(s)) for s in stamps]))
    assert frames == list(range(10, 40))
    assert "2 of 32 images left out" in said[0]


def test_one_image_from_the_past_costs_no_other(tmp_path):
    stamps = [10**12 + k * 10**8 for k in range(12)]
    for wrong in (1, 3, 8):
        messages = [("/image", image(s - 10**11 * (k == wrong))) for k, s in enumerate(stamps)]
        frames, said = read(write(tmp_path / f"{wrong}.bag", messages))
        assert frames == [s for k, s in enumerate(stamps) if k != wrong]
        assert "1 of 12 images left out" in said[0]


def test_a_stamp_of_zero_among_good_ones_is_the_time_of_recording_without_the_delay(tmp_path):
    frames, said = read(write(tmp_path / "z.bag", [("/i", image(s)) for s in (900, 901, 0, 903)]))
    assert (frames, said) == ([900, 901, 902, 903], [])


@pytest.mark.parametrize("wrong", [0, 2, 3])
def test_one_image_from_the_future_costs_no_other(tmp_path, wrong):
    stamps = [10**9 + k * 10**8 for k in range(5)]
    path = write(tmp_path / "f.bag", [("/image", image(s + 10**12 * (k == wrong))) for k, s in enumerate(stamps)])
    assert [f.stamp_ns for f in open_recording(path).frames()] == [s for k, s in enumerate(stamps) if k != wrong]


def test_stampless_images_take_the_time_of_recording(tmp_path):
    path = write(tmp_path / "o.bag", [("/image", image(0)), ("/image", image(0))])
    assert [f.stamp_ns for f in open_recording(path).frames()] == [1000, 1001]


def test_sixteen_bit_images_keep_one_scale(tmp_path):
    first = np.linspace(0, 4095, 24 * 32).astype("<u2")
    path = write(tmp_path / "w.bag", [("/i", image(1, first, "mono16")), ("/i", image(2, first // 2, "mono16"))])
    one, two = (f.image.astype(int) for f in open_recording(path).frames())
    assert one.max() == 255
    assert np.abs(one // 2 - two).max() <= 1


@pytest.mark.parametrize("order", ["rggb", "grbg", "gbrg", "bggr"])
def test_mosaics_of_a_camera(tmp_path, order):
    place = ["rggb", "grbg", "gbrg", "bggr"].index(order)
    mosaic = np.zeros((24, 32), np.uint8)
    mosaic[place // 2 :: 2, place % 2 :: 2] = 200
    [frame] = open_recording(write(tmp_path / "b.bag", [("/i", image(1, mosaic, f"bayer_{order}8"))])).frames()
    assert np.abs(frame.image[4:-4, 4:-4].astype(float) - 0.299 * 200).max() <= 3

import cv2
import numpy as np
import pytest

from vsx_ros.errors import InputError
from vsx_ros.io.image_encoding import GrayImages, decoded, gray_image, shift_for

COLOR = np.random.default_rng(1).integers(0, 256, (8, 12, 3), dtype=np.uint8)


@pytest.mark.parametrize(("encoding", "order"), [("rgb8", (0, 1, 2)), ("bgr8", (2, 1, 0))])
def test_colour_is_weighed_in_the_right_order(encoding, order):
    expected = COLOR[..., order[0]] * 0.299 + COLOR[..., order[1]] * 0.587 + COLOR[..., order[2]] * 0.114
    gray = gray_image(encoding, 8, 12, 36, COLOR.tobytes())
    assert np.abs(gray - expected).max() <= 1.0


@pytest.mark.parametrize(("order", "places"), [("rggb", 0), ("grbg", 1), ("gbrg", 2), ("bggr", 3)])
def test_a_red_scene_is_dark_grey_in_every_mosaic(order, places):
    mosaic = np.zeros((16, 16), np.uint8)
    mosaic[places // 2 :: 2, places % 2 :: 2] = 200
    gray = gray_image(f"bayer_{order}8", 16, 16, 16, mosaic.tobytes())
    assert np.abs(gray[4:-4, 4:-4].astype(float) - 0.299 * 200).max() <= 3


def test_rows_may_be_padded():
    padded = np.zeros((8, 20), np.uint8)
    padded[:, :12] = COLOR[..., 0]
    assert np.array_equal(gray_image("mono8", 8, 12, 20, padded.tobytes()), COLOR[..., 0])


@pytest.mark.parametrize("big_endian", [False, True])
def test_twelve_bits_fill_eight(big_endian):
    wide = np.linspace(0, 4095, 96).astype(">u2" if big_endian else "<u2")
    assert shift_for(wide.tobytes(), big_endian=big_endian) == 4
    images, shades = GrayImages(), []
    for values in (wide // 500, wide, wide // 2):  # a camera may begin in the dark
        content = values.astype(wide.dtype).tobytes()
        shades.append(images.of("mono16", 8, 12, 24, content, big_endian=big_endian).ravel())
    assert np.array_equal(shades[0], wide // 500)
    assert np.array_equal(shades[1], wide // 16)
    assert np.array_equal(shades[2], wide // 32)
    with pytest.raises(InputError):
        images.of("mono16", 8, 12, 24, b"\xff" * 100, big_endian=big_endian)
    assert np.array_equal(images.of("mono16", 8, 12, 24, wide.tobytes(), big_endian=big_endian).ravel(), wide // 16)
    assert np.array_equal(images.of("mono8", 8, 12, 12, bytes(range(96))).ravel(), np.arange(96))


@pytest.mark.parametrize(
    ("encoding", "step", "size"),
    [("jpeg", 24, 192), ("yuv422", 23, 192), ("mono8", 12, 95), ("mono8", 11, 96), ("rgb8", 12, 96)],
)
def test_wrong_messages_are_refused(encoding, step, size):
    with pytest.raises(InputError, match=r"image"):
        gray_image(encoding, 8, 12, step, bytes(size))


@pytest.mark.parametrize(("encoding", "place"), [("yuv422", 1), ("uyvy", 1), ("yuv422_yuy2", 0), ("yuyv", 0)])
def test_of_luminance_and_colour_the_luminance_is_taken(encoding, place):
    pairs = np.full((8, 12, 2), 128, np.uint8)
    pairs[..., place] = COLOR[..., 0]
    assert np.array_equal(gray_image(encoding, 8, 12, 24, pairs.tobytes()), COLOR[..., 0])


@pytest.mark.parametrize("order", ["rggb", "grbg", "gbrg", "bggr"])
def test_a_mosaic_of_sixteen_bits_is_that_of_eight(order):
    small = np.random.default_rng(2).integers(0, 256, (16, 16), dtype=np.uint8)
    wide = (small.astype("<u2") << 4).tobytes()
    expected = gray_image(f"bayer_{order}8", 16, 16, 16, small.tobytes())
    assert np.array_equal(gray_image(f"bayer_{order}16", 16, 16, 32, wide, shift_bits=4), expected)


def test_a_compressed_mosaic_is_told_by_its_format():
    mosaic = np.zeros((16, 16), np.uint8)
    mosaic[::2, ::2] = 200
    png = cv2.imencode(".png", mosaic)[1].tobytes()
    gray = decoded(png, "x", "bayer_rggb8; png compressed ")
    assert np.array_equal(gray, gray_image("bayer_rggb8", 16, 16, 16, mosaic.tobytes()))
    coloured = cv2.imencode(".png", COLOR)[1].tobytes()
    said = "bayer_rggb8; png compressed bgr8"
    assert np.abs(decoded(coloured, "x", said).astype(int) - decoded(coloured, "x").astype(int)).max() <= 1


def test_decoding_colour_files_gives_grey():
    png = cv2.imencode(".png", COLOR)[1].tobytes()
    assert np.abs(decoded(png, "x").astype(int) - cv2.cvtColor(COLOR, cv2.COLOR_BGR2GRAY)).max() <= 1
    for damaged in (b"", png[:30]):
        with pytest.raises(InputError, match="image 3"):
            decoded(damaged, "image 3")

import io
from typing import Any

import cv2
import numpy as np
import pytest
from PIL import Image

from vsx_ros.errors import InputError
from vsx_ros.io.image_encoding import GrayImages, gray_image, shift_for

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
    assert shift_for(wide) == 4
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


def shot(low: int, high: int, lamp: int = 0) -> bytes:
    """An image of 160x120 of 16 bits with values from low to high. lamp: the value of 8 pixels in a corner."""
    values = np.random.default_rng(4).integers(low, high, (120, 160), np.uint16, endpoint=True)
    if lamp:
        values[-4:, -2:] = lamp
    return values.tobytes()


def shades(images: GrayImages, content: bytes, encoding: str = "mono16") -> np.ndarray:
    return images.of(encoding, 120, 160, 320, content).astype(int)


@pytest.mark.parametrize("encoding", ["mono16", "bayer_grbg16"])
@pytest.mark.parametrize("top", [1000, 2000, 4095, 65535])
@pytest.mark.parametrize("seen", [1, 100])
def test_a_bright_spot_darkens_no_image_of_sixteen_bits(encoding: str, top: int, seen: int) -> None:
    images = GrayImages()
    for _ in range(seen):
        plain = shades(images, shot(60, 490), encoding)
    lit = shades(images, shot(60, 490, lamp=top), encoding)
    assert plain.max() > 200
    assert (lit[-2:, -1] == 255).all() or encoding != "mono16"
    assert np.array_equal(lit[:-8], plain[:-8])
    assert np.array_equal(shades(GrayImages(), shot(60, 490, lamp=top), encoding)[:-8], plain[:-8])


@pytest.mark.parametrize(("low", "high"), [(20, 45), (200, 225), (0, 0)])
def test_a_dark_beginning_does_not_set_the_brightness(low: int, high: int) -> None:
    images = GrayImages()
    for _ in range(100):
        shades(images, shot(low, high))
    for top in (400, 900, 2000):  # as the camera adapts to the light
        shades(images, shot(10, top))
    assert np.array_equal(shades(images, shot(10, 2000)), shades(GrayImages(), shot(10, 2000)))


def test_an_image_most_of_which_would_saturate_sets_the_brightness_again() -> None:
    images = GrayImages()
    for _ in range(100):
        shades(images, shot(0, 250))
    assert shades(images, shot(0, 450)).max() == 255
    assert np.array_equal(shades(images, shot(0, 4000)), shades(GrayImages(), shot(0, 4000)))


def test_a_channel_that_is_no_colour_does_not_darken_the_image() -> None:
    opaque = np.dstack([wide(12)] * 3 + [np.full((8, 12), 65535, np.uint16)])
    got = GrayImages().of("rgba16", 8, 12, 96, opaque.tobytes())
    assert np.abs(got - wide(8).astype(int)).max() <= 1


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
    gray = GrayImages().of_file(png, "x", "bayer_rggb8; png compressed ")
    assert np.array_equal(gray, gray_image("bayer_rggb8", 16, 16, 16, mosaic.tobytes()))
    coloured = cv2.imencode(".png", COLOR)[1].tobytes()
    said = "bayer_rggb8; png compressed bgr8"
    assert (
        np.abs(
            GrayImages().of_file(coloured, "x", said).astype(int) - GrayImages().of_file(coloured, "x").astype(int)
        ).max()
        <= 1
    )


def test_decoding_colour_files_gives_grey():
    png = cv2.imencode(".png", COLOR)[1].tobytes()
    assert np.abs(GrayImages().of_file(png, "x").astype(int) - cv2.cvtColor(COLOR, cv2.COLOR_BGR2GRAY)).max() <= 1
    for damaged in (b"", png[:30]):
        with pytest.raises(InputError, match="image 3"):
            GrayImages().of_file(damaged, "image 3")


def wide(bits: int) -> np.ndarray:
    return ((cv2.cvtColor(COLOR, cv2.COLOR_BGR2GRAY).astype(np.uint32) * ((1 << bits) - 1)) // 255).astype(np.uint16)


def saved(image: Image.Image, kind: str, **options: Any) -> bytes:
    file = io.BytesIO()
    image.save(file, kind, **options)
    return file.getvalue()


@pytest.mark.parametrize("bits", [8, 10, 12, 16])
@pytest.mark.parametrize("suffix", [".png", ".tiff", ".pgm"])
def test_files_of_sixteen_bits_are_as_bright_as_those_of_eight(bits: int, suffix: str) -> None:
    expected = wide(8).astype(int)
    got = GrayImages().of_file(cv2.imencode(suffix, wide(bits))[1].tobytes(), "x")
    assert (got.dtype, got.shape) == (np.uint8, expected.shape)
    assert np.abs(got - expected).max() <= 1


def test_the_files_of_one_camera_share_their_brightness() -> None:
    images = GrayImages()
    first, bright, dark = (cv2.imencode(".png", wide(12) // by)[1].tobytes() for by in (1, 1, 8))
    assert np.array_equal(images.of_file(first, "x"), images.of_file(bright, "x"))
    assert np.abs(images.of_file(dark, "x") - wide(8).astype(int) // 8).max() <= 1


@pytest.mark.parametrize("encoding", ["rgb16", "bgr16", "rgba16", "bgra16", "16UC3", "16UC4"])
def test_colour_of_sixteen_bits_is_that_of_eight(encoding: str) -> None:
    channels = 4 if "4" in encoding or "a" in encoding else 3
    small = np.random.default_rng(3).integers(0, 256, (8, 12, channels), dtype=np.uint8)
    eight = gray_image(encoding.replace("16", "8"), 8, 12, 12 * channels, small.tobytes())
    content = (small.astype("<u2") << 4).tobytes()
    assert np.array_equal(GrayImages().of(encoding, 8, 12, 24 * channels, content), eight)


def test_a_mosaic_in_a_file_of_sixteen_bits() -> None:
    small = np.random.default_rng(2).integers(0, 256, (16, 16), dtype=np.uint8)
    png = cv2.imencode(".png", small.astype(np.uint16) << 4)[1].tobytes()
    expected = gray_image("bayer_rggb8", 16, 16, 16, small.tobytes())
    assert np.array_equal(GrayImages().of_file(png, "x", "bayer_rggb16; png compressed"), expected)


@pytest.mark.parametrize("kind", ["JPEG", "PNG"])
def test_metadata_do_not_turn_the_camera(kind: str) -> None:
    image, exif = Image.fromarray(COLOR), Image.Exif()
    exif[0x112] = 6
    turned = GrayImages().of_file(saved(image, kind, exif=exif), "x")
    assert np.array_equal(turned, GrayImages().of_file(saved(image, kind), "x"))


@pytest.mark.parametrize(("mode", "kind"), [("1", "PNG"), ("1", "TIFF"), ("P", "PNG"), ("LA", "PNG"), ("CMYK", "JPEG")])
def test_other_files_are_as_grey_as_their_colours(mode: str, kind: str) -> None:
    smooth = cv2.resize(COLOR, (64, 48), interpolation=cv2.INTER_CUBIC)
    image = Image.fromarray(smooth).convert("RGB" if mode != "LA" else "L").convert(mode)
    expected = np.asarray(image.convert("RGB").convert("L"), int)
    assert np.abs(GrayImages().of_file(saved(image, kind), "x") - expected).mean() < 3


def test_transparent_pixels_keep_their_colour() -> None:
    image = Image.fromarray(COLOR).convert("RGBA")
    opaque = GrayImages().of_file(saved(image, "PNG"), "x")
    image.putalpha(0)
    assert np.array_equal(GrayImages().of_file(saved(image, "PNG"), "x"), opaque)


def test_what_cannot_be_right_is_refused_with_the_remedy() -> None:
    image = Image.fromarray(COLOR)
    refused = {
        "turns it": saved(image, "TIFF", tiffinfo={274: 6}),
        "alpha channel": saved(image.convert("RGBA"), "TIFF"),
        "32 bits": cv2.imencode(".tiff", COLOR[..., 0].astype(np.float32))[1].tobytes(),
        "int16": cv2.imencode(".tiff", COLOR[..., 0].astype(np.int16))[1].tobytes(),
    }
    for reason, content in refused.items():
        with pytest.raises(InputError, match=rf"image 3 .*{reason}.*save it"):
            GrayImages().of_file(content, "image 3")
    with pytest.raises(InputError, match="image 3 .*32FC1.*mono16"):
        GrayImages().of("32FC1", 8, 12, 48, bytes(8 * 48), name="image 3")

"""The size that an image file tells is the one that its decoder takes."""

import io
import os
import struct
import subprocess
import sys

import bombs
import cv2
import numpy as np
import pytest
from PIL import Image

from vsx_ros import MAX_PIXELS
from vsx_ros.io import image_file
from vsx_ros.io.image_file import camera_picture, check_image_size, picture

COLOR = np.random.default_rng(1).integers(0, 256, (8, 12, 3), dtype=np.uint8)
OTHERS = {
    "webp": b"RIFF\x00\x00\x00\x00WEBPVP8 ", "jpeg 2000": b"\0\0\0\x0cjP  \r\n\x87\n", "its codes": b"\xff\x4f\xff\x51",
    "radiance": b"#?RADIANCE\n", "exr": b"\x76\x2f\x31\x01", "pfm": b"PF\n1 1\n-1\n", "pam": b"P7\nWIDTH 1\n",
    "gif": b"GIF89a", "avif": b"\0\0\0\x1cftypavif", "sun raster": b"\x59\xa6\x6a\x95",
    "large tiff": bombs.big_tiff(64, 64),
}  # fmt: skip


@pytest.mark.parametrize("kind", OTHERS)
def test_what_opencv_decodes_besides_is_refused(kind: str) -> None:
    for read in (check_image_size, lambda content: picture(content, cv2.IMREAD_UNCHANGED)):
        with pytest.raises(ValueError, match="it is no JPEG, PNG, PGM, PPM, BMP or TIFF"):
            read(OTHERS[kind] + bytes(600))


def test_of_a_tiff_with_several_pages_the_first_counts() -> None:
    file = io.BytesIO()
    first, second = Image.fromarray(COLOR), Image.fromarray(np.zeros((300, 400, 3), np.uint8))
    first.save(file, "TIFF", save_all=True, append_images=[second])
    assert check_image_size(file.getvalue()) == (12, 8)
    image = picture(file.getvalue(), cv2.IMREAD_UNCHANGED)
    assert image is not None
    assert np.array_equal(image[..., ::-1], COLOR)


def with_bits_at(place: int) -> bytes:
    """A colour TIFF whose bits for each channel are three numbers at this place."""
    file = io.BytesIO()
    Image.fromarray(COLOR).save(file, "TIFF")
    content = bytearray(file.getvalue())
    (directory,) = struct.unpack_from("<I", content, 4)
    at = next(
        at for at in range(directory + 2, len(content), 12) if content[at : at + 8] == b"\x02\x01\x03\0\x03\0\0\0"
    )
    struct.pack_into("<I", content, at + 8, place)
    return bytes(content).ljust(place, b"\0") + struct.pack("<3H", 8, 8, 8)


def test_a_place_of_numbers_is_not_taken_for_a_number() -> None:
    assert np.array_equal(camera_picture(with_bits_at(0x10020), colour=True)[..., ::-1], COLOR)


def test_an_image_that_is_not_what_it_says_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    content = cv2.imencode(".png", COLOR)[1].tobytes()
    for told, refused in (((12, 8), False), ((8, 12), False), ((12, 9), True), ((4, 8), True)):
        monkeypatch.setattr(image_file, "_sizes", lambda _, told=told: [told])
        if refused:
            with pytest.raises(ValueError, match=f"says it has {told[0]}x{told[1]} pixels, and has 12x8"):
                picture(content, cv2.IMREAD_UNCHANGED)
        else:
            assert picture(content, cv2.IMREAD_UNCHANGED) is not None


@pytest.mark.parametrize(
    ("told", "pixels"),
    [
        (None, MAX_PIXELS), ("", MAX_PIXELS), ("9" * 5000, MAX_PIXELS), ("1000", 1000), ("4KB", 4096),
        ("64MB", MAX_PIXELS), (str(2**40), MAX_PIXELS), ("any", MAX_PIXELS),
    ],
)  # fmt: skip
def test_opencv_decodes_no_larger_image_whoever_imports_the_package(told: str | None, pixels: int) -> None:
    """It asks for the limit when it is loaded; a user's lower limit stays."""
    program = f"""
import vsx_ros.geometry.camera, cv2, numpy as np
for rows in ({pixels} // 512, {pixels} // 512 + 1):
    try:
        print(cv2.imdecode(np.frombuffer(b"P5 512 %d 255 " % rows, np.uint8), -1) is not None)
    except cv2.error as error:
        print("MAX_IMAGE_PIXELS" in str(error))
"""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
    environment.pop("OPENCV_IO_MAX_IMAGE_PIXELS", None)
    environment |= {} if told is None else {"OPENCV_IO_MAX_IMAGE_PIXELS": told}
    done = subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False", "True"]  # the first is cut short


def test_the_limit_holds_in_the_tests() -> None:
    with pytest.raises(cv2.error, match="MAX_IMAGE_PIXELS"):
        cv2.imdecode(np.frombuffer(b"P5 512 %d 255 " % (MAX_PIXELS // 512 + 1), np.uint8), cv2.IMREAD_UNCHANGED)

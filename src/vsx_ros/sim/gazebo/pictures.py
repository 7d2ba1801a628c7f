"""Pictures of a Gazebo world: opened to see their size, then decoded one at a time and packed for drawing."""

import math
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import FloatArray, Int32Array
from vsx_ros.errors import InputError, explained
from vsx_ros.geometry.camera import MAX_PIXELS
from vsx_ros.kernels.sim.mesh_scene import MIP_LEVELS
from vsx_ros.limits import DAMAGE, MIB
from vsx_ros.sim.scene import GREY
from vsx_ros.sim.textures import texture
from vsx_ros.sim.world import Material

MOST_GIVEN_PX, MOST_KEPT_PX = 8192, 2048  # sides of a picture: as read, and as drawn
MOST_BYTES = 128 * MIB  # of a picture's file
MOST_PIXELS = 12 * MAX_PIXELS  # of all pictures of a world, as read
MOST_TEXELS = 2**27  # of a world; a house has half of it; 4 bytes each
FORMATS = "PNG", "JPEG", "TGA", "BMP", "TIFF", "WEBP", "DDS", "GIF"  # as Pillow calls them
OPAQUE = 250  # alpha from here on counts as solid
_HOLE_PX = 512  # side of the map of a picture's holes, at most
_STRIP = 256  # rows that are packed together

Pixels = NDArray[np.uint8]  # (H, W, 3) red, green, blue, or with alpha (H, W, 4); row 0 at the top


class Picture(NamedTuple):
    """A texture that is not decoded yet. source: its file, or an image as Pillow opens it; two pictures are equal if it
    is the same object. size: width and height as drawn, powers of two. pixels: their number as read."""

    name: str
    source: Any
    size: tuple[int, int]
    pixels: int = 0

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Picture) and self.source is other.source

    def __hash__(self) -> int:
        return id(self.source)

    @property
    def texels(self) -> int:
        """Their number with all mip levels."""
        width, height = self.size
        return sum(max(width >> k, 1) * max(height >> k, 1) for k in range(max(width, height).bit_length()))


class Textures(NamedTuple):
    """P packed pictures. logs (P, 2): binary logarithms of width and height; texels: r, g, b, grey, as the square root
    of the reflectance; levels (P, 12): where each mip level begins; contrast (P,): standard deviation of the green
    values; alphas (P,): (h, w) of a picture with holes, else None."""

    logs: Int32Array
    levels: Int32Array
    texels: NDArray[np.uint32]
    contrast: FloatArray
    alphas: list[NDArray[np.uint8] | None]


def _fitting(side: int) -> int:
    """The power of two that a side is drawn with."""
    return min(MOST_KEPT_PX, 1 << max(0, math.ceil(math.log2(side) - 0.25)))


def _too_large(name: str, size: str) -> InputError:
    most = f"at most {MOST_GIVEN_PX} x {MOST_GIVEN_PX} and {MAX_PIXELS} in all are read"
    return InputError(f"texture {name} has {size} pixels, {most}; make it smaller")


def picture_of(name: str, image: Any) -> Picture:
    """A texture from an image as Pillow opens it. Raises InputError if it is too large."""
    width, height = image.size
    if image.format not in (None, "MPO", *FORMATS):  # MPO: a JPEG with more pictures
        raise InputError(f"texture {name} is of kind {image.format}, not of {', '.join(FORMATS)}; save it as PNG")
    if max(width, height) > MOST_GIVEN_PX or min(width, height) < 1 or width * height > MAX_PIXELS:
        raise _too_large(name, f"{width} x {height}")
    return Picture(name, image, (_fitting(width), _fitting(height)), width * height)


def _opened(path: Path) -> Any:
    from PIL import Image  # here, because only worlds with pictures need it

    with explained(InputError, f"texture {path} cannot be read", "save it again as PNG", DAMAGE):
        try:
            return Image.open(path, formats=FORMATS)
        except Image.DecompressionBombError:
            raise _too_large(str(path), "too many") from None


@lru_cache(maxsize=512)
def _read(path: Path, _changed_ns: int) -> Picture:
    if path.stat().st_size > MOST_BYTES:
        raise InputError(f"texture {path} has {path.stat().st_size} bytes, at most {MOST_BYTES} are read; shrink it")
    with _opened(path) as image:
        return picture_of(str(path), image)._replace(source=path)


def read_picture(path: Path) -> Picture:
    """The texture in a file; all that read it share one. Raises InputError as ``picture_of``, or if it is damaged so
    much that its size is unknown."""
    return _read(path, path.stat().st_mtime_ns)


def substitute(name: str) -> Picture:
    """Paint in place of a missing texture; the name fixes its pattern."""
    from PIL import Image

    seed = int.from_bytes(name.encode()[-6:], "little")
    grey = texture(Material(kind="paint", seed=seed % 2**31, brightness=0.6))
    return picture_of(f"in place of {name}", Image.fromarray(grey))


def no_picture(name: str) -> str:
    """What is told of it."""
    return f"texture {name} does not exist; paint is drawn in its place"


def painted(material: Material, name: str) -> Picture:
    """A procedural surface, without its tint; its reflectance is stored as the square root, as of all pictures."""
    from PIL import Image

    roots = 255.0 * np.sqrt(texture(material) / 255.0)
    return picture_of(name, Image.fromarray(np.rint(roots).astype(np.uint8)))


def joined(first: Textures, second: Textures) -> Textures:
    """All pictures of both."""
    levels = first.levels[: len(first.logs)], second.levels[: len(second.logs)] + np.int32(len(first.texels))
    return Textures(
        logs=np.concatenate([first.logs, second.logs]),
        levels=np.concatenate(levels),
        texels=np.concatenate([first.texels, second.texels]),
        contrast=np.concatenate([first.contrast, second.contrast]),
        alphas=[*first.alphas, *second.alphas],
    )


def pack(pictures: list[Picture]) -> Textures:
    """Decode the pictures one after another, and close them. Raises InputError for one that is damaged, and if they do
    not fit into memory."""
    count, needed = len(pictures), sum(picture.texels for picture in pictures)
    if needed > MOST_TEXELS:
        most = f"at most {MOST_TEXELS} can be drawn"
        raise InputError(f"the world's {count} textures have {needed} texels, {most}; leave some out")
    given = sum(picture.pixels for picture in pictures)
    if given > MOST_PIXELS:
        raise InputError(
            f"the world's {count} textures have {given} pixels, at most {MOST_PIXELS} are read; shrink them"
        )
    packed = Textures(
        logs=np.array([[side.bit_length() - 1 for side in p.size] for p in pictures], np.int32).reshape(-1, 2),
        levels=np.zeros((max(count, 1), MIP_LEVELS), np.int32),
        texels=np.zeros(1 + needed, np.uint32),
        contrast=np.zeros(count),
        alphas=[None] * count,
    )
    at = 0
    for row, picture in enumerate(pictures):
        pixels = _decoded(picture)
        packed.contrast[row] = pixels[::8, ::8, 1].std()
        packed.alphas[row] = _holes(pixels)
        _fill_levels(pixels, at, packed.levels[row], packed.texels)
        at += picture.texels
    return packed


def _decoded(picture: Picture) -> Pixels:
    """The pixels in the size they are drawn with; alpha only if the format has it."""
    kept = picture.source
    image = _opened(kept) if isinstance(kept, Path) else kept
    with explained(InputError, f"texture {picture.name} cannot be read", "save it again as PNG", DAMAGE):
        try:
            if image.format == "WEBP":
                return _decoded_webp(image, picture.size)
            clear = image.mode in ("RGBA", "LA", "PA", "RGBa", "La") or "transparency" in image.info
            mode = "RGBA" if clear else "RGB"
            read = _with_eight_bits(image) if image.mode in ("I", "F") or image.mode.startswith("I;16") else image
            given = read if read.mode == mode else read.convert(mode)
            shares = [max(1, a // b) for a, b in zip(given.size, picture.size)]
            pixels = np.asarray(given.reduce(shares) if max(shares) > 1 else given)  # first there: it needs less memory
        finally:
            image.close()  # one that is not read from a file, too: it is drawn once, and keeps its pixels
    if picture.size != (pixels.shape[1], pixels.shape[0]):
        pixels = cv2.resize(pixels, picture.size, interpolation=cv2.INTER_AREA)
    return np.asarray(pixels, np.uint8)


def _with_eight_bits(image: Any) -> Any:
    """Of a grey picture with 16 or 32: white is 65535, the largest integer if some are larger, or 1.0."""
    from PIL import Image

    values = np.fmax(np.asarray(image), 0)
    white = 1.0 if image.mode == "F" else 65535.0 if values.max() <= 65535 else 2.0**31 - 1.0
    return Image.fromarray(cv2.convertScaleAbs(values, alpha=255.0 / white))


def _decoded_webp(image: Any, size: tuple[int, int]) -> Pixels:
    """As ``_decoded``. OpenCV needs 200 MB for the largest picture, Pillow 512."""
    image.fp.seek(0)
    try:
        pixels = cv2.imdecode(np.frombuffer(image.fp.read(), np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error as error:
        raise ValueError(str(error)) from error
    if pixels is None:
        raise ValueError("it is no WebP picture")
    pixels = cv2.resize(pixels, size, interpolation=cv2.INTER_AREA)
    order = cv2.COLOR_BGRA2RGBA if pixels.shape[2] == 4 else cv2.COLOR_BGR2RGB
    return np.asarray(cv2.cvtColor(pixels, order), np.uint8)


def _with_grey(pixels: Pixels) -> Pixels:
    """(H, W, 4) with the grey value as the last: the root of the mean of squares, as reflectance is stored."""
    squares = np.square(np.arange(256, dtype=np.float32))
    weights = (GREY / GREY.sum()).astype(np.float32)[None]
    packed = np.empty((*pixels.shape[:2], 4), np.uint8)
    for top in range(0, len(pixels), _STRIP):  # bounds the memory
        strip = np.ascontiguousarray(pixels[top : top + _STRIP, :, :3])
        packed[top : top + _STRIP, :, :3] = strip
        mean = cv2.transform(cv2.LUT(strip, squares), weights)
        packed[top : top + _STRIP, :, 3] = cv2.convertScaleAbs(cv2.sqrt(mean))
    return packed


def _fill_levels(pixels: Pixels, at: int, begins: Int32Array, texels: NDArray[np.uint32]) -> None:
    """Write all mip levels to texels from ``at`` on, and where each begins to begins (12,)."""
    level = _with_grey(pixels)
    for k in range(MIP_LEVELS):
        begins[k:] = at
        texels[at : at + level[..., 0].size] = level.reshape(-1, 4).view(np.uint32).ravel()
        at += level[..., 0].size
        if level.shape[:2] == (1, 1):
            break
        size = max(level.shape[1] // 2, 1), max(level.shape[0] // 2, 1)
        level = np.ascontiguousarray(cv2.resize(level, size, interpolation=cv2.INTER_AREA)).reshape(*size[::-1], 4)


def _holes(pixels: Pixels) -> NDArray[np.uint8] | None:
    """Alpha, made smaller, if parts of the picture are cut out."""
    if pixels.shape[2] < 4 or not (pixels[..., 3] < OPAQUE // 2).any():
        return None
    alpha = np.ascontiguousarray(pixels[..., 3])
    size = min(alpha.shape[1], _HOLE_PX), min(alpha.shape[0], _HOLE_PX)
    return np.asarray(cv2.resize(alpha, size, interpolation=cv2.INTER_AREA)).reshape(*size[::-1])

"""What the triangles of a Gazebo world are made of: a colour and perhaps a picture."""

import math
import re
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from vsx_ros.errors import InputError, explained
from vsx_ros.limits import DAMAGE, MIB, file_text
from vsx_ros.sim.textures import texture
from vsx_ros.sim.world import Material

MOST_GIVEN_PX, MOST_KEPT_PX = 8192, 2048  # sides of a picture: as read, and as drawn
MOST_BYTES = 128 * MIB  # of a picture's file
OPAQUE = 250  # alpha from here on counts as solid

Colour = tuple[float, float, float]
Pixels = NDArray[np.uint8]  # (H, W, 4) red, green, blue, alpha; row 0 at the top
GREY: Colour = (0.7, 0.7, 0.7)


class Picture(NamedTuple):
    """A texture: pixels (H, W, 4) uint8, sides powers of two. Two of them are equal if they are the same object."""

    name: str
    pixels: Pixels

    def __eq__(self, other: object) -> bool:
        return self is other

    def __hash__(self) -> int:
        return id(self)

    @property
    def has_holes(self) -> bool:
        """Whether parts of it are cut out."""
        return bool((self.pixels[..., 3] < OPAQUE // 2).any())


class Surface(NamedTuple):
    """colour: factors of red, green and blue, as 8-bit pictures store them, up to 1. picture: or None."""

    colour: Colour = GREY
    picture: Picture | None = None


def _fitting(side: int) -> int:
    """The power of two that a side is drawn with."""
    return min(MOST_KEPT_PX, 1 << max(0, math.ceil(math.log2(side) - 0.25)))


def _too_large(name: str, size: str) -> InputError:
    most = f"at most {MOST_GIVEN_PX} x {MOST_GIVEN_PX} are read"
    return InputError(f"texture {name} has {size} pixels, {most}; make it smaller")


def picture_of(name: str, image: Any) -> Picture:
    """A texture from an image as Pillow opens it. Raises InputError if it is too large or damaged."""
    if max(image.size) > MOST_GIVEN_PX or min(image.size) < 1:
        raise _too_large(name, f"{image.size[0]} x {image.size[1]}")
    with explained(InputError, f"texture {name} cannot be read", "save it again as PNG", DAMAGE):
        pixels = np.asarray(image.convert("RGBA"))
    size = _fitting(pixels.shape[1]), _fitting(pixels.shape[0])
    if size != (pixels.shape[1], pixels.shape[0]):
        pixels = cv2.resize(pixels, size, interpolation=cv2.INTER_AREA)
    return Picture(name, np.ascontiguousarray(pixels, np.uint8))


@lru_cache(maxsize=512)
def _read(path: Path, _changed_ns: int) -> Picture:
    from PIL import Image  # here, because only worlds with pictures need it

    if path.stat().st_size > MOST_BYTES:
        raise InputError(f"texture {path} has {path.stat().st_size} bytes, at most {MOST_BYTES} are read; shrink it")
    with explained(InputError, f"texture {path} cannot be read", "save it again as PNG", DAMAGE):
        try:
            image = Image.open(path)
        except Image.DecompressionBombError:
            raise _too_large(str(path), "too many") from None
        with image:
            return picture_of(str(path), image)


def read_picture(path: Path) -> Picture:
    """The texture in a file, each file only once. Raises InputError as ``picture_of``."""
    return _read(path, path.stat().st_mtime_ns)


def substitute(name: str, colour: Colour) -> Surface:
    """Paint in place of a missing texture; the name fixes its pattern."""
    seed = int.from_bytes(name.encode()[-6:], "little")
    grey = texture(Material(kind="paint", seed=seed % 2**31, brightness=0.6))
    pixels = np.dstack([grey, grey, grey, np.full_like(grey, 255)])
    return Surface(colour, Picture(f"in place of {name}", pixels))


_GAZEBO_COLOURS: dict[str, Colour] = {
    "white": (1.0, 1.0, 1.0), "black": (0.05, 0.05, 0.05), "darkgrey": (0.25, 0.25, 0.25), "red": (0.9, 0.1, 0.1),
    "green": (0.1, 0.8, 0.1), "blue": (0.1, 0.1, 0.9), "yellow": (0.9, 0.9, 0.1), "orange": (0.95, 0.5, 0.1),
    "purple": (0.7, 0.1, 0.7), "turquoise": (0.1, 0.8, 0.8), "indigo": (0.33, 0.0, 0.5), "gold": (0.8, 0.65, 0.15),
    "wood": (0.6, 0.45, 0.3), "residential": (0.8, 0.75, 0.7), "sky": (0.5, 0.7, 0.95),
}  # fmt: skip


def gazebo_colour(script: str) -> Colour:
    """The colour of a material that Gazebo has built in, such as Gazebo/Red; grey for others."""
    word = script.rpartition("/")[2].lower()
    return next((colour for name, colour in _GAZEBO_COLOURS.items() if name in word), GREY)


_BLOCK = r"material\s+{}\b[^{{]*\{{(.*?)(?=\n\s*material\s|\Z)"


def ogre_material(
    script: Path, name: str, find: Callable[[str, Path], Path | None]
) -> tuple[Colour, Path | None, str] | None:
    """Colour, picture file and the picture's name of a material in OGRE scripts (a file or a folder of them); None if
    it is not there. find: as ``ModelFolders.find_texture``."""
    files = sorted(script.glob("*.material")) if script.is_dir() else [script]
    for file in files:
        try:
            text = file_text(file)
        except (OSError, ValueError):
            continue
        block = re.search(_BLOCK.format(re.escape(name)), text, re.DOTALL)
        if block is None:
            continue
        numbers = re.search(r"diffuse\s+([\d.]+)\s+([\d.]+)\s+([\d.]+)", block[1])
        colour = (float(numbers[1]), float(numbers[2]), float(numbers[3])) if numbers else (1.0, 1.0, 1.0)
        named = re.search(r"^\s*texture\s+(\S+)", block[1], re.MULTILINE)
        picture = named[1] if named else ""
        return colour, find(picture, file) if picture else None, picture
    return None

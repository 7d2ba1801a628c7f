"""What the triangles of a Gazebo world are made of: a colour and perhaps a picture."""

import math
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

from vsx_ros.limits import file_text
from vsx_ros.sim.gazebo.pictures import Picture

Colour = tuple[float, float, float]
GREY: Colour = (0.7, 0.7, 0.7)
WHITE: Colour = (1.0, 1.0, 1.0)


class Surface(NamedTuple):
    """colour: factors of red, green and blue, as 8-bit pictures store them, up to 1. picture: or None."""

    colour: Colour = GREY
    picture: Picture | None = None


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
        diffuse = re.search(r"diffuse\s+(\S+)\s+(\S+)\s+(\S+)", block[1])
        colour = _ogre_colour(diffuse.groups()) if diffuse else WHITE
        named = re.search(r"^\s*texture\s+(\S+)", block[1], re.MULTILINE)
        picture = named[1] if named else ""
        return colour, find(picture, file) if picture else None, picture
    return None


def _ogre_colour(words: Sequence[str]) -> Colour:
    """Of three words of a script, cut off at 0 and 1; white for words that are no numbers, as ``vertexcolour``."""
    try:
        r, g, b = (min(max(float(word), 0.0), 1.0) for word in words)
    except ValueError:
        return WHITE
    return (r, g, b) if math.isfinite(r + g + b) else WHITE

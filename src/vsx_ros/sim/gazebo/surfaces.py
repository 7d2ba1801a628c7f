"""What the triangles of a Gazebo world are made of: a colour and perhaps a picture."""

import math
import re
from collections.abc import Callable, Sequence
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

from vsx_ros.limits import MIB, file_text
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


GAZEBO = "Gazebo/"  # begins the names of materials that Gazebo has built in


def gazebo_colour(name: str) -> Colour:
    """The colour of a material that Gazebo has built in, by a word of its name, such as Gazebo/RedBright; else grey."""
    own = name.removeprefix(GAZEBO)
    words = {own.lower(), *(word.lower() for word in re.findall("[A-Z]?[a-z]+", own))}
    return next((colour for word, colour in _GAZEBO_COLOURS.items() if word in words), GREY)


_SCRIPT_BYTES = 2 * MIB
_BEGIN = re.compile(r"^[ \t]*material[ \t]+([^\s:{]+)", re.MULTILINE)
_DIFFUSE = re.compile(r"diffuse[ \t]+(\S{1,40})[ \t]+(\S{1,40})[ \t]+(\S{1,40})")
_TEXTURE = re.compile(r"^[ \t]*texture[ \t]+(\S{1,500})", re.MULTILINE)


def ogre_material(
    script: Path, name: str, find: Callable[[str, Path], Path | None]
) -> tuple[Colour, Path | None, str] | None:
    """Colour, picture file and the picture's name of a material in OGRE scripts (a file or a folder of them); None if
    it is not there. find: as ``ModelFolders.find_texture``."""
    files = sorted(script.glob("*.material")) if script.is_dir() else [script]
    for file in files:
        found = _materials(file, file.stat().st_mtime_ns if file.is_file() else 0).get(name)
        if found is not None:
            colour, picture = found
            return colour, find(picture, file) if picture else None, picture
    return None


@lru_cache(maxsize=64)
def _materials(file: Path, _changed_ns: int) -> dict[str, tuple[Colour, str]]:
    """Colour and picture's name of each material in a script; none if it cannot be read."""
    try:
        text = file_text(file, _SCRIPT_BYTES)
    except (OSError, ValueError):
        return {}
    found: dict[str, tuple[Colour, str]] = {}
    begins = list(_BEGIN.finditer(text))
    for begin, after in zip(begins, [*(match.start() for match in begins[1:]), len(text)]):
        diffuse, picture = _DIFFUSE.search(text, begin.end(), after), _TEXTURE.search(text, begin.end(), after)
        colour = _ogre_colour(diffuse.groups()) if diffuse else WHITE
        found.setdefault(begin[1], (colour, picture[1] if picture else ""))
    return found


def _ogre_colour(words: Sequence[str]) -> Colour:
    """Of three words of a script, cut off at 0 and 1; white for words that are no numbers, as ``vertexcolour``."""
    try:
        r, g, b = (min(max(float(word), 0.0), 1.0) for word in words)
    except ValueError:
        return WHITE
    return (r, g, b) if math.isfinite(r + g + b) else WHITE

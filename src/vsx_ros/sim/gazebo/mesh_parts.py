"""A mesh file's triangles and surfaces, whatever kind it is of."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from vsx_ros.arrays import FloatArray
from vsx_ros.sim.gazebo.pictures import read_picture, substitute
from vsx_ros.sim.gazebo.surfaces import Colour, Surface

FindTexture = Callable[[str, Path], Path | None]


class MeshPart(NamedTuple):
    """Triangles of one surface: corners (T, 3, 3) [m] in the mesh's own axes, uv (T, 3, 2). name: of the geometry;
    node: of what uses it in the file's scene. missing: name of a picture that does not exist, or empty."""

    corners: FloatArray
    uv: FloatArray
    surface: Surface
    name: str
    missing: str = ""
    node: str = ""

    def unmirrored(self, matrix: FloatArray) -> "MeshPart":
        """With faces that look the same way as before a matrix (3, 3) moved their corners: one that mirrors turns them
        around."""
        if np.linalg.det(matrix) >= 0.0:
            return self
        return self._replace(corners=self.corners[:, ::-1], uv=self.uv[:, ::-1])


class Mesh(NamedTuple):
    """What a mesh file holds. remarks: what is drawn otherwise than it says. lost: names of damaged things in it,
    without which its shape is another."""

    parts: list[MeshPart]
    remarks: list[str]
    lost: list[str]


def colour_of(values: Any) -> Colour:
    """Of at least three numbers, cut off at 0 and 1."""
    r, g, b = (min(max(float(value), 0.0), 1.0) for value in list(values)[:3])
    return r, g, b


def surface_of(name: str, colour: Colour, beside: Path, find_texture: FindTexture) -> tuple[Surface, str]:
    """The surface with a picture by its name, and the name if there is no such file."""
    file = find_texture(name, beside)
    return (Surface(colour, substitute(name)), name) if file is None else (Surface(colour, read_picture(file)), "")


def uv_of(given: Any, index: Any) -> FloatArray:
    """(T, 3, 2) texture coordinates (N, C) of corners (T, 3); one that the file leaves out is 0."""
    uv, shown = np.zeros((*np.shape(index), 2)), np.asarray(given, float)[index][..., :2]
    uv[..., : shown.shape[-1]] = shown
    return uv

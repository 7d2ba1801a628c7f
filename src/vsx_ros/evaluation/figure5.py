"""The paper's Figure 5 as a page: the same keyframes as a sparse and as a dense ground map, beside the truth."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import BoolArray
from vsx_ros.evaluation.coverage import TOLERANCE_M, metres_to
from vsx_ros.evaluation.obstacles import ObstacleQuality, obstacle_quality, on_truth
from vsx_ros.evaluation.page import Section, figures, paragraph, table
from vsx_ros.evaluation.svg import png_url
from vsx_ros.geometry.se2 import SE2
from vsx_ros.occupancy.grid import FREE, OCCUPIED, OccupancyGrid

_UNKNOWN_GREY, _FREE_WHITE, _FOUND, _MISSED, _PHANTOM = (
    (200,) * 3,
    (255,) * 3,
    (30, 30, 30),
    (40, 140, 255),
    (40, 40, 220),
)
_ROWS = (
    ("f1", "F1 of obstacles at 10 cm", ".3f"),
    ("precision", "occupied cells that are obstacles", ".3f"),
    ("recall", "seen faces that are there (the rest are gaps in the boundary)", ".3f"),
    ("surface_free", "seen faces called free", ".4f"),
    ("free_inside", "free cells over 10 cm inside an obstacle", ".4f"),
    ("gaps_free", "what is known of gaps 0.4 to 0.8 m wide that is free", ".3f"),
    ("phantom_m2", "phantom obstacles on free floor [m2]", ".4f"),
)


@dataclass(frozen=True)
class Figure5:
    """truth and faces (of ``seen_faces``), one grid a name, and where their origin truly lies. facts: how it came
    about, in words."""

    truth: OccupancyGrid
    faces: BoolArray
    grids: Sequence[tuple[str, OccupancyGrid]]
    T_truth_map: SE2
    facts: str

    def qualities(self) -> dict[str, ObstacleQuality]:
        """Of each grid."""
        return {name: obstacle_quality(grid, self.truth, self.faces, self.T_truth_map) for name, grid in self.grids}


def section(figure: Figure5) -> Section:
    """Its part of a page."""
    qualities = figure.qualities()
    rows = [[words, *(_number(q, key, form) for q in qualities.values())] for key, words, form in _ROWS]
    truth, faces, T_truth_map = figure.truth, figure.faces, figure.T_truth_map
    pictures = [("truth: faces that were seen", truth_picture(truth, faces))]
    pictures += [(name, map_on_truth_picture(grid, truth, faces, T_truth_map)) for name, grid in figure.grids]
    shown = [
        (name, f'<img width="{3 * image.shape[1]}" style="image-rendering:pixelated" alt="" src="{png_url(image)}">')
        for name, image in pictures
    ]
    legend = "Black: obstacles found. Orange: faces seen but missing. Red: phantom obstacles. White: free."
    body = paragraph(figure.facts) + figures(shown) + paragraph(legend) + table(["", *qualities], rows)
    return Section("Figure 5: ground map, sparse, dense, truth", body)


def _number(quality: ObstacleQuality, key: str, form: str) -> str:
    value = getattr(quality, key)
    return "unknown" if value is None else format(value, form)


def truth_picture(truth: OccupancyGrid, faces: BoolArray) -> NDArray[np.uint8]:
    """(H, W, 3) BGR, north up: free ground white, those faces of obstacles black."""
    image = np.full((*truth.shape, 3), _UNKNOWN_GREY, np.uint8)
    image[truth.data == FREE] = _FREE_WHITE
    image[faces] = _FOUND
    return image[::-1].copy()


def map_on_truth_picture(
    grid: OccupancyGrid, truth: OccupancyGrid, faces: BoolArray, T_truth_map: SE2
) -> NDArray[np.uint8]:
    """(H, W, 3) BGR, north up: a map whose origin truly lies at T_truth_map. Its obstacles black, those on free ground
    red, those of the faces (H, W) that it lacks orange."""
    image = np.full((*truth.shape, 3), _UNKNOWN_GREY, np.uint8)
    values = on_truth(grid, truth, T_truth_map)
    occupied = values == OCCUPIED
    image[values == FREE] = _FREE_WHITE
    image[faces & (metres_to(occupied, truth) > TOLERANCE_M)] = _MISSED
    image[occupied] = _FOUND
    far = metres_to(truth.data == OCCUPIED, truth) > TOLERANCE_M
    image[occupied & far & (truth.data == FREE)] = _PHANTOM
    return image[::-1].copy()

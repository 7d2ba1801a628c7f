"""How many rooms are found as they are: ``PYTHONPATH=src:hw python benchmarks/rooms.py [--seeds 0-19]``.

Two kinds of maps: the true maps of generated buildings, labs and offices (the generator knows its rooms and doors), and
the floor plans and robots' maps in $VSX_DATA/maps (rooms read from the pictures by eye, as rectangles and polygons; the
rest of the free ground is the corridor). A room is right when one found room has an intersection over union with it of
at least 0.8. The plans with furniture have the rooms of those without. In doubt, a part with a partial front wall
counts as a room of its own.
"""

import argparse
import os
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np

from vsx_ros.arrays import IntArray
from vsx_ros.config import RoomsConfig
from vsx_ros.occupancy.grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from vsx_ros.occupancy.room_cells import split
from vsx_ros.sim.generate import generate_world
from vsx_ros.sim.room_truth import right_rooms, room_truth
from vsx_ros.sim.truth import ground_truth_grid

CELL_M = 0.05
Shape = tuple[tuple[int, int], ...]  # corners in pixels: x to the right, y down


def row(y0: int, y1: int, *xs: tuple[int, int]) -> list[Shape]:
    """Rectangles side by side."""
    return [((x0, y0), (x1, y0), (x1, y1), (x0, y1)) for x0, x1 in xs]


PLANS: dict[str, list[Shape]] = {
    "office_a": [
        ((387, 20), (537, 20), (537, 103), (258, 103)),
        *row(20, 103, (544, 690), (697, 857), (865, 1002), (1009, 1147)),
        *row(109, 219, (1009, 1147)), *row(225, 334, (1009, 1147)), *row(341, 449, (1009, 1147)),
        *row(457, 565, (1009, 1147)),
        *row(572, 664, (388, 539), (545, 693), (700, 848), (854, 1003), (1009, 1147)),
        *row(155, 321, (435, 590), (594, 752)), *row(325, 430, (435, 590), (594, 752)),
        *row(433, 521, (435, 590), (594, 752)), *row(187, 372, (802, 955)), *row(423, 521, (802, 955)),
        *row(527, 664, (249, 383)), *row(110, 333, (249, 383)), *row(341, 520, (249, 383)),
        ((243, 118), (243, 664), (47, 664), (47, 510), (75, 350), (130, 230)),
    ],
    "office_b": [
        *row(119, 232, (33, 116), (124, 239), (246, 359), (367, 481), (489, 603)),
        *row(238, 351, (33, 116)), *row(359, 471, (33, 116)),
        *row(479, 566, (33, 116), (124, 239), (246, 359), (367, 481), (489, 603)),
        *row(290, 352, (169, 272), (279, 383), (389, 493), (500, 604)),
        *row(359, 422, (169, 272), (279, 383), (389, 493), (500, 604)),
        *row(165, 339, (655, 799), (805, 979)), *row(347, 521, (655, 799), (805, 979)),
        *row(119, 248, (1031, 1161)), *row(255, 357, (1031, 1161)), *row(364, 461, (1031, 1161)),
        *row(468, 566, (1031, 1161)),
        tuple((round(802 + 49 * np.cos(a)), round(342 + 49 * np.sin(a))) for a in np.arange(0.0, 6.2, 0.2)),
    ],
    "Freiburg52_scan": [
        *row(27, 120, (89, 174), (179, 275), (283, 411), (416, 545)),
        *row(177, 322, (25, 160), (167, 275), (283, 428), (439, 617)),
    ],
    "lab_ipa": [
        *row(97, 199, (109, 199)), *row(200, 261, (105, 197)), *row(102, 150, (245, 332)), *row(150, 265, (240, 330)),
        *row(352, 580, (404, 568)),
        ((197, 350), (230, 350), (318, 446), (318, 480), (227, 567), (192, 566), (104, 474), (104, 438)),
    ],
    "lab_a_scan": [
        *row(21, 122, (80, 164), (169, 247), (251, 328), (332, 411), (415, 493), (496, 575), (579, 660)),
        *row(167, 277, (80, 164)), *row(281, 366, (80, 164)),
        ((169, 167), (311, 167), (311, 287), (331, 287), (331, 366), (169, 366)),
        *row(167, 284, (315, 421)), *row(288, 366, (336, 421)),
        *row(421, 459, (78, 134), (139, 195), (199, 254), (258, 309), (365, 418), (423, 476), (480, 532), (535, 587)),
        *row(463, 567, (78, 135), (139, 196), (199, 254), (258, 310), (365, 419), (423, 477), (480, 532), (536, 587),
             (590, 648)),
        *row(597, 688, (168, 247), (251, 328), (332, 411), (415, 493), (497, 575), (579, 660)),
        *row(515, 594, (727, 803)),
    ],
    "lab_c_scan": [
        *row(107, 285, (118, 191)), *row(107, 179, (192, 279), (281, 365), (366, 452)), *row(105, 228, (453, 573)),
        *row(182, 285, (191, 248), (404, 454)), *row(230, 283, (500, 576)), *row(288, 436, (499, 574)),
        *row(330, 435, (114, 220), (223, 280), (283, 340), (342, 399), (402, 451), (454, 496)),
    ],
}  # fmt: skip
"""Rooms of each plan."""


def plan(path: Path) -> OccupancyGrid:
    """A picture of the collection: grey, colour or 16 bits; white is free, black a wall, grey unknown."""
    picture = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    picture = (picture // 257).astype(np.uint8) if picture.dtype == np.uint16 else picture
    grey = cv2.cvtColor(picture[..., :3], cv2.COLOR_BGR2GRAY) if picture.ndim == 3 else picture
    data = np.full(grey.shape, UNKNOWN, np.int8)
    data[grey >= 250], data[grey < 100] = FREE, OCCUPIED
    return OccupancyGrid(data[::-1], CELL_M, 0.0, 0.0)


def rooms_of_plan(grid: OccupancyGrid, shapes: list[Shape]) -> IntArray:
    """(H, W) the rooms read from the picture, and the corridor."""
    truth = np.ones(grid.shape, np.int32)
    for number, shape in enumerate(shapes, start=2):
        cv2.fillPoly(truth, [np.array(shape, np.int32)], number)
    return np.where(grid.data == FREE, truth[::-1].astype(np.int64), 0)


def judged(name: str, maps: Callable[[], list[tuple[OccupancyGrid, IntArray]]], config: RoomsConfig) -> tuple[int, int]:
    """Print and return how many rooms of some maps are right, and how many there are."""
    counts = [right_rooms(split(grid, config), truth) for grid, truth in maps()]
    right, all_rooms = (sum(column) for column in zip(*counts))
    print(f"{name:24} {right:4} of {all_rooms:4} rooms right, {100 * right / all_rooms:5.1f} %", flush=True)
    return right, all_rooms


def built(kind: str, seeds: range) -> list[tuple[OccupancyGrid, IntArray]]:
    """True maps and rooms of generated worlds."""
    found = []
    for seed in seeds:
        world = generate_world(kind, seed)
        grid = ground_truth_grid(world, CELL_M, 0.06, 0.6)
        found.append((grid, np.where(grid.data == FREE, room_truth(world, grid), 0)))
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", default="0-19", help="first-last, of the generated worlds")
    args = parser.parse_args()
    first, _, last = args.seeds.partition("-")
    seeds, config = range(int(first), int(last or first) + 1), RoomsConfig()
    for kind in ("building", "lab", "office"):
        judged(f"{kind} {args.seeds}", lambda kind=kind: built(kind, seeds), config)
    folder = Path(os.environ.get("VSX_DATA", "")) / "maps"
    totals = []
    for path in sorted(folder.glob("*.png")):
        shapes = PLANS[path.stem.removesuffix("_furnitures")]
        grid = plan(path)
        totals.append(judged(path.stem, lambda g=grid, s=shapes: [(g, rooms_of_plan(g, s))], config))
    if totals:
        right, all_rooms = (sum(column) for column in zip(*totals))
        print(f"{'all plans':24} {right:4} of {all_rooms:4} rooms right, {100 * right / all_rooms:5.1f} %")


if __name__ == "__main__":
    main()

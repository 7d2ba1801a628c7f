"""Solids of a triangle world that its pictures do not show: a camera cannot know of them."""

from collections import Counter

import cv2
import numpy as np

from vsx_ros.kernels.sim.mesh_slab import slab_polygons
from vsx_ros.occupancy.grid import FREE, OCCUPIED
from vsx_ros.sim.mesh_world import SLICE_M, MeshWorld
from vsx_ros.sim.truth import fill, ground_truth_grid

CELL_M = 0.05
APART_M = 0.10  # between a solid and what is drawn


def hidden_solids(world: MeshWorld) -> list[tuple[str, float]]:
    """Names of models, and how many metres of their borders along free ground have nothing drawn within 10 cm at a
    robot's height; the longest first."""
    truth = ground_truth_grid(world, CELL_M, *SLICE_M)
    corner = np.array([truth.origin_x, truth.origin_y])
    polygons, counts, triangles = world.slab(*SLICE_M)
    shapes = np.zeros(truth.shape, np.int32)  # number of the shape, from 1
    for polygon, count, triangle in zip(polygons, counts, triangles):
        fill(shapes, (polygon[:count] - corner) / CELL_M, int(world.parts.owners[triangle]) + 1)
    bare = np.ones(truth.shape, np.uint8)
    polygons, counts, _ = slab_polygons(world.parts.seen.corners.astype(float), *SLICE_M)
    for polygon, count in zip(polygons, counts):
        fill(bare, (polygon[:count] - corner) / CELL_M, 0)
    far = cv2.distanceTransform(bare, cv2.DIST_L2, cv2.DIST_MASK_PRECISE) * CELL_M > APART_M
    beside_free = cv2.dilate((truth.data == FREE).astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    found = shapes[(truth.data == OCCUPIED) & beside_free & far]
    models = Counter(world.parts.names[shape - 1].partition("/")[0] for shape in found[found > 0])
    return [(model, cells * CELL_M) for model, cells in models.most_common()]

"""What the movers of a world of triangles look like, and where their triangles are at an instant."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from vsx_ros.arrays import Float32Array, FloatArray
from vsx_ros.kernels.sim.mesh_scene import MeshScene
from vsx_ros.sim.gazebo.assemble import Seen
from vsx_ros.sim.gazebo.pictures import pack, painted
from vsx_ros.sim.moving import Mover
from vsx_ros.sim.moving_quads import DrawnMovers
from vsx_ros.sim.scene import Quad
from vsx_ros.sim.textures import texture_size
from vsx_ros.sim.world import Material

_CORNERS = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])  # of a quad, in u and v
_HALVES = np.array([[0, 1, 2], [0, 2, 3]])


class MeshMovers:
    """seen: the triangles of the movers, which are the last ones of their scene; each in the frame of its rigid part,
    which is one group."""

    def __init__(self, movers: Sequence[Mover]) -> None:
        self._drawn = DrawnMovers(movers)
        self.seen = _seen(self._drawn)
        self._part_of = np.repeat(self._drawn.part_of, len(_HALVES))

    def placed(self, states: FloatArray) -> Float32Array:
        """(S, T, 3, 3) corners [m] for the states (S, B, K) at the middle of the image: of a person who walks, the
        first and the last row of an image are 3 cm apart."""
        R, t = self._drawn.frames(states[:, states.shape[1] // 2][:, None])
        R, t = R[:, 0, self._part_of], t[:, 0, self._part_of]
        corners = np.einsum("stij,tcj->stci", R, self.seen.corners.astype(float)) + t[:, :, None]
        return np.asarray(corners, np.float32)


class MovingMesh(NamedTuple):
    """A scene whose last triangles are those of its movers, not yet in place."""

    scene: MeshScene
    movers: MeshMovers

    @property
    def still(self) -> MeshScene:
        """Without the triangles of the movers."""
        scene, first = self.scene, len(self.scene.corners) - len(self.movers.seen.corners)
        return scene._replace(corners=scene.corners[:first], uv=scene.uv[:first], kinds=scene.kinds[:first])

    def moved(self, states: FloatArray) -> MeshScene:
        """The triangles of the movers alone, where they are at the middle of an image."""
        scene, first = self.scene, len(self.scene.corners) - len(self.movers.seen.corners)
        corners = self.movers.placed(states)[len(states) // 2]
        return scene._replace(corners=corners.reshape(-1, 9), uv=scene.uv[first:], kinds=scene.kinds[first:])


def _seen(drawn: DrawnMovers) -> Seen:
    names = sorted({quad.material for quad in drawn.quads})
    materials = [drawn.materials[name] for name in names]
    corners = np.array([_corners(quad) for quad in drawn.quads])
    uv = np.array([_uv(quad, drawn.materials[quad.material]) for quad in drawn.quads])
    ends = np.cumsum(np.bincount(drawn.part_of)) * len(_HALVES)
    return Seen(
        corners=corners[:, _HALVES].reshape(-1, 3, 3).astype(np.float32),
        uv=uv[:, _HALVES].reshape(-1, 3, 2).astype(np.float32),
        kinds=np.repeat([names.index(quad.material) for quad in drawn.quads], len(_HALVES)).astype(np.int32),
        starts=np.concatenate([[0], ends]),
        colours=np.sqrt([material.tint for material in materials]),
        pictures=np.arange(len(names)),
        textures=pack([painted(material, name) for material, name in zip(materials, names)]),
    )


def _corners(quad: Quad) -> FloatArray:
    """(4, 3)."""
    return quad.corner + _CORNERS[:, :1] * quad.edge_u + _CORNERS[:, 1:] * quad.edge_v


def _uv(quad: Quad, material: Material) -> FloatArray:
    """(4, 2), v upwards."""
    lengths = np.array([np.linalg.norm(quad.edge_u), -np.linalg.norm(quad.edge_v)])
    side_m = material.texel_m * texture_size(material)
    return np.asarray((_CORNERS * lengths + [quad.along, 0.0]) / side_m)

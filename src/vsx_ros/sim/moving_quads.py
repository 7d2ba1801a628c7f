"""What the movers of a world look like: their quads, and where these are and how they are lit at an instant."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from vsx_ros.arrays import FloatArray, IntArray
from vsx_ros.kernels.sim.raycast_cull import Scene, plane_forms
from vsx_ros.sim.light_map import Lights, Nodes
from vsx_ros.sim.moving import Mover
from vsx_ros.sim.scene import Quad, solid_quads

FULL_LIGHT = 1.0 / 255.0 / 255.0  # a surface's light scale for irradiance 1


class Moved(NamedTuple):
    """Where the rigid parts are: T_world_part with rotations R (S, B, P, 3, 3) and positions t (S, B, P, 3) [m], at
    sub-frame s and border b, as the camera's; light (M,): irradiance on each of their quads."""

    R: FloatArray
    t: FloatArray
    light: FloatArray

    def at(self, sub_frame: int) -> "Moved":
        """At one sub-frame alone."""
        once = slice(sub_frame, sub_frame + 1)
        return self._replace(R=self.R[once], t=self.t[once])


class DrawnMovers:
    """The movers of a world as quads, which are the last ones of its scene. part_of (Q,): the rigid part of each."""

    def __init__(self, movers: Sequence[Mover]) -> None:
        parts = [
            [quad for solid in part for quad in solid_quads(solid, top=True, bottom=True)]
            for mover in movers
            for part in mover.parts
        ]
        self.quads: list[Quad] = [quad for part in parts for quad in part]
        self.materials = {name: material for mover in movers for name, material in mover.materials.items()}
        sizes = [len(part) for part in parts]
        self._movers, self._ends = movers, np.cumsum([0, *sizes])
        self.part_of = np.repeat(np.arange(len(parts)), sizes)
        self._middles = np.array([quad.corner + 0.5 * (quad.edge_u + quad.edge_v) for quad in self.quads])
        normals = np.array([np.cross(quad.edge_v, quad.edge_u) for quad in self.quads])
        self._normals = normals / np.linalg.norm(normals, axis=1, keepdims=True)

    def at(self, states: FloatArray, lights: Lights) -> Moved:
        """Where they are for the states (S, B, K) of all movers, one after another, and how the lights fall on them."""
        R, t = self.frames(states)
        R0, t0 = R[0, 0, self.part_of], t[0, 0, self.part_of]
        middles = (R0 @ self._middles[..., None])[..., 0] + t0
        return Moved(R, t, lights.on(Nodes(middles, (R0 @ self._normals[..., None])[..., 0])))

    def frames(self, states: FloatArray) -> tuple[FloatArray, FloatArray]:
        """R (S, B, P, 3, 3) and t (S, B, P, 3) [m] of the rigid parts, T_world_part, for the states (S, B, K)."""
        flat = states.reshape(-1, states.shape[-1])
        R, t = _frames(self._poses(flat))
        return R.reshape(*states.shape[:2], *R.shape[1:]), t.reshape(*states.shape[:2], *t.shape[1:])

    def lit(self, scene: Scene, moved: Moved) -> Scene:
        """The scene with their light."""
        surfaces = scene.surfaces.copy()
        surfaces[len(surfaces) - len(self.quads) :, 4] = moved.light * FULL_LIGHT
        return scene._replace(surfaces=surfaces)

    def forms(self, scene: Scene, poses: tuple[FloatArray, FloatArray], moved: Moved) -> tuple[FloatArray, IntArray]:
        """As ``plane_forms`` for the whole scene: each part is seen by a camera that moves as it sees the part move."""
        R, t = poses
        first = len(scene.P) - len(self.quads) + self._ends
        forms, visible = plane_forms(_part(scene, 0, int(first[0])), R, t)
        all_forms, pool = [forms], [visible]
        for p, (a, b) in enumerate(zip(first[:-1].tolist(), first[1:].tolist())):
            back = moved.R[:, :, p].swapaxes(-1, -2)
            offset = np.ascontiguousarray((back @ (t - moved.t[:, :, p])[..., None])[..., 0])
            forms, visible = plane_forms(_part(scene, a, b), np.ascontiguousarray(back @ R), offset)
            all_forms.append(forms)
            pool.append(visible + a)
        return np.concatenate(all_forms, axis=2), np.concatenate(pool)

    def _poses(self, states: FloatArray) -> FloatArray:
        """(N, P, 5) of the states (N, K)."""
        cuts = np.cumsum([len(mover.state) for mover in self._movers])[:-1]
        split = [np.split(state, cuts) for state in states]
        return np.array([np.concatenate([m.poses(s) for m, s in zip(self._movers, each)]) for each in split])


def _frames(poses: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Rotations (N, P, 3, 3) and positions (N, P, 3) of poses (N, P, 5): x, y, z, yaw, pitch."""
    cy, sy, cp, sp = (f(poses[..., k]) for k in (3, 4) for f in (np.cos, np.sin))
    zero = np.zeros_like(cy)
    rows = [cy * cp, -sy, cy * sp, sy * cp, cy, sy * sp, -sp, zero, cp]
    return np.stack(rows, axis=-1).reshape(*poses.shape[:2], 3, 3), poses[..., :3]


def _part(scene: Scene, a: int, b: int) -> Scene:
    return scene._replace(P=scene.P[a:b], U=scene.U[a:b], V=scene.V[a:b])

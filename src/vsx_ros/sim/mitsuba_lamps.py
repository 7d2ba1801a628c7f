"""Which lamps light what a camera sees: paths look for these more often, which takes noise away and changes no mean."""

from typing import Any

import numpy as np

from vsx_ros.arrays import Float32Array, FloatArray
from vsx_ros.sim.lit_surfaces import LitLamp

_LEAST = 0.02  # share of a lamp that none of the points sees: it may light them by a bounce
_NEARER_M = 0.02  # than a lamp, what hides it
_OFF_M = 0.001  # from a surface, where looking for a lamp begins


def favour(mi: Any, scene: Any, lamps: list[LitLamp], origins: Float32Array, directions: Float32Array) -> None:
    """Weigh the lamps of a scene by their mean share of the light on what the rays (3, N) hit."""
    if len(lamps) < 2:
        return
    hits = scene.ray_intersect(mi.Ray3f(mi.Point3f(origins), mi.Vector3f(directions)))
    points, normals = (np.asarray(part, float).reshape(3, -1).T for part in (hits.p, hits.n))
    points, normals = (part[np.asarray(hits.is_valid(), bool)] for part in (points, normals))
    light = np.stack([_light(mi, scene, lamp, points + _OFF_M * normals, normals) for lamp in lamps])
    shares = light / np.maximum(light.sum(axis=0), 1e-9)
    weights = len(lamps) * (shares.mean(axis=1) + _LEAST)
    params = mi.traverse(scene)
    for key in [key for key in params.keys() if key.endswith("sampling_weight")]:  # noqa: SIM118 (no mapping)
        name = key.split(".")[0]
        if name.startswith("lamp"):
            params[key] = float(weights[int(name[4:])])
    params.update()


def _light(mi: Any, scene: Any, lamp: LitLamp, points: FloatArray, normals: FloatArray) -> FloatArray:
    """(N,) irradiance by a lamp at points with normals (N, 3)."""
    if lamp.kind == "directional":
        return np.maximum(-normals @ lamp.direction, 0.0) * lamp.strength
    way = lamp.place - points
    far = np.linalg.norm(way, axis=1)
    way /= far[:, None]
    light = lamp.strength * np.maximum((normals * way).sum(axis=1), 0.0) / far**2
    if lamp.kind == "panel":
        light *= np.maximum(-way @ lamp.direction, 0.0)
    rays = mi.Ray3f(mi.Point3f(points.T.astype(np.float32)), mi.Vector3f(way.T.astype(np.float32)))
    rays.maxt = mi.Float((far - _NEARER_M).astype(np.float32))
    return np.where(np.asarray(scene.ray_test(rays), bool), 0.0, light)

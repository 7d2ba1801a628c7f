"""A scene of ``lit_surfaces`` in Mitsuba's own objects."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from vsx_ros.arrays import Float32Array
from vsx_ros.sim.lit_surfaces import PANEL_M, Lighting, LitLamp, Surface

BOUNCES = 5  # segments of a path, at most
_GLOSS_ALPHA = 0.08  # roughness of a polished floor
_MATT_IOR, _MOST_IOR = 1.05, 6.0  # bounds of a coat's index of refraction


class MitsubaScenes:
    """Scenes that share what stands still. mi: the package."""

    def __init__(self, mi: Any, still: Sequence[Surface]) -> None:
        self._mi = mi
        self._pictures: dict[int, Any] = {}
        self._still = {f"still{k}": self._shape(surface) for k, surface in enumerate(still)}

    def lit(self, lighting: Lighting, moving: Sequence[Surface] = ()) -> Any:
        """The scene in this light, with these surfaces. Its integrator also gives the reflectance of what is seen."""
        path = {"type": "path", "max_depth": BOUNCES}
        tree: dict[str, Any] = {"type": "scene", **self._still}
        tree["integrator"] = {"type": "aov", "aovs": "reflectance:albedo", "path": path}
        tree |= {f"moving{k}": self._shape(surface) for k, surface in enumerate(moving)}
        tree |= {f"lamp{k}": self._lamp(lamp) for k, lamp in enumerate(lighting.lamps)}
        if lighting.sky or not lighting.lamps:  # Mitsuba needs something that shines
            tree["sky"] = {"type": "constant", "radiance": {"type": "rgb", "value": lighting.sky / math.pi}}
        return self._mi.load_dict(tree)

    def _shape(self, surface: Surface) -> Any:
        mi = self._mi
        properties = mi.Properties()
        properties["bsdf"] = mi.load_dict(self._finish(surface))
        if surface.glow:
            glow = {"type": "area", "radiance": self._texture(surface.picture * (surface.glow / math.pi))}
            properties["emitter"] = mi.load_dict(glow)
        mesh = mi.Mesh("surface", len(surface.corners), len(surface.faces), props=properties, has_vertex_texcoords=True)
        params = mi.traverse(mesh)
        params["vertex_positions"] = surface.corners.ravel().astype(np.float32)
        params["vertex_texcoords"] = surface.uv.ravel().astype(np.float32)
        params["faces"] = surface.faces.ravel().astype(np.uint32)
        params.update()
        return mesh

    def _finish(self, surface: Surface) -> dict[str, Any]:
        """The BSDF."""
        if surface.finish == "mirror":
            share = {"type": "rgb", "value": surface.share}
            return {"type": "conductor", "material": "none", "specular_reflectance": share}
        if surface.finish == "glass":  # a pane's two faces are both there, and each reflects on its two sides
            half = 0.5 * surface.share
            return {"type": "thindielectric", "int_ior": _index(half / (2.0 - half)), "ext_ior": 1.0}
        bsdf: dict[str, Any] = {"type": "diffuse", "reflectance": self._texture(surface.picture)}
        if surface.finish == "gloss":
            index = float(np.clip(_index(surface.share), _MATT_IOR, _MOST_IOR))
            coat = {"type": "roughplastic", "alpha": _GLOSS_ALPHA, "int_ior": index, "ext_ior": 1.0}
            bsdf = coat | {"diffuse_reflectance": bsdf["reflectance"]}
        if surface.both_sides:
            bsdf = {"type": "twosided", "bsdf": bsdf}
        if surface.alpha is not None:
            bsdf = {"type": "mask", "opacity": self._texture(surface.alpha), "bsdf": bsdf}
        return bsdf

    def _texture(self, picture: Float32Array) -> Any:
        values = np.ascontiguousarray(picture if picture.ndim == 3 else picture[..., None], np.float32)
        return self._mi.load_dict({"type": "bitmap", "data": self._mi.TensorXf(values), "raw": True})

    def _lamp(self, lamp: LitLamp) -> dict[str, Any]:
        mi, strength = self._mi, {"type": "rgb", "value": lamp.strength}
        place, direction = lamp.place.tolist(), lamp.direction.tolist()
        if lamp.kind == "panel":
            radiance = {"type": "rgb", "value": lamp.strength / PANEL_M**2}
            to_world = mi.ScalarTransform4f().translate(place).rotate([1, 0, 0], 180).scale(0.5 * PANEL_M)
            black = {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.0}}
            emitter = {"type": "area", "radiance": radiance}
            return {"type": "rectangle", "to_world": to_world, "bsdf": black, "emitter": emitter}
        if lamp.kind == "directional":
            return {"type": "directional", "direction": direction, "irradiance": strength}
        if lamp.kind == "point":
            return {"type": "point", "position": place, "intensity": strength}
        up = [1.0, 0.0, 0.0] if abs(direction[2]) > 0.9 else [0.0, 0.0, 1.0]
        to_world = mi.ScalarTransform4f().look_at(place, (lamp.place + lamp.direction).tolist(), up)
        return {
            "type": "spot", "to_world": to_world, "intensity": strength,
            "cutoff_angle": min(math.degrees(lamp.cutoff_rad), 89.0),
        }  # fmt: skip


def _index(share: float) -> float:
    """The index of refraction of a surface that reflects this share of light from straight ahead (Fresnel)."""
    return (1.0 + math.sqrt(share)) / (1.0 - math.sqrt(share))

"""What a path tracer is given of a world."""

import numpy as np
from sim_views import plain_room

from vsx_ros.sim.hard_things import named_things
from vsx_ros.sim.lit_surfaces import lighting_of, still_surfaces
from vsx_ros.sim.optics import scene_of
from vsx_ros.sim.textures import texture
from vsx_ros.sim.world import Light, Material, Poster, World

FITTED = Poster(x=0.0, y=2.0, z=1.0, yaw_rad=0.0, width=1.0, height=0.5, material="picture")


def with_picture(kind: str = "poster") -> World:
    room = plain_room()
    materials = room.materials | {"picture": Material(kind=kind, seed=3, tint=(1.0, 0.5, 0.25))}  # type: ignore[arg-type]
    return plain_room(materials=materials, posters=[FITTED])


def normals(corners: np.ndarray, faces: np.ndarray) -> np.ndarray:
    a, b, c = (corners[faces[:, k]] for k in range(3))
    cross = np.cross(b - a, c - a)
    return cross / np.linalg.norm(cross, axis=1, keepdims=True)


def test_surfaces_face_the_room() -> None:
    middle = np.array([3.0, 2.0, 1.25])
    for surface in still_surfaces(scene_of(plain_room())):
        inwards = middle - surface.corners[surface.faces[:, 0]]
        assert ((normals(surface.corners, surface.faces) * inwards).sum(axis=1) > 0.0).all()


def test_a_picture_hangs_upright_and_has_its_colours() -> None:
    world = with_picture()
    hung = next(s for s in still_surfaces(scene_of(world)) if s.picture.ndim == 3)
    grey = texture(world.materials["picture"]) / 255.0
    assert np.allclose(hung.picture, grey[..., None] * [1.0, 0.5, 0.25], atol=1e-6)
    top_left = hung.corners[np.argmin(hung.uv.sum(axis=1))]
    assert np.allclose(top_left, [0.004, 1.5, 1.25], atol=1e-6)  # seen from inside, with x ahead, y is to the left


def test_lamps_under_the_ceiling_are_panels_and_bounced_light_stands_for_the_ambient() -> None:
    lamps = [Light(x=2.0, y=2.0, z=2.4, strength=1.0), Light(x=1.0, y=0.4, z=1.4, strength=2.0)]
    with_lamps = lighting_of(scene_of(plain_room(lights=lamps)))
    assert [(lamp.kind, lamp.strength) for lamp in with_lamps.lamps] == [("panel", 2.0), ("point", 2.0)]
    assert with_lamps.ambient == 0.0
    assert lighting_of(scene_of(plain_room())).ambient == 1.0


def test_what_reflects_or_shines_says_so() -> None:
    kinds = {kind: still_surfaces(scene_of(with_picture(kind))) for kind in ("mirror", "glass", "outside")}
    assert any(s.finish == "mirror" and s.share == 0.9 for s in kinds["mirror"])
    assert any(s.finish == "glass" and s.share == 0.08 for s in kinds["glass"])
    assert any(abs(s.glow - 8.0) < 1e-5 for s in kinds["outside"])
    glossy = plain_room(hard=named_things(["glossy-floor=0.15"], "--with"))
    assert sum(s.finish == "gloss" for s in still_surfaces(scene_of(glossy))) == 1

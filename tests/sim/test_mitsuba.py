"""The path tracer against our own renderer; only where Mitsuba is installed."""

import dataclasses
import importlib.util

import numpy as np
import pytest
from msgspec.structs import replace
from sim_views import PERFECT, camera_in, plain_room, standing

from vsx_ros.arrays import BoolArray, FloatArray, IntArray
from vsx_ros.sim.camera import KINECT, EmulatedCamera
from vsx_ros.sim.renderer import Picture
from vsx_ros.sim.world import Box, Light, Material, World

if importlib.util.find_spec("mitsuba") is None:
    pytest.skip("Mitsuba is not installed: pip install 'vsx_ros[mitsuba]'", allow_module_level=True)

SMALL = dataclasses.replace(KINECT, width=160, height=120, fx=129.3, fy=129.1, cx=79.6, cy=63.8)
RASTER = replace(PERFECT, lens=SMALL)
MITSUBA = replace(RASTER, eye="mitsuba", mitsuba_samples=16)
PLACE = 1.5, 2.0, 0.1
BOX = Box(x=3.5, y=2.0, length=1.0, width=0.8, height=0.5, material="red")


def both(world: World, *place: float) -> tuple[FloatArray, FloatArray]:
    """What our renderer and Mitsuba see."""
    ours, theirs = (camera_in(world, settings).picture(0, standing(*place)) for settings in (RASTER, MITSUBA))
    return ours.radiance, theirs.radiance


def edges(bright: BoolArray) -> FloatArray:
    """Where each column turns from bright to dark, in pixels from above."""
    return bright.sum(axis=0).astype(float)


def test_edges_lie_within_a_pixel_of_ours() -> None:
    ours, theirs = both(plain_room(boxes=[BOX]), *PLACE)
    off = edges(ours > 0.5) - edges(theirs > 0.5)
    assert edges(ours > 0.5).min() > 5
    assert np.abs(off).max() <= 1.0


def test_even_light_without_lamps_is_as_bright_as_ours() -> None:
    ours, theirs = both(plain_room(), *PLACE)
    assert np.median(theirs / ours) == pytest.approx(1.0, abs=0.03)
    floor = slice(100, 120), slice(None)
    assert theirs[floor].mean() == pytest.approx(ours[floor].mean(), rel=0.02)


def test_the_floor_below_a_lamp_is_twice_as_bright_as_ours_if_nothing_else_reflects() -> None:
    """A panel gives the lower half of a point's light, and most of it straight down."""
    black = {"white": Material(kind="plain", brightness=0.02), "dark": Material(kind="plain", brightness=0.2)}
    lamp = Light(x=3.0, y=2.0, z=2.4, strength=5.0)
    ours, theirs = both(plain_room(materials=black, ambient=0.0, lights=[lamp]), 1.5, 2.0, 0.0)
    below = slice(90, 110), slice(70, 90)
    assert theirs[below].mean() == pytest.approx(2.0 * ours[below].mean(), rel=0.15)


def test_light_bounces_from_white_walls() -> None:
    """A box keeps its side away from the lamp from the lamp alone."""
    lamp = Light(x=5.5, y=2.0, z=2.4, strength=2.0)
    white = plain_room(boxes=[BOX], ambient=0.0, lights=[lamp])
    black = replace(white, materials=white.materials | {"white": Material(kind="plain", brightness=0.0)})
    lit, dark = (camera_in(world, MITSUBA).picture(0, standing(*PLACE), want_depth=True) for world in (white, black))
    side = (lit.depth > 1.2) & (lit.depth < 1.6) & (np.arange(120)[:, None] < 80)
    assert lit.radiance[side].mean() > 5.0 * dark.radiance[side].mean()


def test_rows_are_seen_from_where_the_camera_was_then() -> None:
    def turning(stamps: IntArray) -> FloatArray:
        zero = np.zeros(len(stamps))
        return np.column_stack([zero + 1.5, zero + 2.0, 0.1 + 2e-9 * stamps, zero])

    def left_of_box(settings: object) -> FloatArray:
        picture: Picture = camera_in(plain_room(boxes=[BOX]), settings).picture(0, turning)  # type: ignore[arg-type]
        rows = picture.radiance[62:72]
        return np.asarray([np.argmin(np.gradient(row[:80])) for row in rows], float)

    shutter = {"readout_ns": 50_000_000}
    ours, theirs = (left_of_box(replace(settings, **shutter)) for settings in (RASTER, MITSUBA))
    assert np.abs(ours - theirs).max() <= 1.0


def test_a_moment_has_its_own_noise_and_always_the_same() -> None:
    world = plain_room(lights=[Light(x=3.0, y=2.0, z=2.4, strength=5.0)])

    def seen(camera: EmulatedCamera, stamp_ns: int) -> FloatArray:
        return camera.picture(stamp_ns, standing(*PLACE)).radiance

    camera, again = camera_in(world, MITSUBA), camera_in(world, MITSUBA)
    first, second = seen(camera, 200_000_000), seen(camera, 400_000_000)
    assert not np.array_equal(first, second)
    assert np.array_equal(second, seen(again, 400_000_000))
    assert np.array_equal(first, seen(again, 200_000_000))


def test_the_mosaic_sees_the_colours_of_things() -> None:
    world = plain_room(boxes=[BOX])
    mosaic = camera_in(world, MITSUBA).picture(0, standing(1.5, 2.0, 0.0), bayer=True).radiance
    box = mosaic[66:72, 70:90]
    red, green, blue = box[0::2, 1::2], box[0::2, 0::2], box[1::2, 0::2]
    assert red.mean() == pytest.approx(0.6, rel=0.05)
    assert green.mean() == pytest.approx(0.15, rel=0.05)
    assert blue.mean() == pytest.approx(0.3, rel=0.05)

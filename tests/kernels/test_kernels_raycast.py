"""A small picture of a few quads, ray by ray."""

import numpy as np

from vsx_ros.kernels.sim.raycast_cull import Scene, plane_forms
from vsx_ros.kernels.sim.raycast_pixels import View
from vsx_ros.kernels.sim.raycast_render import render_tile_rows
from vsx_ros.kernels.sim.raycast_shade import TILE

HEIGHT, WIDTH = 20, 28
TEXEL, LIGHT, LIGHT_SCALE, TINTS = 100, 200, 1e-4, np.array([0.2, 0.5, 0.8, 0.6])


def rays(rows, columns):
    """rx, ry of pixels -1.. of whole tiles and two more, principal point in the middle, focal length 20 px."""
    v, u = np.mgrid[-1 : rows * TILE + 2, -1 : columns * TILE + 2]
    return ((u - 13.5) / 20.0).astype(np.float32), ((v - 9.5) / 20.0).astype(np.float32)


def quads():
    """Corner and edges of a wall, a board before it that covers a part of it, and one turned away."""
    P = np.array([[-3.0, -3.0, 3.0], [-0.3, -0.2, 1.0], [0.1, -0.6, 2.0]])
    U = np.array([[6.0, 0.0, 0.5], [0.5, 0.1, 0.3], [0.0, 0.6, 0.0]])
    V = np.array([[0.0, 6.0, 0.0], [-0.1, 0.4, 0.0], [0.6, 0.0, 0.0]])
    return P, U, V


def rendered(sub_frames=1, bayer=False):
    P, U, V = quads()
    rows, columns = -(-HEIGHT // TILE), -(-WIDTH // TILE)
    rx, ry = rays(rows, columns)
    bounds = np.empty((rows, columns, 4))
    for ty, tx in np.ndindex(rows, columns):
        at = np.s_[ty * TILE : ty * TILE + TILE + 2, tx * TILE : tx * TILE + TILE + 2]
        bounds[ty, tx] = rx[at].min(), rx[at].max(), ry[at].min(), ry[at].max()
    R = np.tile(np.eye(3), (sub_frames, rows + 1, 1, 1))
    surfaces = np.tile(np.array([1.0, 1.0, 0.0, 0.0, LIGHT_SCALE], np.float32), (3, 1))
    places = np.tile(np.array([0, 0, 0, 2, 2], np.int32), (3, 1))
    texels = np.array([TEXEL * 0x01010101], np.int32), np.full(4, LIGHT * 0x01010101, np.uint32).view(np.int32)
    scene = Scene(P, U, V, surfaces, places, np.tile(TINTS.astype(np.float32), (3, 1)), *texels)
    forms, pool = plane_forms(scene, R, np.zeros((sub_frames, rows + 1, 3)))
    view = View(scene, forms, rx, ry, bayer)
    picture, depth = np.zeros((2, HEIGHT, WIDTH), np.float32)
    ident = np.full((HEIGHT, WIDTH), -1, np.int32)
    render_tile_rows(0, rows, view, pool, bounds, picture, depth, ident)
    return pool, picture, depth, ident


def ray_by_ray(pool):
    """Depth and quad of each pixel."""
    rx, ry = (table[1 : HEIGHT + 1, 1 : WIDTH + 1].astype(float) for table in rays(2, 2))
    depth, ident = np.full((HEIGHT, WIDTH), np.inf), np.full((HEIGHT, WIDTH), -1)
    corners, along_u, along_v = quads()
    for q in pool:
        corner, u, v = corners[q], along_u[q], along_v[q]
        for y, x in np.ndindex(HEIGHT, WIDTH):
            ray = np.array([rx[y, x], ry[y, x], 1.0])
            s, a, b = np.linalg.solve(np.column_stack([ray, -u, -v]), corner)
            if 0.0 < s < depth[y, x] and 0.0 <= a <= 1.0 and 0.0 <= b <= 1.0:
                depth[y, x], ident[y, x] = s, q
    return depth, ident


def test_depth_and_quad_are_those_of_every_ray():
    pool, _, depth, ident = rendered()
    assert pool.tolist() == [0, 1]
    expected, who = ray_by_ray(pool)
    assert set(who.ravel().tolist()) == {0, 1}
    assert (ident == who).mean() > 0.995  # a ray may graze an edge
    same = (ident == who) & (who >= 0)
    assert np.allclose(depth[same], expected[same], rtol=1e-5)


def test_an_even_surface_in_even_light_has_one_brightness():
    bright = TEXEL * LIGHT * LIGHT_SCALE
    for sub_frames in (1, 2):
        _, grey, _, _ = rendered(sub_frames)
        assert np.allclose(grey, bright * TINTS[3], rtol=1e-4)
    _, mosaic, _, _ = rendered(bayer=True)
    assert np.allclose(mosaic[0::2, 0::2], bright * TINTS[1], rtol=1e-4)
    assert np.allclose(mosaic[0::2, 1::2], bright * TINTS[0], rtol=1e-4)
    assert np.allclose(mosaic[1::2, 0::2], bright * TINTS[2], rtol=1e-4)
    assert np.allclose(mosaic[1::2, 1::2], bright * TINTS[1], rtol=1e-4)

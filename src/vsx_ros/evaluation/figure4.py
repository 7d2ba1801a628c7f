"""The paper's Figure 4 as a page: a picture, its sparse points, their planes, and what of those is surface."""

import cv2
import numpy as np

from vsx_ros.arrays import FloatArray, GrayImage, IntArray, Pixels
from vsx_ros.evaluation.page import Section, figures, paragraph
from vsx_ros.evaluation.svg import png_url


def section(
    image: GrayImage, points: Pixels, planes: IntArray, cells: FloatArray, cell_planes: IntArray, facts: str
) -> Section:
    """Its part of a page. points (N, 2): where map points were found in the image; planes (N,): of which plane each is,
    -1 for none. cells (M, 4, 2): corners of what is surface, the farthest first; cell_planes (M,). facts: how it came
    about, in words."""
    of_plane = {plane: points[planes == plane] for plane in np.unique(planes).tolist()}
    hulls = [
        _area(plane, cv2.convexHull(own.astype(np.float32))[:, 0], 0.35)
        for plane, own in of_plane.items()
        if plane >= 0 and len(own) > 2
    ]
    areas = [_area(plane, corners, 0.75) for plane, corners in zip(cell_planes.tolist(), cells)]
    pictures = [
        ("(a) a keyframe", _over(image, [])),
        ("(b) map points found in it", _over(image, [_dots(-1, points)])),
        ("(c) planes by J-linkage", _over(image, hulls + [_dots(*item) for item in of_plane.items()])),
        ("(d) what of them is surface, by points and photo-consistency", _over(image, areas)),
    ]
    return Section("Figure 4: from points to planes to surface", paragraph(facts) + figures(pictures))


def _over(image: GrayImage, parts: list[str]) -> str:
    """Drawings over the picture, paled."""
    height, width = image.shape
    picture = f'<image width="{width}" height="{height}" opacity="{0.6 if parts else 1}" href="{png_url(image)}"/>'
    return f'<svg viewBox="0 0 {width} {height}" role="img">{picture}{"".join(parts)}</svg>'


def _area(plane: int, corners: FloatArray, opacity: float) -> str:
    points = " ".join(f"{u:.1f},{v:.1f}" for u, v in corners)
    return f'<polygon points="{points}" fill="{_colour(plane)}" fill-opacity="{opacity}"/>'


def _dots(plane: int, pixels: Pixels) -> str:
    path = "".join(f"M{u:.1f},{v:.1f}h0" for u, v in pixels)
    return f'<path class="dots" style="stroke:{_colour(plane)};opacity:1" d="{path}"/>'


def _colour(plane: int) -> str:
    """Of each plane another one, red for none."""
    return f"hsl({40 + 101 * plane % 280} 75% 45%)" if plane >= 0 else "#c83232"

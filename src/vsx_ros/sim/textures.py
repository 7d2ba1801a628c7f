"""Procedural textures: a kind and a seed give a square image; no image files."""

from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import GrayImage, Int32Array
from vsx_ros.sim.world import Material

Rng = np.random.Generator
Pattern = NDArray[np.float32]  # (S, S) deviation from the mean reflectance; 1 is full scale


def _noise(rng: Rng, size: int, cells: int) -> Pattern:
    """(size, size) smooth noise that repeats seamlessly, ``cells`` lattice points per side, standard deviation 1."""
    lattice = rng.standard_normal((cells, cells)).astype(np.float32)
    padded = np.pad(lattice, 2, mode="wrap")
    scale = size // cells
    large = cv2.resize(padded, None, fx=scale, fy=scale, interpolation=cv2.INTER_CUBIC)
    cut = large[2 * scale : 2 * scale + size, 2 * scale : 2 * scale + size]
    return np.asarray(cut / max(float(cut.std()), 1e-6), np.float32)


def _plain(rng: Rng, size: int) -> Pattern:
    return np.zeros((size, size), np.float32)


def _paint(rng: Rng, size: int) -> Pattern:
    return 0.006 * _noise(rng, size, size // 16) + 0.006 * _noise(rng, size, size // 2)


def _wallpaper(rng: Rng, size: int) -> Pattern:
    """Woodchip paper: low contrast, with scattered small chips and a faint repeating motif."""
    picture = 0.012 * _noise(rng, size, size // 4) + 0.012 * _noise(rng, size, size // 16)
    for _ in range(size * size // 900):
        x, y = (int(v) for v in rng.integers(4, size - 4, 2))
        axes = (int(rng.integers(1, 5)), int(rng.integers(1, 3)))
        value = float(rng.choice([-0.17, -0.12, 0.1, 0.14]))
        cv2.ellipse(picture, (x, y), axes, float(rng.uniform(0, 180)), 0, 360, value, -1)
    return picture


def _wood(rng: Rng, size: int) -> Pattern:
    rows = np.arange(size, dtype=np.float32)[:, None] / size
    warp = 0.02 * _noise(rng, size, 4)
    lines = rng.standard_normal(64).astype(np.float32)
    phase = (rows + warp) % 1.0 * 64
    low = phase.astype(np.int64) % 64
    mix = phase - np.floor(phase)
    grain = lines[low] * (1 - mix) + lines[(low + 1) % 64] * mix
    picture = 0.07 * grain + 0.03 * _noise(rng, size, size // 8)
    for _ in range(10):
        centre = int(rng.integers(24, size - 24)), int(rng.integers(24, size - 24))
        axes = int(rng.integers(6, 14)), int(rng.integers(3, 8))
        cv2.ellipse(picture, centre, axes, 0, 0, 360, -0.28, -1)
    for board in np.split(picture, 4):
        board += 0.08 * rng.standard_normal()
        board[:2] -= 0.25
        joint = int(rng.integers(0, size - 2))
        board[:, joint : joint + 2] -= 0.25
    return picture


def _brick(rng: Rng, size: int) -> Pattern:
    picture = np.full((size, size), 0.22, np.float32)
    height, width = size // 16, size // 8
    for top in range(0, size, height):
        for left in range(0, size, width):
            shifted = left + top // height % 2 * width // 2
            columns = np.arange(shifted + 2, shifted + width - 1) % size
            picture[top + 2 : top + height - 1, columns] = float(0.13 * rng.standard_normal() - 0.05)
    return picture + 0.03 * _noise(rng, size, size // 4)


def _carpet(rng: Rng, size: int) -> Pattern:
    picture = 0.06 * _noise(rng, size, size // 4) + 0.07 * _noise(rng, size, size // 16)
    picture += 0.05 * _noise(rng, size, size // 64)
    for _ in range(size * size // 2600):
        x, y = int(rng.integers(8, size - 8)), int(rng.integers(8, size - 8))
        side = int(rng.integers(4, 13))
        value = float(rng.choice([-0.30, -0.2, 0.2, 0.3]))
        if rng.random() < 0.5:
            cv2.circle(picture, (x, y), side // 2 + 1, value, -1)
        else:
            picture[y : y + side, x : x + int(rng.integers(4, 13))] = value
    return picture


def _tiles(rng: Rng, size: int) -> Pattern:
    picture = 0.03 * _noise(rng, size, size // 8) + 0.05 * _noise(rng, size, size // 32)
    step = size // 16
    for row in np.split(picture, 16):
        for part in np.split(row, 16, axis=1):
            part += float(0.10 * rng.standard_normal())
            for _ in range(int(rng.integers(2, 9))):
                x, y = (int(v) for v in rng.integers(8, step - 8, 2))
                cv2.circle(part, (x, y), int(rng.integers(2, 6)), float(rng.uniform(-0.3, 0.3)), -1)
            part[:2] -= 0.25
            part[:, :2] -= 0.25
    return picture


def _text_line(picture: Pattern, rng: Rng, box: tuple[int, int, int, int], ink: float) -> None:
    """Letter-like strokes in the box (x0, y0, x1, y1)."""
    x, y0, x1, y1 = box
    height = y1 - y0
    while x < x1 - height // 2:
        width = int(rng.integers(max(height // 2, 2), height + 2))
        if rng.random() > 0.15:
            stroke = max(1, height // 6)
            points = rng.integers(0, [width, height], (int(rng.integers(3, 6)), 2)) + [x, y0]
            cv2.polylines(picture, [points.astype(np.int32)], False, ink, stroke)
        x += width + max(1, height // 4)


def _shape(picture: Pattern, rng: Rng, low: int, high: int, value: float) -> None:
    """One filled disc, triangle, quadrilateral or ring at a random place."""
    size = picture.shape[0]
    centre = rng.integers(size // 12, size - size // 12, 2)
    radius, kind = int(rng.integers(low, high)), int(rng.integers(4))
    if kind < 2:
        cv2.circle(picture, centre.tolist(), radius, value, -1 if kind == 0 else max(2, radius // 4))
    else:
        angles = np.sort(rng.uniform(0, 2 * np.pi, kind + 1))
        corners = centre + radius * np.column_stack([np.cos(angles), np.sin(angles)])
        cv2.fillPoly(picture, [corners.astype(np.int32)], value)


def _poster(rng: Rng, size: int) -> Pattern:
    background = float(rng.choice([-0.3, 0.25, 0.35]))
    picture = np.full((size, size), background, np.float32)
    for low, high, number in ((size // 7, size // 4, 4), (size // 16, size // 8, 12), (size // 40, size // 20, 26)):
        for _ in range(number):
            _shape(picture, rng, low, high, float(rng.uniform(-0.5, 0.4)))
    y = int(rng.integers(size // 12, size // 4))
    for _ in range(int(rng.integers(3, 7))):
        height = int(rng.choice([size // 40, size // 24, size // 14]))
        if y + height > size - size // 12:
            break
        ink = -0.5 if background > 0 else 0.38
        cv2.rectangle(picture, (size // 12, y - 4), (size - size // 12, y + height + 4), background, -1)
        _text_line(picture, rng, (size // 10, y, size - size // 10, y + height), ink)
        y += int(height * rng.uniform(1.8, 4.5))
    frame = max(4, size // 40)
    cv2.rectangle(picture, (0, 0), (size - 1, size - 1), -0.45, 2 * frame)
    return picture


def _print(rng: Rng, size: int) -> Pattern:
    """A cardboard box: faint fibres, tape, labels, stamped signs."""
    picture = 0.02 * _noise(rng, size, size // 4) + 0.03 * _noise(rng, size, size // 32)
    middle = int(rng.uniform(0.3, 0.7) * size)
    picture[:, middle : middle + size // 12] += 0.15
    for _ in range(int(rng.integers(5, 9))):
        x, y = (int(v) for v in rng.integers(0, size - size // 5, 2))
        width, height = (int(v) for v in rng.integers(size // 10, size // 4, 2))
        paper = float(rng.choice([0.35, 0.3, -0.3, -0.4]))
        cv2.rectangle(picture, (x, y), (x + width, y + height), paper, -1)
        for line in range(y + 4, y + height - 12, 16):
            _text_line(picture, rng, (x + 4, line, x + width - 4, line + int(rng.integers(6, 12))), -paper)
    for _ in range(16):
        _shape(picture, rng, size // 60, size // 16, float(rng.choice([-0.35, -0.25, 0.25])))
    return picture


def _panels(rng: Rng, size: int) -> Pattern:
    """Ceiling panels: a grid of joints with faint dots."""
    picture = 0.01 * _noise(rng, size, size // 2)
    step = size // 4
    for joint in range(0, size, step):
        picture[joint : joint + 3] -= 0.18
        picture[:, joint : joint + 3] -= 0.18
    return picture


def _outside(rng: Rng, size: int) -> Pattern:
    """Sky over something dark, far out of focus, behind a window's bars."""
    rows = np.arange(size, dtype=np.float32)[:, None] / size
    picture = np.where(rows + 0.04 * _noise(rng, size, 8) < 0.6, 0.3, -0.25).astype(np.float32)
    picture += 0.05 * _noise(rng, size, 16)
    bar = size // 32
    for at in (0, size // 2, size - bar):
        picture[at : at + bar] = picture[:, at : at + bar] = -0.5
    return picture


_PATTERNS: dict[str, tuple[Callable[[Rng, int], Pattern], int]] = {
    "plain": (_plain, 64), "paint": (_paint, 256), "wood": (_wood, 512), "brick": (_brick, 512),
    "carpet": (_carpet, 2048), "tiles": (_tiles, 2048), "wallpaper": (_wallpaper, 512), "poster": (_poster, 512),
    "print": (_print, 512), "panels": (_panels, 256),
    "mirror": (_plain, 64), "glass": (_plain, 64), "outside": (_outside, 256),
}  # fmt: skip


def texture_size(material: Material) -> int:
    """Texels along a side of its image."""
    return _PATTERNS[material.kind][1]


def texture(material: Material) -> GrayImage:
    """(S, S) uint8 reflectance of a material, 255 = 1.0; S is a power of two. Equal materials give equal images."""
    draw, size = _PATTERNS[material.kind]
    pattern = draw(np.random.default_rng([material.seed, 77]), size)
    picture = 255.0 * (material.brightness + material.contrast * pattern)
    return np.asarray(np.clip(np.rint(picture), 0, 255), np.uint8)


def packed_levels(picture: GrayImage) -> Int32Array:
    """All mip levels of a square power-of-two texture, finest first, flat int32. Each entry packs the 2x2 texels
    starting there (right, below, below right in the higher bytes), with wrap-around."""
    levels = []
    level = picture.astype(np.float32)
    while True:
        t = np.clip(np.rint(level), 0, 255).astype(np.uint32)
        right = np.roll(t, -1, axis=1)
        below, diagonal = np.roll(t, -1, axis=0), np.roll(right, -1, axis=0)
        levels.append((t | right << 8 | below << 16 | diagonal << 24).ravel().view(np.int32))
        if level.shape[0] == 1:
            return np.concatenate(levels)
        level = 0.25 * (level[::2, ::2] + level[1::2, ::2] + level[::2, 1::2] + level[1::2, 1::2])

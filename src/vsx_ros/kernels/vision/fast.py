"""FAST-9 corners (Rosten and Drummond 2006), those that OpenCV finds without suppression; it makes an object of each.

A pixel is a corner if 9 successive pixels of the circle of 16 around it are all brighter or all darker by more than a
threshold. Bytes only, and no branch within 32 pixels of a row, so that the compiler vectorises."""

import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import GrayImage
from vsx_ros.kernels import kernel, loop_kernel, part

U8, U = np.uint8, np.uint64
RING = 3  # radius of the circle [px]
BLOCK = 32


@part
def brightest_arc(
    p0: np.uint8, p1: np.uint8, p2: np.uint8, p3: np.uint8, p4: np.uint8, p5: np.uint8, p6: np.uint8, p7: np.uint8,
    p8: np.uint8, p9: np.uint8, p10: np.uint8, p11: np.uint8, p12: np.uint8, p13: np.uint8, p14: np.uint8,
    p15: np.uint8,
) -> np.uint8:  # fmt: skip
    """The largest grey level that 9 successive pixels of a circle reach."""
    a, b, c, d = min(p1, p2), min(p3, p4), min(p5, p6), min(p7, p8)
    e, f, g, h = min(p9, p10), min(p11, p12), min(p13, p14), min(p15, p0)
    ab, bc, cd, de = min(a, b), min(b, c), min(c, d), min(d, e)
    ef, fg, gh, ha = min(e, f), min(f, g), min(g, h), min(h, a)
    # Eight successive pixels, and the better of the two beside them.
    x, y = min(min(ab, cd), max(p0, p9)), min(min(bc, de), max(p2, p11))
    x, y = max(x, min(min(cd, ef), max(p4, p13))), max(y, min(min(de, fg), max(p6, p15)))
    x, y = max(x, min(min(ef, gh), max(p8, p1))), max(y, min(min(fg, ha), max(p10, p3)))
    x, y = max(x, min(min(gh, ab), max(p12, p5))), max(y, min(min(ha, bc), max(p14, p7)))
    return U8(max(x, y))


@part
def above(a: np.uint8, b: np.uint8) -> np.uint8:
    """How much brighter a is than b, at least 0."""
    return U8(a - min(a, b))


@part
def negative(a: np.uint8) -> np.uint8:
    """The grey level in the negative."""
    return U8(U8(255) - a)


@kernel
def mark_candidates(
    up: NDArray[np.uint8], here: NDArray[np.uint8], down: NDArray[np.uint8], limit: np.uint8, marks: NDArray[np.uint8]
) -> None:
    """Mark those pixels of a row (W,) that can be corners by four pixels of the circle; marks begin at RING. up, down:
    the rows RING px above and below."""
    for x in range(RING, here.shape[0] - RING):
        a, b, c, d = up[U(x)], here[U(x + RING)], down[U(x)], here[U(x - RING)]
        brighter, darker = min(max(a, c), max(b, d)), max(min(a, c), min(b, d))
        v = here[U(x)]
        marks[U(x - RING)] = max(above(brighter, v), above(v, darker)) > limit


@loop_kernel
def mark_corners(pixels: NDArray[np.uint8], start: int, width: int, limit: np.uint8, marks: NDArray[np.uint8]) -> None:
    """Mark the corners (BLOCK,) among the pixels from ``start`` on."""
    a, b, c, d = start - 3 * width, start - 2 * width, start - width, start
    e, f, g = start + width, start + 2 * width, start + 3 * width
    for i in range(BLOCK):
        p0, p1, p2, p3 = pixels[U(g + i)], pixels[U(g + i + 1)], pixels[U(f + i + 2)], pixels[U(e + i + 3)]
        p4, p5, p6, p7 = pixels[U(d + i + 3)], pixels[U(c + i + 3)], pixels[U(b + i + 2)], pixels[U(a + i + 1)]
        p8, p9, p10, p11 = pixels[U(a + i)], pixels[U(a + i - 1)], pixels[U(b + i - 2)], pixels[U(c + i - 3)]
        p12, p13, p14, p15 = pixels[U(d + i - 3)], pixels[U(e + i - 3)], pixels[U(f + i - 2)], pixels[U(g + i - 1)]
        v = pixels[U(d + i)]
        brighter = brightest_arc(p0, p1, p2, p3, p4, p5, p6, p7, p8, p9, p10, p11, p12, p13, p14, p15)
        darker = negative(
            brightest_arc(
                negative(p0), negative(p1), negative(p2), negative(p3), negative(p4), negative(p5), negative(p6),
                negative(p7), negative(p8), negative(p9), negative(p10), negative(p11), negative(p12), negative(p13),
                negative(p14), negative(p15),
            )
        )  # fmt: skip
        marks[U(i)] = max(above(brighter, v), above(v, darker)) > limit


@kernel
def fast_corners(image: GrayImage, threshold: int) -> NDArray[np.int32]:
    """All corners (N, 2), x and y [px] by row, of an image (H, W) of 16 x 12 px or more; threshold in grey levels."""
    height, width = image.shape
    pixels, limit = image.reshape(height * width), U8(threshold)
    found, n = np.empty((height * width, 2), np.int32), 0
    marks = np.zeros(BLOCK, np.uint8)
    candidates = np.zeros(width + BLOCK - width % BLOCK, np.uint8)
    quarters, words = marks.view(np.uint64), candidates.view(np.uint64)
    last = height * width - 3 * width - 1 - BLOCK  # so that no block reads beyond the image's end
    for y in range(RING, height - RING):
        mark_candidates(image[y - RING], image[y], image[y + RING], limit, candidates)
        for k in range(words.shape[0] // 4):
            if words[4 * k] | words[4 * k + 1] | words[4 * k + 2] | words[4 * k + 3] == 0:
                continue
            begin = RING + BLOCK * k
            x0 = min(begin, last - y * width)
            mark_corners(pixels, y * width + x0, width, limit, marks)
            for q in range(4):
                if quarters[q] == 0:
                    continue
                for x in range(x0 + 8 * q, x0 + 8 * q + 8):
                    if marks[x - x0] and begin <= x < width - RING:
                        found[n, 0], found[n, 1] = x, y
                        n += 1
    return found[:n].copy()

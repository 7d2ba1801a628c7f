"""Small blurry images: rotation between frames, likeness of places (PTAM's SmallBlurryImage)."""

from typing import TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import FloatArray
from vsx_ros.geometry.se3 import so3_exp
from vsx_ros.kernels.vision.alignment import align_small
from vsx_ros.vision.pyramid import Pyramid

SmallImage: TypeAlias = NDArray[np.float32]
"""(H / 16, W / 16) float32 grey values minus their mean, blurred."""

SHRINK = 16


def small_image(pyramid: Pyramid) -> SmallImage:
    """Level 3 halved once more (40x30 for VGA), blurred by 0.75 px, zero mean."""
    coarse = pyramid.level(3)
    height, width = coarse.shape
    small = cv2.resize(coarse, (width // 2, height // 2), interpolation=cv2.INTER_AREA).astype(np.float32)
    small = cv2.GaussianBlur(small, (0, 0), 0.75)
    centred: SmallImage = small - np.float32(small.mean(dtype=np.float64))
    return centred


def rotation_between(reference: SmallImage, current: SmallImage, focal_px: float) -> tuple[FloatArray, float]:
    """(R_current_reference (3, 3), mean squared difference) explaining the motion by rotation alone.

    focal_px: at level 0. The difference is infinite when the alignment leaves the image.
    """
    tx, ty, roll, score = align_small(reference, current, 8)
    focal = focal_px / SHRINK
    return so3_exp(np.array([-ty / focal, tx / focal, roll])), float(score)

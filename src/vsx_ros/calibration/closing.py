"""By how much a camera that turned on the spot looks elsewhere than before, from two pictures."""

import math

import cv2
import numpy as np

from vsx_ros.arrays import GrayImage
from vsx_ros.geometry.camera import PinholeCamera

MIN_MATCHES, RANSAC_RATIO = 25, 0.004
LOWE_RATIO = 0.8


def closing_turn(camera: PinholeCamera, before: GrayImage, after: GrayImage) -> float | None:
    """How far the camera turned to the left in between [rad], both pictures showing the same far things; None where
    too little of one is found in the other.

    Of a camera that only turns, pictures are related by the homography K R K^-1 (Hartley and Zisserman, 8.4.2).
    """
    orb = cv2.ORB.create(2000)
    (keypoints_a, words_a), (keypoints_b, words_b) = (orb.detectAndCompute(image, None) for image in (before, after))
    if words_a is None or words_b is None or len(words_b) < 2:
        return None
    pairs = cv2.BFMatcher(cv2.NORM_HAMMING).knnMatch(words_a, words_b, k=2)
    matches = [pair[0] for pair in pairs if len(pair) == 2 and pair[0].distance < LOWE_RATIO * pair[1].distance]
    if len(matches) < MIN_MATCHES:
        return None
    rays_a = camera.unproject(np.array([keypoints_a[m.queryIdx].pt for m in matches]))
    rays_b = camera.unproject(np.array([keypoints_b[m.trainIdx].pt for m in matches]))
    H, inliers = cv2.findHomography(rays_a[:, :2], rays_b[:, :2], cv2.RANSAC, RANSAC_RATIO)
    if H is None or inliers.sum() < MIN_MATCHES:
        return None
    kept = inliers.ravel().astype(bool)
    unit_a, unit_b = (rays[kept] / np.linalg.norm(rays[kept], axis=1, keepdims=True) for rays in (rays_a, rays_b))
    U, _, Vt = np.linalg.svd(unit_b.T @ unit_a)
    R_b_a = U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt
    return math.atan2(float(R_b_a[0, 2]), float(R_b_a[2, 2]))

"""Pictures of textured planes, as frames of the SLAM."""

import cv2
import numpy as np

from vsx_ros.geometry.camera import PinholeCamera, kernel_camera
from vsx_ros.geometry.se3 import SE3
from vsx_ros.slam.keyframe import FrameData
from vsx_ros.vision.corners import CornerDetector
from vsx_ros.vision.pyramid import build_pyramid, small_image

CAMERA = PinholeCamera(640, 480, 525.0, 525.0, 319.5, 239.5)
# (normal . x, distance [m], where it is: x below) in the first camera: a leaning wall; the same with a nearer one.
WALL = [((0.35, 0.0, 1.0), 2.5, np.inf)]
SCENE = [*WALL, ((0.0, 0.0, 1.0), 1.5, -0.1)]


def picture(T_first_cam, planes):
    """(480, 640) uint8: the planes with a texture of blurred noise, the nearest in front."""
    noise = np.random.default_rng(0).integers(0, 256, (1024, 1024)).astype(np.float32)
    texture = cv2.normalize(cv2.GaussianBlur(noise, (0, 0), 2.0), None, 0, 255, cv2.NORM_MINMAX)
    v, u = np.mgrid[0:480, 0:640]
    rays = np.stack([(u - 319.5) / 525.0, (v - 239.5) / 525.0, np.ones(u.shape)], axis=-1) @ T_first_cam.rotation.T
    nearest, image = np.full(u.shape, np.inf), np.zeros(u.shape, np.float32)
    for normal, distance, beyond in planes:
        depth = (distance - np.dot(normal, T_first_cam.translation)) / (rays @ np.array(normal))
        place = T_first_cam.translation + depth[..., None] * rays
        at = ((place[..., :2] * 210.0 + 37.0 * distance) % 1023).astype(np.float32)
        seen = (depth > 0) & (depth < nearest) & (place[..., 0] < beyond)
        image[seen] = cv2.remap(texture, at[..., 0], at[..., 1], cv2.INTER_LINEAR)[seen]
        nearest[seen] = depth[seen]
    return np.round(image).astype(np.uint8)


def frame(stamp, image, base=None):
    pyramid = build_pyramid(image)
    corners = CornerDetector().detect(pyramid)
    return FrameData(stamp, pyramid, corners, small_image(pyramid), base, kernel_camera(CAMERA))


def moved(x=0.0, z=0.0, yaw=0.0):
    return SE3.exp(np.array([x, 0.0, z, 0.0, yaw, 0.0]))

"""Lens models: from the plane z = 1 to the picture and back, in focal lengths from the centre.

Camera arrays are (CAMERA,): focal lengths and centre [px], coefficients of the lens, its usable radius, the size of the
image, and the motion of the camera during readout (``geometry``). Models, as in OpenCV and ROS:

plumb_bob, rational_polynomial: radius r on the plane becomes r (1 + k1 r^2 + k2 r^4 + k3 r^6) / (1 + k4 r^2 + k5 r^4 +
    k6 r^6), then p1, p2 shift (Brown 1971; OpenCV, "Camera calibration and 3D reconstruction"). Of plumb_bob k4 to
    k6 are 0.
equidistant: the angle a off the axis becomes the radius a (1 + k1 a^2 + k2 a^4 + k3 a^6 + k4 a^8) (Kannala and Brandt
    2006; OpenCV's fisheye)."""

import math

from vsx_ros.arrays import FloatArray
from vsx_ros.kernels import kernel, part

FX, FY, CX, CY = 0, 1, 2, 3
LENS = 4  # five coefficients: k1, k2, p1, p2, k3; for an equidistant lens k1, k2, k3, k4, 0
PLANE_R2 = 9  # largest squared radius on the plane z = 1 that is used
WIDTH, HEIGHT = 10, 11
MOTION = 12  # rotation vector [rad], then translation [m] from the first row to the last, in the camera's frame
RATIONAL = 18  # k4, k5, k6
MODEL = 21
PICTURE_R2 = 22  # PLANE_R2 in the picture, squared focal lengths from the centre; pixels beyond are masked
CAMERA = 23  # length of the array

POLYNOMIAL, EQUIDISTANT = 0.0, 1.0  # values of MODEL
MAX_ANGLE_RAD = 1.56  # a ray at 90 degrees does not meet the plane z = 1


@part
def distort(camera: FloatArray, x: float, y: float) -> tuple[float, float]:
    """Where the lens maps (x, y, 1)."""
    k1, k2, p1, p2, k3 = camera[4], camera[5], camera[6], camera[7], camera[8]
    r2 = x * x + y * y
    if camera[MODEL] == EQUIDISTANT:
        r = math.sqrt(r2)
        if r < 1e-9:
            return x, y
        angle = math.atan(r)
        a2 = angle * angle
        scale = angle * (1.0 + a2 * (k1 + a2 * (k2 + a2 * (p1 + a2 * p2)))) / r
        return x * scale, y * scale
    radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    radial /= 1.0 + r2 * (camera[RATIONAL] + r2 * (camera[RATIONAL + 1] + r2 * camera[RATIONAL + 2]))
    xd = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x)
    yd = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y
    return xd, yd


@part
def undistort(camera: FloatArray, xd: float, yd: float) -> tuple[float, float]:
    """(x, y) on the plane z = 1 that the lens maps there; outside its one-to-one range, a point near the edge."""
    if camera[MODEL] == EQUIDISTANT:
        return _undistort_equidistant(camera, xd, yd)
    return _undistort_polynomial(camera, xd, yd)


@kernel
def _undistort_equidistant(camera: FloatArray, xd: float, yd: float) -> tuple[float, float]:
    """Newton steps on the angle off the axis."""
    k1, k2, k3, k4 = camera[4], camera[5], camera[6], camera[7]
    radius = math.sqrt(xd * xd + yd * yd)
    if radius < 1e-9:
        return xd, yd
    angle = min(radius, MAX_ANGLE_RAD)
    for _ in range(20):
        a2 = angle * angle
        error = angle * (1.0 + a2 * (k1 + a2 * (k2 + a2 * (k3 + a2 * k4)))) - radius
        slope = 1.0 + a2 * (3.0 * k1 + a2 * (5.0 * k2 + a2 * (7.0 * k3 + a2 * 9.0 * k4)))
        before = angle
        angle = min(max(angle - error / max(slope, 0.1), 0.0), MAX_ANGLE_RAD)
        if abs(angle - before) < 1e-14:
            break
    scale = math.tan(angle) / radius
    return xd * scale, yd * scale


@kernel
def _undistort_polynomial(camera: FloatArray, xd: float, yd: float) -> tuple[float, float]:
    """Newton steps on the point; if they end outside the usable range, again from a start at the right radius."""
    x, y = _newton(camera, xd, yd, xd, yd)
    if x * x + y * y <= camera[PLANE_R2]:
        u, v = distort(camera, x, y)
        if abs(u - xd) + abs(v - yd) < 1e-9:
            return x, y
    radius = math.sqrt(xd * xd + yd * yd)
    share = _radius_on_plane(camera, radius) / max(radius, 1e-12)
    return _newton(camera, xd, yd, xd * share, yd * share)


@kernel
def _radius_on_plane(camera: FloatArray, radius: float) -> float:
    """Radius on the plane for ``radius`` in the picture, by bisection up to ``PLANE_R2``, without p1 and p2."""
    k1, k2, k3 = camera[4], camera[5], camera[8]
    k4, k5, k6 = camera[RATIONAL], camera[RATIONAL + 1], camera[RATIONAL + 2]
    low, high = 0.0, math.sqrt(camera[PLANE_R2])
    for _ in range(50):
        r = 0.5 * (low + high)
        r2 = r * r
        above, below = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3)), 1.0 + r2 * (k4 + r2 * (k5 + r2 * k6))
        if r * above < radius * below:
            low = r
        else:
            high = r
    return 0.5 * (low + high)


@kernel
def _newton(camera: FloatArray, xd: float, yd: float, x: float, y: float) -> tuple[float, float]:
    """Newton steps from (x, y), kept near or inside ``PLANE_R2``, because the polynomial may turn back beyond."""
    k1, k2, p1, p2, k3 = camera[4], camera[5], camera[6], camera[7], camera[8]
    k4, k5, k6, most = camera[RATIONAL], camera[RATIONAL + 1], camera[RATIONAL + 2], camera[PLANE_R2]
    for _ in range(30):
        r2 = x * x + y * y
        if r2 > 1.5 * most:
            shrink = math.sqrt(most / r2)
            x, y, r2 = x * shrink, y * shrink, most
        above, below = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3)), 1.0 + r2 * (k4 + r2 * (k5 + r2 * k6))
        radial = above / below
        ex = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x) - xd
        ey = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y - yd
        if abs(ex) + abs(ey) < 1e-13:
            break
        d_above, d_below = k1 + r2 * (2.0 * k2 + 3.0 * r2 * k3), k4 + r2 * (2.0 * k5 + 3.0 * r2 * k6)
        slope = 2.0 * (d_above - radial * d_below) / below
        jxx = radial + x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x
        jxy = x * y * slope + 2.0 * p1 * x + 2.0 * p2 * y
        jyy = radial + y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x
        det = jxx * jyy - jxy * jxy
        if det < 1e-3:
            # Outside the one-to-one range: the slower fixed-point step stays on its near side.
            x -= ex / max(radial, 0.1)
            y -= ey / max(radial, 0.1)
            continue
        x -= (jyy * ex - jxy * ey) / det
        y -= (jxx * ey - jxy * ex) / det
    return x, y

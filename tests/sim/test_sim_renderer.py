import cv2
import numpy as np
import pytest
from msgspec.structs import replace
from sim_views import PERFECT, camera_in, standing

from vsx_ros.arrays import FloatArray, IntArray
from vsx_ros.errors import CalibrationError
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.geometry.lens import EQUIDISTANT
from vsx_ros.sim.camera import KINECT, CameraSettings, PosesAt
from vsx_ros.sim.drawn_world import DrawnWorld
from vsx_ros.sim.renderer import Renderer, exact_rays, lit
from vsx_ros.sim.scene import Scene, compile_scene, quads
from vsx_ros.sim.textures import packed_levels, texture
from vsx_ros.sim.world import Box, Material, Outline, World

ALL_PIXELS = np.stack(np.meshgrid(np.arange(640.0), np.arange(480.0)), axis=-1).reshape(-1, 2)


def test_rays_invert_the_distortion_exactly() -> None:
    rays = exact_rays(KINECT, ALL_PIXELS)
    assert np.abs(KINECT.project(rays) - ALL_PIXELS).max() < 1e-8
    assert np.all(rays[:, 2] == 1.0)


def test_a_lens_that_folds_over_is_refused() -> None:
    folded = PinholeCamera(640, 480, 517.0, 517.0, 320.0, 240.0, (-2.5, 0.0, 0.0, 0.0, 0.0))
    with pytest.raises(CalibrationError, match="inverted"):
        exact_rays(folded, ALL_PIXELS[::97])


def brute_force(world: World, origin: FloatArray, directions: FloatArray) -> tuple[FloatArray, IntArray]:
    """Distance along the optical axis and nearest quad per ray, quad by quad: the slow twin of the kernels."""
    best, who = np.full(len(directions), np.inf), np.full(len(directions), -1)
    for k, quad in enumerate(quads(world)):
        normal = np.cross(quad.edge_u, quad.edge_v)
        toward = directions @ normal
        with np.errstate(divide="ignore", invalid="ignore"):
            s = ((quad.corner - origin) @ normal) / toward
            hit = origin + s[:, None] * directions - quad.corner
            u, v = hit @ quad.edge_u / (quad.edge_u @ quad.edge_u), hit @ quad.edge_v / (quad.edge_v @ quad.edge_v)
        seen = (toward > 0) & (s > 0) & (u >= 0) & (u <= 1) & (v >= 0) & (v <= 1) & (s < best)
        best[seen], who[seen] = s[seen], k
    return best, who


@pytest.mark.parametrize("theta", [0.0, 1.1, 2.7, -1.9])
def test_depth_and_quad_are_those_of_brute_force(lab: World, lab_scene: Scene, theta: float) -> None:
    camera = camera_in(lab_scene)
    pose = (lab.start.x, lab.start.y, theta)
    picture = camera.picture(0, standing(*pose), want_depth=True)
    R, t = camera.poses_cam(np.array([[*pose, 0.0]]))
    pixels = ALL_PIXELS[np.random.default_rng(2).integers(0, len(ALL_PIXELS), 4000)]
    depth, who = brute_force(lab, t[0], exact_rays(KINECT, pixels) @ R[0].T)
    at = pixels.astype(int)
    rendered, ident = picture.depth[at[:, 1], at[:, 0]], picture.ident[at[:, 1], at[:, 0]]
    same = ident == who
    assert same.mean() > 0.998  # rays that graze an edge may differ
    assert np.abs(rendered[same] / depth[same] - 1.0).max() < 1e-4


def test_depth_of_a_wall_ahead_is_analytic(empty_room: World) -> None:
    camera = camera_in(empty_room)
    picture = camera.picture(0, standing(1.5, 2.0, 0.0), want_depth=True)
    x_cam = 1.5 + camera.T_base_cam_true.translation[0]
    assert picture.depth[255, 319] == pytest.approx(6.0 - x_cam, rel=1e-5)
    rays = exact_rays(KINECT, np.array([[320.0, 470.0]]))
    height = camera.T_base_cam_true.translation[2]
    assert picture.depth[470, 320] == pytest.approx(height / rays[0, 1], rel=1e-5)


def test_plain_surfaces_show_their_reflectance_times_light(empty_room: World) -> None:
    picture = camera_in(empty_room).picture(0, standing(1.5, 2.0, 0.0))
    assert picture.radiance[470, 320] == pytest.approx(0.2, abs=0.003)
    assert picture.radiance[100, 320] == pytest.approx(0.8, rel=0.02)


def test_a_texture_seen_close_is_its_bilinear_picture(empty_room: World) -> None:
    """A wall of 2 cm texels 1 m away: every pixel lies between texel centres, so no mip level may blur it."""
    material = Material(kind="brick", seed=3, brightness=0.5, texel_m=0.02)
    wall = Outline(points=[(0, 0), (6, 0), (6, 4), (0, 4)], height=2.5, material="brick")
    world = replace(empty_room, materials={**empty_room.materials, "brick": material}, outlines=[wall])
    camera = camera_in(world)
    pose = (5.0, 2.0, 0.0)
    picture = camera.picture(0, standing(*pose))
    R, t = camera.poses_cam(np.array([[*pose, 0.0]]))
    pixels = np.stack(np.meshgrid(np.arange(150.0, 500.0, 7), np.arange(40.0, 330.0, 7)), axis=-1).reshape(-1, 2)
    rays = exact_rays(KINECT, pixels) @ R[0].T
    hits = t[0] + rays * ((6.0 - t[0, 0]) / rays[:, :1])
    # The east wall runs from (6, 0) to (6, 4); its texture starts at the top left as seen from inside.
    tex = texture(material).astype(float)
    along = (6.0 + 4.0) / 0.02
    u, v = (4.0 - hits[:, 1]) / 0.02 + along - 0.5, (2.5 - hits[:, 2]) / 0.02 - 0.5
    i, j = np.floor(u).astype(int), np.floor(v).astype(int)
    fu, fv = u - i, v - j
    n = len(tex)
    expected = (
        tex[j % n, i % n] * (1 - fu) * (1 - fv) + tex[j % n, (i + 1) % n] * fu * (1 - fv)
        + tex[(j + 1) % n, i % n] * (1 - fu) * fv + tex[(j + 1) % n, (i + 1) % n] * fu * fv
    ) / 255.0  # fmt: skip
    shadow = 1.0 - 0.25 * np.exp(-hits[:, 2] / 0.3)
    seen = picture.radiance[pixels[:, 1].astype(int), pixels[:, 0].astype(int)]
    assert np.abs(seen / shadow - expected).max() < 0.015  # the shadow is interpolated between nodes 0.25 m apart
    assert np.corrcoef(seen, expected)[0, 1] > 0.98


def test_packed_levels_hold_neighbours_and_means() -> None:
    picture = np.arange(16, dtype=np.uint8).reshape(4, 4) * 10
    levels = packed_levels(picture).view(np.uint32)
    assert len(levels) == 16 + 4 + 1
    first = levels[5]
    assert [first & 255, first >> 8 & 255, first >> 16 & 255, first >> 24] == [50, 60, 90, 100]
    last_column = levels[3]
    assert [last_column & 255, last_column >> 8 & 255] == [30, 0]
    assert levels[20] & 255 == 75


def test_edges_blend_by_area(room_with_box: World) -> None:
    picture = camera_in(room_with_box).picture(0, standing(1.5, 2.0, 0.0), want_depth=True)
    row = 270
    left = 100 + int(np.argmax(picture.depth[row, 100:] < 1.7))
    profile = picture.radiance[row, left - 4 : left + 5]
    assert np.all(np.diff(profile) <= 1e-3)  # bright wall to darker box, without ringing
    between = (profile < 0.98 * profile[0]) & (profile > 1.02 * profile[-1])
    assert 1 <= between.sum() <= 2


def test_bayer_pixels_see_one_colour_each(room_with_box: World) -> None:
    camera = camera_in(room_with_box)
    mosaic = camera.picture(0, standing(1.5, 2.0, 0.0), bayer=True).radiance[270:280, 310:330]
    grey = camera.picture(0, standing(1.5, 2.0, 0.0)).radiance[270:280, 310:330]
    white = mosaic / grey * (0.299 * 1.0 + 0.587 * 0.25 + 0.114 * 0.5)
    assert white[::2, ::2] == pytest.approx(0.25, abs=1e-4)  # even rows: green, red
    assert white[::2, 1::2] == pytest.approx(1.0, abs=1e-4)
    assert white[1::2, ::2] == pytest.approx(0.5, abs=1e-4)  # odd rows: blue, green
    assert white[1::2, 1::2] == pytest.approx(0.25, abs=1e-4)


def test_same_bits_again_and_on_two_threads(lab: World, lab_scene: Scene) -> None:
    moving = CameraSettings(exposure_ns=20_000_000)
    pictures = []
    for threads in (1, 1, 2):
        camera = camera_in(lab_scene, moving, threads)
        turn = turning(0.5, lab.start.x, lab.start.y, 0.0)
        pictures.append(camera.picture(0, turn, bayer=True).radiance)
    assert np.array_equal(pictures[0], pictures[1])
    assert np.array_equal(pictures[0], pictures[2])


def turning(omega: float, x: float, y: float, theta: float) -> PosesAt:
    return lambda stamps: np.column_stack(
        [np.full((len(stamps), 2), [x, y]), theta + omega * stamps * 1e-9, np.zeros(len(stamps))]
    )


def edge_columns(image: FloatArray, rows: IntArray) -> FloatArray:
    """Sub-pixel column of the strongest brightness step of each row."""
    steps = np.abs(np.diff(cv2.GaussianBlur(image, (0, 0), 1.5)[rows], axis=1))
    peak = steps[:, 2:-2].argmax(axis=1) + 2
    return np.array([np.average(np.arange(p - 2, p + 3) + 0.5, weights=s[p - 2 : p + 3]) for p, s in zip(peak, steps)])


@pytest.fixture
def post_room(empty_room: World) -> World:
    post = Box(x=3.5, y=2.0, length=0.2, width=3.0, height=2.5, material="dark")
    return replace(empty_room, boxes=[post])


def test_rolling_shutter_leans_upright_edges(post_room: World) -> None:
    """Turning left moves the scene to the right: lower rows, exposed later, see an upright edge further right."""
    rolling = replace(PERFECT, readout_ns=26_000_000)
    rows, omega = np.array([60, 300]), 0.8
    camera = camera_in(post_room, rolling)
    upright = camera.picture(0, turning(0.0, 2.0, 0.7, 0.0)).radiance[:, 250:]
    leaning = camera.picture(0, turning(omega, 2.0, 0.7, 0.0)).radiance[:, 250:]
    lean = np.diff(edge_columns(leaning, rows) - edge_columns(upright, rows))[0]
    # The edge is near the image centre, where a turn by a moves it by fx a.
    expected = KINECT.fx * omega * 0.026 * (rows[1] - rows[0]) / 480
    assert lean == pytest.approx(expected, rel=0.25)
    assert expected > 5.0


def test_motion_blur_widens_edges_by_the_way_they_move(post_room: World) -> None:
    exposure_s, omega = 0.020, 0.6
    blurred = replace(PERFECT, exposure_ns=20_000_000)
    camera = camera_in(post_room, blurred)

    def width(rate: float) -> float:
        line = camera.picture(0, turning(rate, 2.0, 0.7, 0.0)).radiance[200, 380:410]
        line = (line - line[0]) / (line[-1] - line[0])
        return float((line * (1 - line)).sum() * 6.0)  # w for a linear ramp of w pixels

    assert width(0.0) < 1.6
    assert width(omega) == pytest.approx(KINECT.fx * omega * exposure_s, rel=0.15)


def test_sub_frames_only_when_needed(lab_scene: Scene) -> None:
    renderer = Renderer(DrawnWorld(lab_scene), KINECT)
    R, t = np.repeat(np.eye(3)[None], 2, axis=0), np.zeros((2, 3))
    assert renderer.sub_frames(R, t) == 1
    a = 0.01
    R[1] = [[np.cos(a), 0, np.sin(a)], [0, 1, 0], [-np.sin(a), 0, np.cos(a)]]
    assert 4 <= renderer.sub_frames(R, t) <= 7  # 517 px/rad * 0.01 = 5.2 px


def test_lights_fall_off_with_distance(room_with_box: World) -> None:
    camera = camera_in(room_with_box)
    below = camera.picture(0, standing(1.5, 2.0, np.pi)).radiance[440, 320]
    away = camera.picture(0, standing(5.0, 3.0, 0.5)).radiance[440, 320]
    assert below > 1.05 * away


def test_scenes_of_one_world_are_equal(room_with_box: World) -> None:
    a, b = compile_scene(room_with_box), compile_scene(room_with_box)
    assert all(np.array_equal(x, y) for x, y in zip(a, b))


def test_a_fisheye_sees_what_its_rays_hit_and_nothing_beyond_85_degrees(lab: World) -> None:
    fisheye = PinholeCamera(640, 480, 203.7, 203.7, 321.0, 238.0, (-0.012, 0.006, -0.004, 0.0006), EQUIDISTANT)
    camera = camera_in(lab, replace(PERFECT, lens=fisheye))
    pose = standing(lab.start.x, lab.start.y, lab.start.theta_rad)
    picture = camera.picture(0, pose, want_depth=True)
    pixels = np.random.default_rng(4).integers([0, 0], [640, 480], (300, 2)).astype(float)
    R, t = camera.poses_cam(pose(np.zeros(1, np.int64)))
    inside = lit(fisheye, pixels)
    assert 0.7 < inside.mean() < 0.9
    depth, who = brute_force(lab, t[0], exact_rays(fisheye, pixels)[inside] @ R[0].T)
    u, v = pixels[inside].astype(int).T
    same = picture.ident[v, u] == who
    assert same.mean() > 0.98  # rays along an edge may fall to either side
    assert np.abs(picture.depth[v, u][same] / depth[same] - 1.0).max() < 1e-3
    gray = camera.render_gray(0, pose)
    out_u, out_v = pixels[~inside].astype(int).T
    assert gray[out_v, out_u].max() <= 30 < gray[v, u].mean()

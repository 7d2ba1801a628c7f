"""The z-buffer against known geometry and against the ray caster of the generated worlds."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from gazebo_files import FLOOR, ROOM, WALLS, box_model, write_world

from vsx_ros.arrays import FloatArray
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.robot import VelocityCommand
from vsx_ros.sim.camera import KINECT
from vsx_ros.sim.gazebo_world import load_gazebo
from vsx_ros.sim.mesh_renderer import MeshRenderer
from vsx_ros.sim.mesh_scene import compile_mesh
from vsx_ros.sim.renderer import exact_rays
from vsx_ros.sim.robot import EmulatedRobot

LOOKING_EAST = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])  # camera z along x, x along -y
SMALL = dataclasses.replace(KINECT, width=160, height=120, fx=129.3, fy=129.1, cx=79.6, cy=63.8)


@pytest.fixture(scope="module")
def hall(tmp_path_factory: pytest.TempPathFactory) -> MeshRenderer:
    """Walls at x = +-3 and y = +-2 (inner faces 5 cm nearer) and a pillar, floor at 0."""
    pillar = box_model("pillar", "1.5 0 0.5 0 0 0", "0.2 0.2 1")
    path = write_world(tmp_path_factory.mktemp("hall"), FLOOR, WALLS, pillar)
    return MeshRenderer(compile_mesh(load_gazebo(path, [])), SMALL, samples=1)


def poses(renderer: MeshRenderer, t0: FloatArray, t1: FloatArray | None = None) -> tuple[FloatArray, FloatArray]:
    """R (1, B, 3, 3) and t (1, B, 3) of a camera that looks east and moves from t0 to t1."""
    n = len(renderer.border_rows)
    way = np.linspace(t0, t0 if t1 is None else t1, n)
    return np.broadcast_to(LOOKING_EAST, (1, n, 3, 3)).copy(), way[None]


def expected_depth(camera: PinholeCamera, eye: FloatArray) -> FloatArray:
    """Depth of floor, walls and pillar for rays through all pixels; the walls are 1 m high."""
    v, u = np.mgrid[0 : camera.height, 0 : camera.width]
    rays = exact_rays(camera, np.column_stack([u.ravel(), v.ravel()]).astype(float)) @ LOOKING_EAST.T
    best = np.full(len(rays), np.inf)
    for axis, at in ((2, 0.0), (0, 2.95), (1, 1.95), (1, -1.95), (0, 1.4)):
        with np.errstate(divide="ignore", invalid="ignore"):
            s = (at - eye[axis]) / rays[:, axis]
        hit = eye + s[:, None] * rays
        good = (s > 0) & (hit[:, 2] <= (1.0 + 1e-9 if axis < 2 else 1e-6))
        if at == 1.4:
            good &= np.abs(hit[:, 1]) <= 0.1
        best = np.where(good & (s < best), s, best)
    return best.reshape(camera.height, camera.width)


def test_depth_is_exact_through_a_bent_lens(hall: MeshRenderer) -> None:
    eye = np.array([-1.0, 0.3, 0.4])
    depth = hall.render(*poses(hall, eye), want_depth=True).depth
    known = expected_depth(SMALL, eye)
    seen = np.isfinite(known) & (known < 20)
    close = np.abs(depth[seen] - known[seen]) < 1e-3 * known[seen]
    assert 0.99 < close.mean() <= 1.0  # pixels at an edge may fall to either side
    assert (depth[known == np.inf] == 0.0).mean() > 0.99


def test_each_row_has_its_own_camera(hall: MeshRenderer) -> None:
    before, after = np.array([-1.0, 0.3, 0.4]), np.array([-0.8, 0.3, 0.4])
    depth = hall.render(*poses(hall, before, after), want_depth=True).depth
    rows = np.array([55, 80, 110])
    column = 12  # on the wall in the east, or the one in the north
    share = rows / hall.border_rows[-1]
    for row, moved in zip(rows, share):
        known = expected_depth(SMALL, before + moved * (after - before))
        assert depth[row, column] == pytest.approx(known[row, column], rel=1e-3)


def test_neighbouring_triangles_leave_no_gap(hall: MeshRenderer) -> None:
    for x in np.linspace(-1.0, 1.0, 7):
        ident = hall.render(*poses(hall, np.array([x, 0.123 * x, 0.4])), want_depth=True).ident
        assert (ident[70:] >= 0).all()  # floor and walls below the horizon


def test_any_number_of_threads_gives_the_same_bits(hall: MeshRenderer) -> None:
    eye = np.array([-1.0, 0.3, 0.4])
    pair = MeshRenderer(hall._scene, SMALL, threads=2, samples=1)
    one, two = (renderer.render(*poses(hall, eye)).radiance for renderer in (hall, pair))
    np.testing.assert_array_equal(one, two)
    assert 0.05 < one.mean() < 5.0


def test_light_is_darker_under_things_and_shadows_fall(tmp_path: Path) -> None:
    fades = "<attenuation><range>20</range><constant>0.1</constant><linear>0</linear></attenuation>"
    lamp = f'<light name="a" type="point"><pose>0 0 0.95 0 0 0</pose>{fades}</light>'
    screen = box_model("screen", "1 0 0.25 0 0 0", "0.3 1.5 0.5")
    table = box_model("table", "-1.5 0 0.4 0 0 0", "1 1 0.05")
    world = load_gazebo(write_world(tmp_path, FLOOR, WALLS, screen, table, lamp), [])
    scene = compile_mesh(world)
    frame = scene.light_frame

    def upward(x: float, y: float) -> float:
        i, j, k = (np.rint((np.array([x, y, 0.15]) - frame[:3]) / frame[3])).astype(int)
        return float(scene.light[k, j, i, 4])

    assert upward(1.6, 0.0) < 0.8 * upward(1.6, 1.6)  # behind the screen
    assert upward(-1.5, 0.0) < 0.8 * upward(-1.5, 1.2)  # under the table


def test_a_robot_sees_texture_in_the_room_and_the_same_twice() -> None:
    world = load_gazebo(ROOM, [])
    first, second = (EmulatedRobot(world, 1).step(VelocityCommand(0.1, 0.2)).frame.image for _ in range(2))
    np.testing.assert_array_equal(first, second)
    assert first.shape == (480, 640)
    assert first.std() > 10

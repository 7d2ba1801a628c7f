"""Exports of a map made by driving, read by the programs they are for."""

import dataclasses
import json
import subprocess
import sys

import numpy as np
import pytest

from vsx_ros.cli.main import execute
from vsx_ros.config import Config
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.geometry.lens import EQUIDISTANT, PLUMB_BOB, RATIONAL
from vsx_ros.io.map_export import read_ply, write_colmap
from vsx_ros.io.map_file import load_map
from vsx_ros.io.slam_map_file import load_slam_map, save_slam_map
from vsx_ros.io.trajectory_file import read_trajectory
from vsx_ros.occupancy.grid import FREE, OCCUPIED
from vsx_ros.robot import VelocityCommand
from vsx_ros.sim.generate import generate_world
from vsx_ros.sim.robot import EmulatedRobot
from vsx_ros.slam.slam import SequentialSlam
from vsx_ros.slam.snapshot import snapshot


@pytest.fixture(scope="module")
def lab(tmp_path_factory):
    robot = EmulatedRobot(generate_world("lab", 3), 3)
    slam = SequentialSlam(robot.camera_given, robot.T_base_cam_given, Config().slam)
    for _ in range(50):
        slam.track(*robot.step(VelocityCommand(0.2, 0.0)))
    path = tmp_path_factory.mktemp("map") / "lab.vsxmap"
    save_slam_map(slam.slam_map(), path)
    return path


@pytest.fixture(scope="module")
def seen(lab):
    return snapshot(load_slam_map(lab).view)


def test_info(lab, seen, capsys):
    assert execute(["map", "info", str(lab), "--json"]) == 0
    known = json.loads(capsys.readouterr().out)
    assert known["keyframes"] == len(seen.keyframe_ids) >= 2
    assert known["points"] == len(seen.points_world) > 50
    assert known["metric_scale"] is True
    assert known["way_between_keyframes"] == pytest.approx(0.35, abs=0.3)
    assert execute(["map", "info", str(lab)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("keyframes  ")
    assert f"way_between_keyframes  {known['way_between_keyframes']} m" in lines


def test_tum_and_ply(lab, seen, tmp_path, capsys):
    assert execute(["map", "export", str(lab), "--format", "tum", "--out", str(tmp_path / "a.txt")]) == 0
    assert execute(["map", "export", str(lab), "--format", "ply"]) == 0
    assert capsys.readouterr().out == f"{tmp_path / 'a.txt'}\n{lab.with_suffix('.ply')}\n"
    poses = read_trajectory(tmp_path / "a.txt")
    assert [pose.stamp_ns for pose in poses] == seen.keyframe_stamps_ns.tolist()
    for pose, T_world_cam in zip(poses, seen.T_world_cams, strict=True):
        np.testing.assert_allclose(pose.T.matrix(), T_world_cam.matrix(), atol=1e-7)
    np.testing.assert_allclose(read_ply(lab.with_suffix(".ply")), seen.points_world, atol=1e-5)


def test_pgm_is_the_floor_round_the_keyframes(lab, seen, capsys):
    assert execute(["map", "export", str(lab), "--format", "pgm", "--set", "ground_map.resolution_m=0.04"]) == 0
    out = lab.with_name("lab_ground.yaml")
    assert capsys.readouterr().out == f"{out}\n"
    grid, T_cam_base = load_map(out), load_slam_map(lab).T_base_cam.inverse()
    assert grid.resolution == 0.04
    stood = np.array([(T @ T_cam_base).translation[:2] for T in seen.T_world_cams])
    columns, rows = ((stood - (grid.origin_x, grid.origin_y)) // grid.resolution).astype(int).T
    assert (grid.data[rows, columns] == FREE).all()
    assert np.count_nonzero(grid.data == OCCUPIED) > 5
    assert 0.3 < np.count_nonzero(grid.data == FREE) * 0.04**2 < 20.0


def test_a_map_without_odometry_says_its_unit_and_needs_a_level_plane(lab, tmp_path, capsys):
    free = tmp_path / "free.vsxmap"
    save_slam_map(dataclasses.replace(load_slam_map(lab), T_base_cam=None), free)
    assert execute(["map", "export", str(free), "--format", "pgm"]) == 0
    said = capsys.readouterr().err
    assert "made without odometry, lengths are in the map's own unit, of which " in said
    unit = float(said.split("of which ")[1].split()[0])
    assert load_map(tmp_path / "free_ground.yaml").resolution == pytest.approx(0.05 * unit, rel=0.01)
    assert execute(["map", "export", str(free), "--format", "pgm", "--set", "dense.enabled=false"]) == 1
    assert "shows no floor to map" in capsys.readouterr().err


def test_planes_and_their_surfaces(lab, capsys):
    for format in ("planes", "dense"):
        assert execute(["map", "export", str(lab), "--format", format]) == 0
    assert capsys.readouterr().out == f"{lab.with_name('lab_planes.json')}\n{lab.with_name('lab_dense.ply')}\n"
    known, cloud = json.loads(lab.with_name("lab_planes.json").read_text()), read_ply(lab.with_name("lab_dense.ply"))
    assert known["unit"] == "metre"
    walls = [plane for plane in known["planes"] if plane["kind"] == "wall"]
    assert walls
    off = np.abs(np.stack([cloud @ np.array(plane["normal"]) - plane["offset"] for plane in known["planes"]]))
    assert len(cloud) > 50
    assert off.min(axis=0).max() < 1e-4
    for plane in walls:
        assert np.linalg.norm(plane["normal"]) == pytest.approx(1.0)
        assert plane["supporters"] >= 15
        assert 0.0 < plane["sigma"]["offset"] < 0.1


@pytest.mark.parametrize(
    ("lens", "model"),
    [
        ((0.1, -0.05, 0.001, -0.002, 0.0), PLUMB_BOB),
        ((0.1, -0.05, 0.001, -0.002, 0.05), PLUMB_BOB),
        ((0.1, -0.05, 0.001, -0.002, 0.05, 0.1, 0.02, 0.01), RATIONAL),
        ((0.1, -0.05, 0.01, 0.001), EQUIDISTANT),
    ],
)
def test_colmap_itself_reads_it_and_agrees_on_every_reprojection(lab, seen, tmp_path, lens, model):
    pycolmap = pytest.importorskip("pycolmap")
    given = load_slam_map(lab).camera
    camera = PinholeCamera(640, 480, given.fx, given.fy, given.cx, given.cy, lens, model)
    write_colmap(tmp_path, camera, seen)
    model = pycolmap.Reconstruction(str(tmp_path))
    assert (model.num_images(), model.num_points3D()) == (len(seen.keyframe_ids), len(seen.point_ids))
    assert model.compute_num_observations() == len(seen.obs_point)
    for k, number in enumerate(seen.keyframe_ids.tolist()):
        image = model.images[number + 1]
        assert (tmp_path / "images" / image.name).exists()
        np.testing.assert_allclose(image.projection_center(), seen.T_world_cams[k].translation, atol=1e-6)
        rows = np.flatnonzero(seen.obs_keyframe == k)[:50]
        points = seen.points_world[seen.obs_point[rows]]
        ours = camera.project(seen.T_world_cams[k].inverse() @ points)
        theirs = np.array([image.project_point(point) for point in points])
        np.testing.assert_allclose(theirs, ours + 0.5, atol=0.01)
        np.testing.assert_allclose([p.xy for p in image.points2D][: len(rows)], seen.obs_uv[rows] + 0.5, atol=1e-3)
    written = {number: point.error for number, point in model.points3D.items()}
    model.update_point_3d_errors()
    for number, point in model.points3D.items():
        assert point.error == pytest.approx(written[number], abs=0.02)


def test_colmap_text_by_the_book(lab, seen, capsys):
    assert execute(["map", "export", str(lab), "--format", "colmap"]) == 0
    folder = lab.with_name("lab_colmap")
    assert capsys.readouterr().out == f"{folder}\n"
    lines = (folder / "images.txt").read_text().splitlines()[1:]
    assert len(lines) == 2 * len(seen.keyframe_ids)
    header, observed = lines[0].split(), lines[1].split()
    assert header[0] == "1"
    assert header[9] == "000000.png"
    assert float(observed[0]) == pytest.approx(seen.obs_uv[0, 0] + 0.5, abs=1e-4)
    points = [line.split() for line in (folder / "points3D.txt").read_text().splitlines()[1:]]
    assert sum((len(point) - 8) // 2 for point in points) == len(seen.obs_point)
    assert all(len(point) >= 12 for point in points)  # seen at least twice
    camera = (folder / "cameras.txt").read_text().splitlines()[1].split()
    assert camera[:4] == ["1", "FULL_OPENCV", "640", "480"]  # the emulated lens has a k3


def test_mistakes_are_one_sentence(lab, tmp_path, capsys):
    assert execute(["map", "info", str(tmp_path / "none.vsxmap")]) == 1
    (tmp_path / "bad.vsxmap").write_bytes(lab.read_bytes()[:-5])
    assert execute(["map", "export", str(tmp_path / "bad.vsxmap"), "--format", "ply"]) == 1
    for form in ("tum", "ply", "colmap", "pgm"):
        (tmp_path / "file").touch()
        assert execute(["map", "export", str(lab), "--format", form, "--out", str(tmp_path / "file/x")]) == 1
    error = capsys.readouterr().err
    assert error.count("\n") == 6
    assert error.count("cannot be") == 6


def test_a_robot_s_map_is_saved_without_loading_what_explores_and_reports(tmp_path):
    """Beside a robot, that took more than a second of its processor."""
    asked = ["map", "save", str(tmp_path / "absent")]
    script = f"import sys; from vsx_ros.cli.main import execute; execute({asked}); print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert "absent is not a run folder" in done.stderr
    heavy = {"vsx_ros.cli.explore", "vsx_ros.cli.replay", "vsx_ros.runs.start", "vsx_ros.evaluation.report", "scipy"}
    loaded = set(done.stdout.split())
    assert not heavy & loaded
    assert "vsx_ros.runs.folder" in loaded

"""Gazebo files as emulated worlds: floor, truth, start, meshes, and one sentence for each that cannot be."""

import struct
from pathlib import Path

import cv2
import numpy as np
import pytest
import trimesh
from gazebo_files import FLOOR, ROOM, WALLS, box_model, walls_of_room, write_world

from vsx_ros.errors import ConfigError, InputError
from vsx_ros.occupancy.grid import FREE, OCCUPIED
from vsx_ros.runs.world import MODEL_PATHS, open_world, save_world, world_files
from vsx_ros.sim.gazebo_world import load_gazebo
from vsx_ros.sim.generate import generate_world
from vsx_ros.sim.mesh_hidden import hidden_solids
from vsx_ros.sim.mesh_world import MeshWorld
from vsx_ros.sim.truth import gap_to_walls, ground_truth_grid
from vsx_ros.sim.world import Start
from vsx_ros.sim.world_file import load_world


@pytest.fixture(scope="module")
def room() -> MeshWorld:
    return load_gazebo(ROOM, [])


def test_the_room_has_its_floor_walls_and_furniture(room: MeshWorld) -> None:
    grid = ground_truth_grid(room, 0.05, 0.06, 0.45)
    assert room.floor_z_m == pytest.approx(0.0, abs=0.01)
    area = float((grid.data == FREE).sum()) * grid.resolution**2
    assert 24.0 < area < 28.2  # 5.8 x 4.8 m without furniture
    for x, y, dx, dy in ((0.0, 2.05, 0.0, 1.0), (2.0, 5.85, 0.0, -1.0), (2.95, 4.5, -1.0, 0.0)):
        # A wall, the hidden pillar, a nested wall: their faces are 5 cm away, known to a cell or two.
        assert grid.value_at(x, y) != FREE
        assert grid.value_at(x + 0.2 * dx, y + 0.2 * dy) == FREE
        assert OCCUPIED in [grid.value_at(x + s * dx, y + s * dy) for s in (0.0, 0.03, 0.06, 0.09)]
    assert grid.value_at(room.start.x, room.start.y) == FREE


def test_what_only_collides_is_drawn_and_what_is_missing_is_named(room: MeshWorld) -> None:
    corners = room.parts.seen.corners.reshape(-1, 3)
    near_pillar = np.hypot(corners[:, 0] - 2.0, corners[:, 1] - 6.0) < 0.21
    assert near_pillar.sum() >= 3 * 24
    told = " ".join(room.parts.remarks)
    for name in ("pillar/hidden", "Carpet", "no_such_model", "walker"):
        assert name in told


def test_the_floor_is_found_where_it_is(tmp_path: Path) -> None:
    raised = box_model("slab", "0 0 0.1 0 0 0", "8 6 0.2")
    world = load_gazebo(write_world(tmp_path, raised, WALLS), [])
    assert world.floor_z_m == pytest.approx(0.2, abs=0.011)
    lamp = '<light name="a" type="point"><pose>0 0 2 0 0 0</pose></light>'
    lit = load_gazebo(write_world(tmp_path, raised, WALLS, lamp), [])
    assert lit.lamps[0].position[2] == pytest.approx(1.8, abs=0.011)


@pytest.mark.parametrize("ground_z_m", [-0.5, -1.0])
def test_ground_below_the_floor_is_no_floor(tmp_path: Path, ground_z_m: float) -> None:
    plane = "<geometry><plane><normal>0 0 1</normal><size>100 100</size></plane></geometry>"
    link = f'<link name="l"><pose>0 0 {ground_z_m} 0 0 0</pose><collision name="c">{plane}</collision></link>'
    ground = f'<model name="ground">{link}</model>'
    slab = box_model("slab", "0 0 -0.05 0 0 0", "6.3 5.3 0.1")
    world = load_gazebo(write_world(tmp_path, ground, slab, walls_of_room(6.0, 5.0)), [])
    assert world.floor_z_m == pytest.approx(0.0, abs=1e-9)
    assert abs(world.start.x) < 3.0


def test_a_table_stops_no_low_robot_but_its_legs_do(tmp_path: Path) -> None:
    top, leg = box_model("top", "0 0 0.72 0 0 0", "1 1 0.04"), box_model("leg", "0 0 0.35 0 0 0", "0.1 0.1 0.7")
    world = load_gazebo(write_world(tmp_path, FLOOR, WALLS, top, leg), [])
    grid = ground_truth_grid(world, 0.05, 0.0, 0.45)
    assert grid.value_at(0.3, 0.3) == FREE
    assert grid.value_at(0.0, 0.0) != FREE
    segments = world.obstacle_segments(0.0, 0.45)
    gaps = gap_to_walls(segments, np.array([[0.3, 0.0], [1.0, 1.0]]))
    np.testing.assert_allclose(gaps, [0.25, 0.95], atol=2e-3)


def test_solids_that_nothing_shows_are_measured(tmp_path: Path) -> None:
    cube, post = (f"<geometry><box><size>{x} 0.1 1</size></box></geometry>" for x in (2, 0.1))
    parts = f'<visual name="v">{post}</visual><collision name="c">{cube}</collision>'  # a post, solid for 2 m
    frame = f'<model name="frame"><pose>0 0 0.5 0 0 0</pose><link name="l">{parts}</link></model>'
    pillar = box_model("pillar", "2 1 0.5 0 0 0", "0.4 0.4 1")
    found = dict(hidden_solids(load_gazebo(write_world(tmp_path, FLOOR, WALLS, frame, pillar), [])))
    assert list(found) == ["frame"]
    assert 2 * 1.6 < found["frame"] < 2 * 1.9  # both sides, without 0.3 m around the post; the ends


def test_world_yaml_refers_to_the_file_and_keeps_the_start(tmp_path: Path, room: MeshWorld) -> None:
    start = Start(x=1.0, y=5.0, theta_rad=0.5)
    save_world(room.starting_at(start), tmp_path / "world.yaml")
    again = load_world(tmp_path / "world.yaml")
    assert isinstance(again, MeshWorld)
    assert again.start == start
    np.testing.assert_array_equal(again.parts.seen.corners, room.parts.seen.corners)


def write_model(folder: Path, height_m: float) -> Path:
    """A folder of models with one, 'block', which reaches this height where it is included on the floor."""
    (folder / "block").mkdir(parents=True)
    (folder / "block/model.config").write_text("<model><name>block</name><sdf>model.sdf</sdf></model>")
    block = box_model("block", "0 0 0 0 0 0", f"0.5 0.5 {2.0 * height_m}")
    (folder / "block/model.sdf").write_text(f'<sdf version="1.6">{block}</sdf>')
    return folder


def test_a_world_yaml_finds_models_where_its_gazebo_file_does(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    usual, given, gone = write_model(tmp_path / "usual", 0.7), write_model(tmp_path / "given", 0.8), tmp_path / "gone"
    for name in MODEL_PATHS:
        monkeypatch.delenv(name, raising=False)
    (tmp_path / "worlds").mkdir()
    block = "<include><uri>model://block</uri><pose>1 1 0 0 0 0</pose></include>"
    write_world(tmp_path / "worlds", FLOOR, WALLS, block)
    text = tmp_path / "worlds/w.yaml"
    text.write_text(f"gazebo: w.world\nmodels: [{gone}]\n")
    told = " ".join(open_mesh_world(text).parts.remarks)
    assert "model block (model://block) is in none of" in told
    assert "give its folder with --models" in told
    assert block_height_m(open_mesh_world(text, given)) == pytest.approx(0.8)
    assert given / "block/model.sdf" in world_files(str(text), [given])
    with pytest.raises(ConfigError, match="there is no such folder"):
        open_world(str(text), 1, [gone])
    monkeypatch.setenv("GAZEBO_MODEL_PATH", str(usual))
    assert block_height_m(open_mesh_world(text)) == pytest.approx(0.7)
    assert usual / "block/model.sdf" in world_files(str(text))
    write_model(gone, 0.6)  # what the file names comes before the usual folders, and what is given before both
    assert block_height_m(open_mesh_world(text)) == pytest.approx(0.6)
    assert block_height_m(open_mesh_world(text, given)) == pytest.approx(0.8)


def open_mesh_world(path: Path, *models: Path) -> MeshWorld:
    world = open_world(str(path), 1, models)
    assert isinstance(world, MeshWorld)
    return world


def block_height_m(world: MeshWorld) -> float:
    """Height of what is drawn around (1, 1)."""
    corners = world.parts.seen.corners.reshape(-1, 3)
    return float(corners[np.abs(corners[:, :2] - 1.0).max(axis=1) < 0.3, 2].max())


def test_folders_of_models_are_for_gazebo_worlds_alone(tmp_path: Path) -> None:
    save_world(generate_world("corridor", 1), tmp_path / "w.yaml")
    for name in ("corridor", str(tmp_path / "w.yaml")):
        with pytest.raises(ConfigError, match="is for a Gazebo world"):
            open_world(name, 1, [tmp_path])


def test_the_start_is_drawn_with_the_seed(room: MeshWorld) -> None:
    starts = [open_world(str(ROOM), seed).start for seed in (1, 1, 2)]
    assert starts[0] == starts[1] != starts[2]
    segments = room.obstacle_segments(0.0, 0.45)
    assert gap_to_walls(segments, np.array([[s.x, s.y] for s in starts])).min() > 0.45


def triangle_file(path: Path, kind: str) -> None:
    """A right-angled triangle of 1 m at z = 1."""
    corners = ((0.0, 0.0, 1.0), (1.0, 0.0, 1.0), (0.0, 1.0, 1.0))
    if kind == "stl":
        path.write_bytes(bytes(80) + struct.pack("<I3f9fH", 1, 0, 0, 1, *(v for c in corners for v in c), 0))
    elif kind == "glb":
        trimesh.Trimesh(corners, [[0, 1, 2]]).export(path)
    else:
        lines = "".join(f"v {x} {y} {z}\n" for x, y, z in corners)
        path.write_text(f"# Tür\n{lines}f 1 2 3\n", encoding="latin-1")  # older exporters know no UTF-8


@pytest.mark.parametrize("kind", ["stl", "obj", "glb"])
def test_meshes_of_other_kinds_are_placed_and_scaled(tmp_path: Path, kind: str) -> None:
    triangle_file(tmp_path / f"t.{kind}", kind)
    mesh = f"<geometry><mesh><uri>t.{kind}</uri><scale>2 2 2</scale></mesh></geometry>"
    model = f'<model name="m"><pose>1 0 0 0 0 0</pose><link name="l"><visual name="v">{mesh}</visual></link></model>'
    world = load_gazebo(write_world(tmp_path, model, FLOOR, WALLS), [])
    np.testing.assert_allclose(world.parts.seen.corners[0].max(axis=0), [3.0, 2.0, 2.0])
    np.testing.assert_allclose(world.parts.seen.corners[0].min(axis=0), [1.0, 0.0, 2.0])


def test_a_texture_of_one_coordinate_lies_along_its_first_axis(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "t.png"), np.full((8, 8, 3), 90, np.uint8))
    (tmp_path / "t.mtl").write_text("newmtl a\nmap_Kd t.png\n")
    lines = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0\nvt 0.5\nvt 1\n"
    (tmp_path / "t.obj").write_text(f"mtllib t.mtl\n{lines}usemtl a\nf 1/1 2/2 3/3\n")
    mesh = '<visual name="v"><geometry><mesh><uri>t.obj</uri></mesh></geometry></visual>'
    model = f'<model name="m"><link name="l">{mesh}</link></model>'
    world = load_gazebo(write_world(tmp_path, FLOOR, WALLS, model), [])
    assert [[0.0, 0.0], [0.5, 0.0], [1.0, 0.0]] in world.parts.seen.uv.tolist()


def test_a_world_that_cannot_be_is_refused_in_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="no floor"):
        load_gazebo(write_world(tmp_path, WALLS), [])
    with pytest.raises(ConfigError, match="nothing on it"):
        load_gazebo(write_world(tmp_path, FLOOR), [])
    with pytest.raises(ConfigError, match=r"nothing solid.*no_such.*--models"):
        load_gazebo(write_world(tmp_path, "<include><uri>model://no_such</uri></include>"), [])
    pillar = box_model("pillar", "1 1 0.5 0 0 0", "0.4 0.4 1")
    with pytest.raises(ConfigError, match=r"stands in pillar/l"):
        load_gazebo(write_world(tmp_path, FLOOR, WALLS, pillar), [], Start(x=1.2, y=1.1, theta_rad=0.0))


def test_what_is_too_large_is_refused_before_it_is_read(tmp_path: Path) -> None:
    mesh = '<model name="m"><link name="l"><visual name="v"><geometry><mesh><uri>{}</uri></mesh></geometry></visual>'
    mesh += "</link></model>"
    (tmp_path / "big.stl").write_bytes(bytes(80) + struct.pack("<I", 10_000_000))
    with (tmp_path / "big.stl").open("r+b") as file:
        file.truncate(84 + 50 * 10_000_000)  # a sparse file
    with pytest.raises(InputError, match=r"big.stl has 10000000 triangles.*simplify"):
        load_gazebo(write_world(tmp_path, FLOOR, WALLS, mesh.format("big.stl")), [])
    (tmp_path / "big.png").write_bytes(png_header(16384, 16384))
    (tmp_path / "t.mtl").write_text("newmtl a\nmap_Kd big.png\n")
    (tmp_path / "t.obj").write_text("mtllib t.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nusemtl a\nf 1/1 2/1 3/1\n")
    with pytest.raises(InputError, match=r"big.png has .* pixels, at most 8192 x 8192.*smaller"):
        load_gazebo(write_world(tmp_path, FLOOR, WALLS, mesh.format("t.obj")), [])


def png_header(width: int, height: int) -> bytes:
    """The beginning of a PNG of this size, without pixels."""
    import zlib

    head = b"IHDR" + struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    data = b"IDAT" + zlib.compress(b"")
    chunks = (struct.pack(">I", len(c) - 4) + c + struct.pack(">I", zlib.crc32(c)) for c in (head, data, b"IEND"))
    return b"\x89PNG\r\n\x1a\n" + b"".join(chunks)

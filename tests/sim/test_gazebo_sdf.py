"""SDF files as lists of shapes: poses, includes, lamps, and what is named as missing."""

import math
from pathlib import Path

import numpy as np
import pytest
from gazebo_files import FLOOR, ROOM, box_model, write_world

from vsx_ros.errors import InputError
from vsx_ros.sim.gazebo import geometry
from vsx_ros.sim.gazebo.budget import Budget
from vsx_ros.sim.gazebo.paths import ModelFolders, below
from vsx_ros.sim.gazebo.sdf import Layout, read_layout
from vsx_ros.sim.gazebo.surfaces import GREY, Surface, gazebo_colour, ogre_material


def layout_of(path: Path, *folders: Path) -> Layout:
    return read_layout(path, ModelFolders(folders), Budget())


def test_poses_of_nested_models_multiply(tmp_path: Path) -> None:
    inner = box_model("inner", "1 0 0 0 0 0", "1 1 1")
    outer = box_model("outer", f"2 0 0 0 0 {math.pi / 2}", "1 1 1", inner)
    shapes = layout_of(write_world(tmp_path, outer)).shapes
    assert [shape.link for shape in shapes] == ["outer/l", "outer/l", "outer/inner/l", "outer/inner/l"]
    np.testing.assert_allclose(shapes[2].T_world[:3, 3], [2.0, 1.0, 0.0], atol=1e-12)
    assert [shape.solid for shape in shapes] == [False, True, False, True]


def test_a_pose_turns_about_fixed_axes() -> None:
    T = geometry.pose_matrix(0.0, 0.0, 0.0, math.pi / 2, 0.0, math.pi / 2)  # roll first, then yaw
    np.testing.assert_allclose(T[:3, :3] @ [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], atol=1e-12)
    np.testing.assert_allclose(T[:3, :3] @ [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], atol=1e-12)
    half = math.sqrt(0.5)
    Q = geometry.quaternion_matrix(1.0, 2.0, 3.0, 0.0, 0.0, half, half)
    np.testing.assert_allclose(Q, geometry.pose_matrix(1.0, 2.0, 3.0, 0.0, 0.0, math.pi / 2), atol=1e-12)


def test_degrees_and_saved_states_count(tmp_path: Path) -> None:
    turned = box_model("a", "0 0 0 0 0 90", "1 1 1").replace("<pose>", '<pose degrees="true">', 1)
    moved = box_model("b", "0 0 0 0 0 0", "1 1 1")
    state = '<state><model name="b"><pose>5 6 7 0 0 0</pose></model></state>'
    shapes = layout_of(write_world(tmp_path, turned, moved, state)).shapes
    np.testing.assert_allclose(shapes[0].T_world[:3, 0], [0.0, 1.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(shapes[2].T_world[:3, 3], [5.0, 6.0, 7.0])


def test_a_built_in_ground_lies_where_its_include_or_state_says(tmp_path: Path) -> None:
    ground = FLOOR.replace("</uri>", "</uri><pose>0 0 -0.5 0 0 0</pose>")
    assert {shape.T_world[2, 3] for shape in layout_of(write_world(tmp_path, ground)).shapes} == {-0.5}
    state = '<state><model name="ground_plane"><pose>0 0 -0.7 0 0 0</pose></model></state>'
    assert {shape.T_world[2, 3] for shape in layout_of(write_world(tmp_path, ground, state)).shapes} == {-0.7}


def test_an_included_lamp_hangs_where_its_include_says(tmp_path: Path) -> None:
    (tmp_path / "lamp").mkdir()
    light = '<light name="lamp" type="point"><pose>0 0 3 0 0 0</pose></light>'
    (tmp_path / "lamp/model.sdf").write_text(f'<sdf version="1.6">{light}</sdf>')
    bare = "<include><uri>model://lamp</uri></include>"
    placed = bare.replace("</uri>", "</uri><pose>4 5 2.5 0 0 0</pose>")
    lamps = layout_of(write_world(tmp_path, bare, placed), tmp_path).lamps
    assert [lamp.position.tolist() for lamp in lamps] == [[0.0, 0.0, 3.0], [4.0, 5.0, 2.5]]


def test_lamps_may_be_dimmed_or_off(tmp_path: Path) -> None:
    lamp = '<light name="a" type="point"><diffuse>1 1 1 1</diffuse>{}</light>'
    words = "", "<intensity>0.25</intensity>", "<light_on>false</light_on>", "<light_on>1</light_on>"
    lamps = layout_of(write_world(tmp_path, *(lamp.format(word) for word in words))).lamps
    assert [lamp.strength for lamp in lamps] == pytest.approx([1.0, 0.25, 1.0])


def test_a_state_moves_what_is_included_without_a_name(tmp_path: Path) -> None:
    (tmp_path / "tab").mkdir()
    model = box_model("my_table", "1 0 0 0 0 0", "1 1 1")
    (tmp_path / "tab/model.sdf").write_text(f'<sdf version="1.6">{model}</sdf>')
    state = '<state><model name="my_table"><pose>2 3 0 0 0 0</pose></model></state>'
    world = write_world(tmp_path, "<include><uri>model://tab</uri></include>", state)
    shapes = layout_of(world, tmp_path).shapes
    assert shapes[0].link == "my_table/l"
    assert shapes[0].T_world[:2, 3].tolist() == [2.0, 3.0]


def test_frames_that_do_not_exist_are_named(tmp_path: Path) -> None:
    model = box_model("t", "1 2 0 0 0 0", "1 1 1")
    usual = model.replace("<pose>", '<pose relative_to="world">', 1)
    usual = usual.replace('<visual name="v">', '<visual name="v"><pose relative_to="l">0 0 1 0 0 0</pose>')
    assert not layout_of(write_world(tmp_path, usual)).remarks
    others = [
        model.replace("<pose>", '<pose relative_to="room_b">', 1),
        model.replace("<pose>", '<pose frame="door">', 1),
        model.replace('name="t"', 'name="t" placement_frame="tip"', 1),
        model.replace('<link name="l">', '<link name="l"><pose relative_to="base">0 0 1 0 0 0</pose>'),
        "<include><uri>model://ground_plane</uri><placement_frame>edge</placement_frame></include>",
    ]
    remarks = layout_of(write_world(tmp_path, *others)).remarks
    assert len(remarks) == 5
    for word, remark in zip(("room_b", "door", "tip", "base", "edge"), remarks):
        assert f"there is no frame {word}" in remark
        assert "taken from its parent" in remark


def test_the_room_is_read_and_its_gaps_are_named() -> None:
    layout = layout_of(ROOM, ROOM.parents[1] / "models")
    links = {shape.link for shape in layout.shapes}
    assert {"walls/nested/east", "pillar/hidden", "table/aws_robomaker_residential_BalconyTable_01/link"} <= links
    assert len(layout.lamps) == 1
    assert layout.lamps[0].position.tolist() == [0.0, 4.5, 2.3]
    told = " ".join(layout.remarks)
    assert "no_such_model" in told
    assert "--models" in told
    assert "walker" in told


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("<robot/>", "<robot>"),
        ("not XML", "cannot be read"),
        ('<!DOCTYPE a [<!ENTITY b "c">]><sdf/>', "entities"),
        ('<sdf><world name="w"><model name="m"><pose>1 2 x 0 0 0</pose></model></world></sdf>', "model m"),
        ('<sdf><world name="w"><model name="m"><pose>1 2 nan 0 0 0</pose></model></world></sdf>', "6 numbers"),
    ],
)
def test_what_is_no_sdf_is_refused(tmp_path: Path, content: str, words: str) -> None:
    path = tmp_path / "w.world"
    path.write_text(content)
    with pytest.raises(InputError, match=words):
        layout_of(path)


def test_models_that_include_themselves_end(tmp_path: Path) -> None:
    (tmp_path / "m").mkdir()
    (tmp_path / "m/model.sdf").write_text(
        '<sdf version="1.6"><model name="m"><include><uri>model://m</uri></include></model></sdf>'
    )
    with pytest.raises(InputError, match="nested"):
        layout_of(write_world(tmp_path, "<include><uri>model://m</uri></include>"), tmp_path)


def test_names_are_found_in_any_case_and_never_outside(tmp_path: Path) -> None:
    (tmp_path / "models/Sofa/Meshes").mkdir(parents=True)
    mesh = tmp_path / "models/Sofa/Meshes/sofa.DAE"
    mesh.touch()
    folders = ModelFolders([tmp_path / "models"])
    assert folders.find("model://sofa/meshes/Sofa.dae", tmp_path) == mesh
    assert folders.find("file://models/Sofa/Meshes/sofa.DAE", tmp_path) == mesh
    assert folders.find("https://fuel.gazebosim.org/x", tmp_path) is None
    assert below(tmp_path / "models/Sofa", "../../../etc/passwd") is None


def test_the_newest_version_of_a_model_is_taken(tmp_path: Path) -> None:
    (tmp_path / "m").mkdir()
    for name in ("old", "new"):
        (tmp_path / f"m/{name}.sdf").write_text(f'<sdf version="1.6">{box_model(name, "0 0 0 0 0 0", "1 1 1")}</sdf>')
    config = '<model><sdf version="1.5">new.sdf</sdf><sdf version="1.4">old.sdf</sdf></model>'
    (tmp_path / "m/model.config").write_text(config)
    world = write_world(tmp_path, FLOOR, "<include><uri>model://m</uri><pose>0 0 2 0 0 0</pose></include>")
    shape = layout_of(world, tmp_path).shapes[-1]
    assert shape.T_world[2, 3] == 2.0


@pytest.mark.parametrize(
    ("triangles", "area"),
    [
        (geometry.box(1.0, 2.0, 3.0), 22.0),
        (geometry.cylinder(0.5, 2.0), 7.81),
        (geometry.sphere(1.0), 12.38),
        (geometry.plane(np.array([0.0, 0.0, 1.0]), 2.0, 3.0), 6.0),
    ],
)
def test_shapes_have_their_surface_and_face_outwards(triangles: geometry.Triangles, area: float) -> None:
    a, b, c = (triangles.corners[:, i] for i in range(3))
    normals = 0.5 * np.cross(b - a, c - a)
    assert np.linalg.norm(normals, axis=1).sum() == pytest.approx(area, abs=0.08)
    assert ((normals * (a + b + c)).sum(axis=1) >= -1e-9).all()
    assert len(triangles.uv) == len(triangles.corners)


@pytest.mark.parametrize(
    ("diffuse", "colour"),
    [
        ("0.2 0.4 0.6", (0.2, 0.4, 0.6)),
        ("3 -1 5e-1 1", (1.0, 0.0, 0.5)),
        ("1.2.3 . 0", (1.0, 1.0, 1.0)),
        ("vertexcolour 0 0", (1.0, 1.0, 1.0)),
        ("nan 0 0", (1.0, 1.0, 1.0)),
    ],
)
def test_an_ogre_script_with_any_words_gives_a_colour(
    tmp_path: Path, diffuse: str, colour: tuple[float, float, float]
) -> None:
    (tmp_path / "a.material").write_text(f"material Rug\n{{\n technique {{ pass {{ diffuse {diffuse}\n }} }}\n}}\n")
    assert ogre_material(tmp_path, "Rug", lambda name, file: None) == (colour, None, "")


@pytest.mark.parametrize(
    ("material", "surface", "named"),
    [
        ("<script><uri>model://lost/scripts</uri><name>My/Textured</name></script>", None, "My/Textured"),
        ("<script><uri>model://lost/scripts</uri><name>My/Red</name></script>", None, "My/Red"),
        ("<script><name>My/Red</name></script><diffuse>0 1 0 1</diffuse>", Surface((0.0, 1.0, 0.0)), "My/Red"),
        ("<script><uri>a.material</uri><name>My/Lamp</name></script>", None, "My/Lamp"),
        ("<script><uri>a.material</uri><name>My/Rug</name></script>", Surface((0.0, 0.0, 1.0)), ""),
        ("<script><name>Gazebo/Red</name></script>", Surface((0.9, 0.1, 0.1)), ""),
        ("<script><name>Gazebo/Red</name></script><ambient>0 1 0 1</ambient>", Surface((0.0, 1.0, 0.0)), ""),
        ("<script><uri>__default__</uri><name>__default__</name></script>", None, ""),
        ("<script/>", None, ""),
    ],
)
def test_a_material_that_is_in_no_script_is_named(
    tmp_path: Path, material: str, surface: Surface | None, named: str
) -> None:
    (tmp_path / "a.material").write_text("material My/Rug\n{\n technique { pass { diffuse 0 0 1\n } }\n}\n")
    model = box_model("m", "0 0 0 0 0 0", "1 1 1").replace("</visual>", f"<material>{material}</material></visual>")
    shape = layout_of(write_world(tmp_path, model)).shapes[0]
    assert shape.surface == surface
    assert shape.missing == (f"material {named} is in none of its scripts and left out" if named else "")


def test_colours_of_gazebo_are_whole_words() -> None:
    same = ("Red", "red", "RedBright"), ("Blue", "SkyBlue", "BlueTransparent"), ("Wood", "WoodFloor", "LightWood")
    for first, *others in same:
        assert {gazebo_colour(f"Gazebo/{name}") for name in others} == {gazebo_colour(f"Gazebo/{first}")} != {GREY}
    assert gazebo_colour("Gazebo/DarkGrey")[0] < GREY[0]
    for name in ("Gazebo/Grey", "Gazebo/Textured", "Gazebo/Plywoodish", "Gazebo/Marigold"):
        assert gazebo_colour(name) == GREY

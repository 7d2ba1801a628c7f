"""Meshes of a Gazebo world: which parts of a DAE file are drawn, and what is told of the others."""

import base64
import json
from pathlib import Path

import numpy as np
import pytest
from dae_files import INSTANCE, SKIN, SURFACE, material, write_dae
from gazebo_files import write_world
from PIL import Image

from vsx_ros.errors import InputError
from vsx_ros.sim.gazebo.assemble import Parts, assemble
from vsx_ros.sim.gazebo.budget import Budget
from vsx_ros.sim.gazebo.paths import ModelFolders
from vsx_ros.sim.gazebo.sdf import read_layout


def parts_of(folder: Path, mesh: str, kind: str = "visual") -> Parts:
    shape = f'<{kind} name="v"><geometry><mesh>{mesh}</mesh></geometry></{kind}>'
    world = write_world(folder, f'<model name="m"><link name="l">{shape}</link></model>')
    folders, budget = ModelFolders([]), Budget()
    return assemble(read_layout(world, folders, budget), folders, budget)


@pytest.mark.parametrize(("name", "triangles"), [("Wall", 1), ("Cube.001", 1), ("Door", 0)])
def test_a_submesh_has_the_name_of_its_node_or_else_of_its_geometry(tmp_path: Path, name: str, triangles: int) -> None:
    write_dae(tmp_path / "a.dae", '<node id="n" name="Wall"><instance_geometry url="#g"/></node>')
    parts = parts_of(tmp_path, f"<uri>a.dae</uri><submesh><name>{name}</name></submesh>")
    assert len(parts.seen.corners) == triangles
    assert [remark for remark in parts.remarks if "no submesh Door" in remark] == parts.remarks
    assert len(parts.remarks) == 1 - triangles


def test_the_name_of_a_node_comes_before_that_of_a_geometry(tmp_path: Path) -> None:
    here = '<node id="n" name="Cube.001"><instance_geometry url="#g"/></node>'
    there = '<node id="o" name="Roof"><translate>0 0 5</translate><instance_geometry url="#g"/></node>'
    write_dae(tmp_path / "a.dae", here, there)
    parts = parts_of(tmp_path, "<uri>a.dae</uri><submesh><name>Cube.001</name></submesh>")
    assert parts.seen.corners[:, :, 2].tolist() == [[0.0, 0.0, 0.0]]


def test_a_skinned_mesh_is_drawn_at_rest(tmp_path: Path) -> None:
    node = '<node id="n" name="Person"><translate>0 0 2</translate><instance_controller url="#c"/></node>'
    write_dae(tmp_path / "a.dae", node, more=SKIN)
    parts = parts_of(tmp_path, "<uri>a.dae</uri>")
    assert parts.seen.corners[:, :, 2].tolist() == [[2.0, 2.0, 2.0]]
    assert not parts.remarks


def test_a_mesh_file_that_shows_nothing_is_named(tmp_path: Path) -> None:
    write_dae(tmp_path / "a.dae")
    parts = parts_of(tmp_path, "<uri>a.dae</uri>")
    assert len(parts.seen.corners) == 0
    assert any("a.dae shows no triangles" in remark for remark in parts.remarks)


WHOLE = f'<node id="n" name="Wall">{INSTANCE}</node>'


@pytest.mark.parametrize(
    ("node", "more", "lost"),
    [
        ('<node id="o"><instance_geometry url="#h"/></node>', "", "geometry h"),
        ('<node id="o"><instance_controller url="#c"/></node>', SKIN.replace('"#g"', '"#h"'), "controller c"),
        (f'<node id="o" name="Door"><matrix>1 0 0</matrix>{INSTANCE}</node>', "", "matrix of Door"),
        (f'<node id="o" name="Door"><skew>1 0 0 0 1 0 0</skew>{INSTANCE}</node>', "", "skew of Door"),
        ('<node id="o"><node id="p"><instance_geometry url="b.dae#g"/></node></node>', "", "geometry b.dae#g"),
    ],
)
def test_a_damaged_part_of_a_dae_file_is_named_and_no_solid_may_have_one(
    tmp_path: Path, node: str, more: str, lost: str
) -> None:
    lamp = '<node id="e"><instance_light url="#no"/><instance_camera url="#no"/><extra/></node>'
    write_dae(tmp_path / "a.dae", WHOLE, node, lamp, more=more)
    parts = parts_of(tmp_path, "<uri>a.dae</uri>")
    assert parts.remarks == [f"a.dae: {lost} is damaged and left out"]
    assert len(parts.seen.corners) >= 1
    with pytest.raises(InputError, match=rf"collision m/l/v: mesh .*a\.dae is damaged \({lost}\), and solid"):
        parts_of(tmp_path, "<uri>a.dae</uri>", "collision")


def test_a_scene_that_is_not_there_is_named(tmp_path: Path) -> None:
    write_dae(tmp_path / "a.dae", WHOLE)
    (tmp_path / "a.dae").write_text((tmp_path / "a.dae").read_text().replace('url="#s"', 'url="#t"'))
    assert "a.dae: scene is damaged and left out" in parts_of(tmp_path, "<uri>a.dae</uri>").remarks


@pytest.mark.parametrize(
    ("effect", "remark"),
    [
        (SURFACE, "material m cannot be read; grey is drawn in its place"),
        ("", "texture rug does not exist; paint is drawn in its place"),
        (None, "material m cannot be read; grey is drawn in its place"),
    ],
)
def test_a_material_without_its_picture_takes_no_geometry_with_it(
    tmp_path: Path, effect: str | None, remark: str
) -> None:
    node, libraries = material("rug", effect)
    write_dae(tmp_path / "a.dae", node, more=libraries)
    for kind in ("visual", "collision"):
        parts = parts_of(tmp_path, "<uri>a.dae</uri>", kind)
        assert f"a.dae: {remark}" in parts.remarks
        assert len(parts.seen.corners) == 1


def write_gltf(folder: Path, corner: dict, **more: object) -> None:
    """A triangle whose corners are 8-bit integers; corner: more of their accessor; None takes a value away."""
    data = np.array([[0, 0, 2, 0], [1, 0, 2, 0], [0, 1, 2, 0]], np.int8).tobytes()
    accessor = {"bufferView": 0, "componentType": 5120, "count": 3, "type": "VEC3", **corner}
    tree = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "scale": [0.5, 0.5, 0.5]}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "accessors": [{name: value for name, value in accessor.items() if value is not None}],
        "bufferViews": [{"buffer": 0, "byteOffset": 0, "byteLength": len(data), "byteStride": 4}],
        "buffers": [{"byteLength": len(data), "uri": "data:;base64," + base64.b64encode(data).decode()}],
        **more,
    }
    (folder / "a.gltf").write_text(json.dumps(tree))


def test_a_gltf_file_with_extensions_that_change_no_shape_is_read(tmp_path: Path) -> None:
    harmless = ["KHR_mesh_quantization", "KHR_materials_unlit"]
    write_gltf(tmp_path, {}, extensionsUsed=harmless, extensionsRequired=harmless)
    parts = parts_of(tmp_path, "<uri>a.gltf</uri>")
    assert parts.seen.corners.tolist() == [[[0.0, 0.0, 1.0], [0.5, 0.0, 1.0], [0.0, 0.5, 1.0]]]


@pytest.mark.parametrize(
    "name", ["KHR_draco_mesh_compression", "EXT_meshopt_compression", "EXT_mesh_gpu_instancing", "KHR_texture_basisu"]
)
def test_a_gltf_file_that_needs_an_extension_is_refused_with_its_name(tmp_path: Path, name: str) -> None:
    write_gltf(tmp_path, {}, extensionsUsed=[name], extensionsRequired=["KHR_mesh_quantization", name])
    with pytest.raises(InputError, match=rf"a.gltf cannot be read \(it needs {name}, which is not supported"):
        parts_of(tmp_path, "<uri>a.gltf</uri>")


@pytest.mark.parametrize(
    ("corner", "words"),
    [
        ({"bufferView": None}, "compressed or not there"),
        ({"sparse": {"count": 1}}, "sparse"),
        ({"normalized": True}, "normalized integers"),
    ],
)
def test_a_gltf_file_with_corners_that_would_be_misread_is_refused(tmp_path: Path, corner: dict, words: str) -> None:
    write_gltf(tmp_path, corner)
    with pytest.raises(InputError, match=words):
        parts_of(tmp_path, "<uri>a.gltf</uri>")


def write_obj(folder: Path, *materials: str) -> None:
    """A triangle with a texture for each of the materials a, b and c; materials: what the MTL file says of them."""
    lines = [f"newmtl {name}\n{said}\n" for name, said in zip("abc", materials)]
    (folder / "a.mtl").write_text("".join(lines))
    faces = "".join(f"usemtl {name}\nf 1/1 2/2 3/3\n" for name, _ in zip("abc", materials))
    (folder / "a.obj").write_text(f"mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\n{faces}")


def test_a_lost_texture_paints_its_own_material_alone(tmp_path: Path) -> None:
    write_obj(tmp_path, "Kd 1 0 0", "Kd 1 1 1\nmap_Kd gone.png", "map_Kd lost.png\nKd 0 1 0")
    parts = parts_of(tmp_path, "<uri>a.obj</uri>")
    told = [f"a.obj: texture {name} does not exist; paint is drawn in its place" for name in ("gone.png", "lost.png")]
    assert sorted(parts.remarks) == told
    shown = {tuple(colour): row >= 0 for colour, row in zip(parts.seen.colours.tolist(), parts.seen.pictures)}
    assert shown == {(1.0, 0.0, 0.0): False, (1.0, 1.0, 1.0): True, (0.0, 1.0, 0.0): True}
    assert len(parts.seen.textures.logs) == 2


def test_a_lost_texture_of_a_gltf_file_paints_its_own_material_alone(tmp_path: Path) -> None:
    view = {"bufferView": 0, "componentType": 5120, "count": 3}
    plain, painted = (
        {"pbrMetallicRoughness": {"baseColorFactor": [0, 1, 0, 1]}},
        {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}},
    )
    attributes = {"POSITION": 0, "TEXCOORD_0": 1}
    write_gltf(
        tmp_path,
        {},
        accessors=[{**view, "type": "VEC3"}, {**view, "type": "VEC2"}],
        meshes=[{"primitives": [{"attributes": attributes, "material": k} for k in (0, 1)]}],
        materials=[plain, painted],
        textures=[{"source": 0}],
        images=[{"uri": "gone.png"}],
    )
    parts = parts_of(tmp_path, "<uri>a.gltf</uri>")
    assert parts.remarks == ["a.gltf: texture gone.png does not exist; paint is drawn in its place"]
    shown = dict(zip(map(tuple, parts.seen.colours.tolist()), parts.seen.pictures >= 0))
    assert shown.pop((0.0, 1.0, 0.0)) == np.False_
    assert list(shown.values()) == [np.True_]


@pytest.mark.parametrize(
    "words", ["-s 2 2 1 ", "-o 0.5 -s 2 ", "-clamp on -mm 0 1 ", "-blendu off -blendv off -bm 1e-1 ", ""]
)
@pytest.mark.parametrize("name", ["rug.png", "old rug.png", "1.png", "rug.gif"])
def test_the_options_of_a_texture_are_no_part_of_its_name(tmp_path: Path, words: str, name: str) -> None:
    Image.new("RGB", (8, 8), (10, 200, 10)).save(tmp_path / name)
    write_obj(tmp_path, f"map_Kd {words}{name}")
    parts = parts_of(tmp_path, "<uri>a.obj</uri>")
    assert not parts.remarks
    assert parts.seen.textures.texels[0].tobytes()[:3] == bytes((10, 200, 10))


def test_a_file_of_materials_is_named_or_found_in_its_model(tmp_path: Path) -> None:
    (tmp_path / "meshes").mkdir()
    write_obj(tmp_path / "meshes", "Kd 1 0 0")
    (tmp_path / "meshes/a.mtl").rename(tmp_path / "B.mtl")
    given = (tmp_path / "meshes/a.obj").read_text()
    assert parts_of(tmp_path, "<uri>meshes/a.obj</uri>").remarks == ["a.obj: a.mtl does not exist and is left out"]
    (tmp_path / "meshes/a.obj").write_text(given.replace("a.mtl", "../b.mtl"))
    parts = parts_of(tmp_path, "<uri>meshes/a.obj</uri>")
    assert not parts.remarks
    assert parts.seen.colours.tolist() == [[1.0, 0.0, 0.0]]

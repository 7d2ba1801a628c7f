"""Meshes of a Gazebo world: which parts of a DAE file are drawn, and what is told of the others."""

import base64
import json
from pathlib import Path

import numpy as np
import pytest
from dae_files import SKIN, write_dae
from gazebo_files import write_world

from vsx_ros.errors import InputError
from vsx_ros.sim.gazebo.assemble import Parts, assemble
from vsx_ros.sim.gazebo.budget import Budget
from vsx_ros.sim.gazebo.paths import ModelFolders
from vsx_ros.sim.gazebo.sdf import read_layout


def parts_of(folder: Path, mesh: str) -> Parts:
    visual = f'<visual name="v"><geometry><mesh>{mesh}</mesh></geometry></visual>'
    world = write_world(folder, f'<model name="m"><link name="l">{visual}</link></model>')
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

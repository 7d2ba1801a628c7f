"""Meshes of a Gazebo world: which parts of a DAE file are drawn, and what is told of the others."""

from pathlib import Path

import pytest
from dae_files import SKIN, write_dae
from gazebo_files import write_world

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

"""A small COLLADA file for tests."""

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

_HEAD = '<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1"><asset><unit meter="1"/></asset>'
INSTANCE = '<instance_geometry url="#g"/>'


def _mesh(points: ArrayLike, faces: ArrayLike) -> str:
    """Of corners (N, 3) and triangles (T, 3)."""
    corners, index = np.asarray(points, float), np.asarray(faces)
    array = f'<float_array id="f" count="{corners.size}">{" ".join(map(str, corners.ravel()))}</float_array>'
    axes = "".join(f'<param name="{axis}" type="float"/>' for axis in "XYZ")
    accessor = f'<accessor source="#f" count="{len(corners)}" stride="3">{axes}</accessor>'
    source = f'<source id="p">{array}<technique_common>{accessor}</technique_common></source>'
    vertices = '<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>'
    face = f'<input semantic="VERTEX" source="#v" offset="0"/><p>{" ".join(map(str, index.ravel()))}</p>'
    return f'<mesh>{source}{vertices}<triangles material="m" count="{len(index)}">{face}</triangles></mesh>'


def _source(kind: str, values: str, count: int, stride: int, param: str) -> str:
    array = f'<{kind}_array id="{param}a" count="{count * stride}">{values}</{kind}_array>'
    what = f'<param name="{param}" type="{"name" if kind == "Name" else "float"}{"4x4" if stride == 16 else ""}"/>'
    accessor = f'<accessor source="#{param}a" count="{count}" stride="{stride}">{what}</accessor>'
    return f'<source id="{param}">{array}<technique_common>{accessor}</technique_common></source>'


_ONE = "1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1"
_JOINT = '<input semantic="JOINT" source="#JOINT"'
_SKIN = f"<bind_shape_matrix>{_ONE}</bind_shape_matrix>{_source('Name', 'b', 1, 1, 'JOINT')}"
_SKIN += f"{_source('float', _ONE, 1, 16, 'TRANSFORM')}{_source('float', '1', 1, 1, 'WEIGHT')}"
_SKIN += f'<joints>{_JOINT}/><input semantic="INV_BIND_MATRIX" source="#TRANSFORM"/></joints>'
_SKIN += f'<vertex_weights count="3">{_JOINT} offset="0"/><input semantic="WEIGHT" source="#WEIGHT" offset="1"/>'
_SKIN += "<vcount>1 1 1</vcount><v>0 0 0 0 0 0</v></vertex_weights>"
SKIN = f'<library_controllers><controller id="c"><skin source="#g">{_SKIN}</skin></controller></library_controllers>'


SURFACE = '<newparam sid="s"><surface type="2D"><init_from>rug</init_from></surface></newparam>'
SURFACE += '<newparam sid="rug"><sampler2D><source>s</source></sampler2D></newparam>'


def material(picture: str, effect: str | None) -> tuple[str, str]:
    """A node of the geometry with a material "m", and its libraries. picture: the name by which the material's effect
    uses it; effect: what declares it there; None: there is no effect."""
    shade = f'<lambert><diffuse><texture texture="{picture}" texcoord="UV"/></diffuse></lambert>'
    profile = f'<profile_COMMON>{effect}<technique sid="t">{shade}</technique></profile_COMMON>'
    library = "" if effect is None else f'<library_effects><effect id="e">{profile}</effect></library_effects>'
    library += '<library_materials><material id="m"><instance_effect url="#e"/></material></library_materials>'
    bound = '<technique_common><instance_material symbol="m" target="#m"/></technique_common>'
    instance = INSTANCE.replace("/>", f"><bind_material>{bound}</bind_material></instance_geometry>")
    return f'<node id="n">{instance}</node>', library


def write_dae(
    path: Path,
    *nodes: str,
    more: str = "",
    points: ArrayLike = ((0, 0, 0), (1, 0, 0), (0, 1, 0)),
    faces: ArrayLike = ((0, 1, 2),),
) -> None:
    """A DAE file with a mesh, at first a triangle, the geometry "g" with the name "Cube.001", and a scene of these
    nodes; without nodes, no scene. more: other libraries."""
    mesh = _mesh(points, faces)
    geometries = f'<library_geometries><geometry id="g" name="Cube.001">{mesh}</geometry></library_geometries>'
    scenes = f'<visual_scene id="s">{"".join(nodes)}</visual_scene>'
    scene = f'<library_visual_scenes>{scenes}</library_visual_scenes><scene><instance_visual_scene url="#s"/></scene>'
    path.write_text(f"{_HEAD}{geometries}{more}{scene if nodes else ''}</COLLADA>")

"""A small COLLADA file for tests."""

from pathlib import Path

_HEAD = '<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1"><asset><unit meter="1"/></asset>'
_POINTS = '<float_array id="f" count="9">0 0 0 1 0 0 0 1 0</float_array><technique_common>'
_POINTS += '<accessor source="#f" count="3" stride="3"><param name="X" type="float"/><param name="Y" type="float"/>'
_POINTS += '<param name="Z" type="float"/></accessor></technique_common>'
_MESH = f'<mesh><source id="p">{_POINTS}</source><vertices id="v"><input semantic="POSITION" source="#p"/></vertices>'
_MESH += '<triangles count="1"><input semantic="VERTEX" source="#v" offset="0"/><p>0 1 2</p></triangles></mesh>'


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


def write_dae(path: Path, *nodes: str, more: str = "") -> None:
    """A DAE file with a triangle, the geometry "g" with the name "Cube.001", and a scene of these nodes; without nodes,
    no scene. more: other libraries."""
    geometries = f'<library_geometries><geometry id="g" name="Cube.001">{_MESH}</geometry></library_geometries>'
    scenes = f'<visual_scene id="s">{"".join(nodes)}</visual_scene>'
    scene = f'<library_visual_scenes>{scenes}</library_visual_scenes><scene><instance_visual_scene url="#s"/></scene>'
    path.write_text(f"{_HEAD}{geometries}{more}{scene if nodes else ''}</COLLADA>")

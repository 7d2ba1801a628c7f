"""What a glTF file asks for, from its JSON alone: trimesh makes all of it before anything can be counted."""

import struct
from pathlib import Path
from typing import Any

from vsx_ros.limits import MIB, file_bytes, json_tree

MOST_JSON = 64 * MIB  # bytes; it may hold the data as text
MOST_VALUES = 500_000  # of the JSON
MOST_DATA = 256 * MIB  # bytes of its buffers, views and numbers
MOST_VERTICES = 4_000_000  # of all primitives, with their indices
MOST_PARTS, DEEPEST = 4000, 64  # nodes, primitives, primitives of nodes; nodes in nodes
LONGEST_NAME = 1000
_BYTES = {5120: 1, 5121: 1, 5122: 2, 5123: 2, 5125: 4, 5126: 4}
_VALUES = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
_STRIP, _TRIANGLES = 5, 4  # modes of primitives
_GLOSS = "KHR_materials_pbrSpecularGlossiness"
_READ = "KHR_materials_", "KHR_lights_punctual", "KHR_mesh_quantization", "EXT_texture_webp"  # extensions, or ignored


def triangles_of(path: Path) -> int:
    """The number of triangles with all nodes that use them. Raises ValueError for a file that asks for more than any
    mesh needs, and what is in ``DAMAGE`` for a damaged one."""
    text = _json(path)
    if sum(text.count(mark) for mark in (b"[", b"{", b",")) > MOST_VALUES:
        raise ValueError(f"it has more than {MOST_VALUES} values")
    tree = json_tree(text)
    _check_extensions(tree)
    if any(
        _GLOSS in m.get("extensions", {}) and b"specularGlossinessTexture" in text for m in _list(tree, "materials")
    ):
        raise ValueError(f"its materials are given by {_GLOSS}, where roughness and metal are read")
    accessors, nodes = _list(tree, "accessors"), _list(tree, "nodes")
    views = [_whole(view["byteLength"]) for view in _list(tree, "bufferViews")]
    data = [_whole(a["count"]) * _VALUES[a["type"]] * _BYTES[a["componentType"]] for a in accessors]
    _at_most(sum(views) + sum(data), MOST_DATA, "bytes of data")
    _check_corners(tree, accessors)
    meshes = [mesh["primitives"] for mesh in _list(tree, "meshes")]
    used = [node["mesh"] for node in nodes if "mesh" in node]
    copied = sum(len(mesh["primitives"]) * len(mesh.get("extras") or ()) for mesh in _list(tree, "meshes"))
    _at_most(copied, MOST_VALUES, "values in the extras of its primitives")
    _at_most(max(len(nodes), sum(map(len, meshes)), sum(len(meshes[k]) for k in used)), MOST_PARTS, "nodes or parts")
    _check_tree(nodes, _list(tree, "scenes"))
    counts = [a["count"] for a in accessors]
    sizes = [[_sizes(primitive, counts) for primitive in mesh] for mesh in meshes]
    _at_most(sum(vertices for mesh in sizes for vertices, _ in mesh), MOST_VERTICES, "vertices in its primitives")
    return sum(triangles for k in used for _, triangles in sizes[k])


def _check_extensions(tree: Any) -> None:
    """trimesh reads a file without the extensions that it needs, and makes corners of zeros, or copies of one thing."""
    needed = [str(name) for name in tree.get("extensionsRequired", ()) if not str(name).startswith(_READ)]
    if needed:
        raise ValueError(f"it needs {', '.join(needed):.200}, which is not supported: switch that off")


def _check_corners(tree: Any, accessors: list[Any]) -> None:
    """Raises ValueError for corners or indices that trimesh would read as other numbers."""
    primitives = [primitive for mesh in _list(tree, "meshes") for primitive in mesh["primitives"]]
    corners = {p["attributes"]["POSITION"] for p in primitives if "POSITION" in p["attributes"]}
    for k in corners | {p["indices"] for p in primitives if "indices" in p}:
        if "bufferView" not in accessors[k] or "sparse" in accessors[k]:
            raise ValueError("its corners are sparse, compressed or not there: store them plainly")
        if k in corners and accessors[k].get("normalized"):
            raise ValueError("its corners are normalized integers: store them as decimal numbers")


def _check_tree(nodes: list[Any], scenes: list[Any]) -> None:
    """As glTF demands, no node has two parents: trimesh follows the parents of each."""
    layer = {k for scene in scenes for k in scene.get("nodes", ())}
    children = [k for node in nodes for k in node.get("children", ())]
    if len(layer.union(children)) != len(layer) + len(children):
        raise ValueError("its nodes are no tree")
    for _ in range(DEEPEST):
        layer = {k for parent in layer for k in nodes[parent].get("children", ())}
    if layer:
        raise ValueError(f"its nodes are nested more than {DEEPEST} deep")


def _json(path: Path) -> bytes:
    if path.suffix.lower() == ".gltf":
        return file_bytes(path, MOST_JSON)
    with path.open("rb") as file:
        length = struct.unpack("<5I", file.read(20))[3]
        _at_most(length, MOST_JSON, "bytes of JSON")
        return file.read(length)


def _list(tree: Any, name: str) -> list[Any]:
    """The tables of a list. Raises ValueError if it is none, or one of them has an enormous name."""
    tables = tree.get(name, [])
    if not isinstance(tables, list) or not all(isinstance(one, dict) for one in tables):
        raise ValueError(f"its {name} are no list of tables")
    _at_most(max((len(str(one.get("name", ""))) for one in tables), default=0), LONGEST_NAME, f"letters in {name}")
    return tables


def _sizes(primitive: Any, counts: list[int]) -> tuple[int, int]:
    """Numbers of vertices and indices together, and of triangles."""
    vertices = sum(counts[k] for k in primitive["attributes"].values())
    corners = counts[primitive["indices"]] if "indices" in primitive else counts[primitive["attributes"]["POSITION"]]
    mode = primitive.get("mode", _TRIANGLES)
    return vertices + corners, {_TRIANGLES: corners // 3, _STRIP: max(corners - 2, 0)}.get(mode, 0)


def _whole(number: Any) -> int:
    if not isinstance(number, int) or number < 0:
        raise ValueError(f"{number!r:.40} is no number of things")
    return number


def _at_most(count: int, most: int, what: str) -> None:
    if count > most:
        raise ValueError(f"it asks for {count:.4g} {what}, at most {most} are read")

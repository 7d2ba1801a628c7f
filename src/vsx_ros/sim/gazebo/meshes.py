"""Mesh files as triangles: DAE by pycollada, OBJ, STL and glTF by trimesh."""

import re
import struct
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from vsx_ros.arrays import FloatArray
from vsx_ros.errors import InputError, explained
from vsx_ros.limits import DAMAGE, MIB, Allowance, file_bytes
from vsx_ros.sim.gazebo import gltf
from vsx_ros.sim.gazebo.budget import MOST_TRIANGLES, Budget
from vsx_ros.sim.gazebo.pictures import picture_of, read_picture, substitute
from vsx_ros.sim.gazebo.surfaces import Colour, Surface

MOST_BYTES = 512 * MIB
MOST_BESIDE = 128 * MIB  # bytes of the files that a mesh names, each time it does
MOST_TAGS = 500_000  # of a DAE file
KINDS = (".dae", ".obj", ".stl", ".gltf", ".glb")
PICTURES = (".png", ".jpg", ".jpeg", ".tga", ".bmp", ".tif", ".tiff", ".webp", ".dds")
_COUNT = re.compile(rb"<(?:triangles|polylist|polygons|trifans|tristrips)\b[^>]*\bcount=\"(\d+)\"")

_FACE = re.compile(rb"^f[ \t]([^\n]*)", re.MULTILINE)

FindTexture = Callable[[str, Path], Path | None]


class MeshPart(NamedTuple):
    """Triangles of one surface: corners (T, 3, 3) [m] in the mesh's own axes, uv (T, 3, 2). name: of the geometry;
    node: of what uses it in the file's scene. missing: name of a picture that does not exist, or empty."""

    corners: FloatArray
    uv: FloatArray
    surface: Surface
    name: str
    missing: str = ""
    node: str = ""

    def unmirrored(self, matrix: FloatArray) -> "MeshPart":
        """With faces that look the same way as before a matrix (3, 3) moved their corners: one that mirrors turns them
        around."""
        if np.linalg.det(matrix) >= 0.0:
            return self
        return self._replace(corners=self.corners[:, ::-1], uv=self.uv[:, ::-1])


def read_mesh(path: Path, find_texture: FindTexture, budget: Budget) -> list[MeshPart]:
    """The parts of a mesh file. Its unit is applied; its up axis is ignored, as Gazebo does. Raises InputError for a
    file that is too large, damaged, or of an unknown kind."""
    if path.suffix.lower() not in KINDS:
        raise InputError(f"mesh {path} is none of {', '.join(KINDS)}; convert it")
    read = _collada_parts if path.suffix.lower() == ".dae" else _trimesh_parts
    with explained(InputError, f"mesh {path} cannot be read", "export it again", (*DAMAGE, *_foreign_errors())):
        announced = _announced(path)
        if announced > MOST_TRIANGLES:
            most = f"at most {MOST_TRIANGLES} can be drawn"
            raise InputError(f"mesh {path} has {announced} triangles, {most}; simplify it")
        parts = [part for part in read(path, find_texture, budget) if len(part.corners)]
    if any(not np.isfinite(part.corners).all() for part in parts):
        raise InputError(f"mesh {path} has corners that are not finite; export it again")
    return parts


def _foreign_errors() -> tuple[type[Exception], ...]:
    from collada.common import DaeError

    return (DaeError,)


def _announced(path: Path) -> int:
    """The number of triangles or faces that a file says it has, or its size suggests."""
    size, kind = path.stat().st_size, path.suffix.lower()
    if size > MOST_BYTES:
        return size // 50
    with path.open("rb") as file:
        if kind == ".stl":
            head = file.read(84)
            number = struct.unpack("<I", head[80:])[0] if len(head) == 84 else 0
            return number if 84 + 50 * number == size else size // 250  # the text form takes 250 bytes each
    if kind in (".gltf", ".glb"):
        return gltf.triangles_of(path)
    content = path.read_bytes()
    if kind == ".obj":
        joined = content.replace(b"\\\n", b"")
        return sum(max(len(face[1].split()) - 2, 1) for face in _FACE.finditer(joined))
    if b"<!ENTITY" in content or content.count(b"<") > MOST_TAGS:
        raise ValueError(f"it defines entities or has more than {MOST_TAGS} tags")
    return sum(int(number) for number in _COUNT.findall(content))


def _colour(values: Any) -> Colour:
    r, g, b = (min(max(float(value), 0.0), 1.0) for value in list(values)[:3])
    return r, g, b


def _collada_parts(path: Path, find_texture: FindTexture, budget: Budget) -> Iterator[MeshPart]:
    import collada

    document = collada.Collada(str(path), ignore=[collada.common.DaeError])
    metres = float(document.assetInfo.unitmeter or 1.0)
    surfaces: dict[Any, tuple[Surface, str]] = {}
    nodes = document.scene.nodes if document.scene is not None else ()
    for node, geometry in _instances(nodes, "", None, path, budget):
        for primitive in geometry.primitives():
            budget.take("vertices", len(primitive.vertex) if primitive.vertex is not None else 0, str(path))
            triangles = primitive.triangleset() if hasattr(primitive, "triangleset") else primitive
            index = getattr(triangles, "vertex_index", None)
            if index is None or triangles.vertex is None or np.shape(index)[1:] != (3,):
                continue  # lines
            budget.take("triangles", len(index), str(path))
            corners = metres * np.asarray(triangles.vertex, float)[index]
            uv = np.zeros((len(index), 3, 2))
            if len(triangles.texcoordset):
                uv = _uv(triangles.texcoordset[0], triangles.texcoord_indexset[0])
            if triangles.material not in surfaces:
                surfaces[triangles.material] = _collada_surface(triangles.material, path, find_texture)
            surface, missing = surfaces[triangles.material]
            name = str(geometry.original.name or geometry.original.id)
            part = MeshPart(corners=corners, uv=uv, surface=surface, name=name, missing=missing, node=node)
            yield part.unmirrored(geometry.matrix[:3, :3])


def _instances(nodes: Any, name: str, matrix: Any, path: Path, budget: Budget) -> Iterator[tuple[str, Any]]:
    """The geometries below nodes and the names of their nodes (name: of the nodes' parent), as
    ``collada.scene.Scene.objects``, but each node counts each time it is used."""
    from collada.scene import ControllerNode, Node

    for node in nodes:
        budget.take("parts of meshes", 1, str(path))
        if isinstance(node, Node):
            inner = node.matrix if matrix is None else np.dot(matrix, node.matrix)
            yield from _instances(node.children, getattr(node, "node", node).name or "", inner, path, budget)
        elif isinstance(node, ControllerNode):  # a skin at rest
            bound = node.objects("controller", matrix)
            yield from ((name, skin.geometry) for skin in bound if getattr(skin, "geometry", None) is not None)
        else:
            yield from ((name, geometry) for geometry in node.objects("geometry", matrix))


def _collada_surface(material: Any, path: Path, find_texture: FindTexture) -> tuple[Surface, str]:
    """Transparency is ignored: most exporters write it wrong, and Gazebo draws such files opaque."""
    effect = getattr(material, "effect", None)
    diffuse = getattr(effect, "diffuse", None)
    if diffuse is None:
        return Surface(), ""
    if not hasattr(diffuse, "sampler"):
        return Surface(_colour(diffuse)), ""
    return surface_of(str(diffuse.sampler.surface.image.path), (1.0, 1.0, 1.0), path, find_texture)


def surface_of(name: str, colour: Colour, beside: Path, find_texture: FindTexture) -> tuple[Surface, str]:
    """The surface with a picture by its name, and the name if there is no such file."""
    file = find_texture(name, beside)
    return (Surface(colour, substitute(name)), name) if file is None else (Surface(colour, read_picture(file)), "")


def _trimesh_parts(path: Path, find_texture: FindTexture, budget: Budget) -> Iterator[MeshPart]:
    import trimesh

    missing: list[str] = []
    refused: list[Exception] = []
    beside = Allowance(MOST_BESIDE, 0, 0)

    class Beside(trimesh.resolvers.FilePathResolver):  # type: ignore[misc]  # trimesh is untyped
        """Finds pictures as for any mesh, and keeps in mind what trimesh would only log."""

        def get(self, name: str) -> bytes:
            if refused:
                raise refused[0]
            shown = name.lower().endswith(PICTURES)
            file = find_texture(name, path) if shown else self.absolute(name)
            if file is None:
                missing.append(name)
                raise FileNotFoundError(name)
            try:
                if shown:
                    read_picture(file)
                content = file_bytes(file, MOST_BESIDE)
                beside.take(len(content), f"{name:.80}, with what else it names,")
            except (InputError, ValueError) as error:
                refused.append(error)
                raise
            return content

    scene = trimesh.load_scene(str(path), resolver=Beside(str(path)), process=False)
    if refused:
        raise refused[0]
    for node in scene.graph.nodes_geometry:
        budget.take("parts of meshes", 1, str(path))
        T, name = scene.graph[node]
        mesh = scene.geometry[name]
        faces = getattr(mesh, "faces", None)
        if faces is None or not len(faces):
            continue  # points or lines
        budget.take("triangles", len(faces), str(path))
        corners = (np.asarray(mesh.vertices, float) @ T[:3, :3].T + T[:3, 3])[faces]
        given = getattr(mesh.visual, "uv", None)
        uv = _uv(given, faces) if given is not None else np.zeros((len(faces), 3, 2))
        surface = _trimesh_surface(getattr(mesh.visual, "material", None), path)
        lost = missing[0] if missing and given is not None and surface.picture is None else ""
        surface = surface._replace(picture=substitute(lost)) if lost else surface
        part = MeshPart(corners=corners, uv=uv, surface=surface, name=str(name), missing=lost, node=str(node))
        yield part.unmirrored(T[:3, :3])


def _uv(given: Any, index: Any) -> FloatArray:
    """(T, 3, 2) texture coordinates (N, C) of corners (T, 3); one that the file leaves out is 0."""
    uv, shown = np.zeros((*np.shape(index), 2)), np.asarray(given, float)[index][..., :2]
    uv[..., : shown.shape[-1]] = shown
    return uv


def _trimesh_surface(material: Any, path: Path) -> Surface:
    image = getattr(material, "baseColorTexture", None)
    image = getattr(material, "image", None) if image is None else image
    if image is not None:
        return Surface((1.0, 1.0, 1.0), picture_of(f"{path} {getattr(material, 'name', '')}", image))
    given = getattr(material, "baseColorFactor", None)
    given = getattr(material, "diffuse", None) if given is None else given
    return Surface(_colour(np.asarray(given, float) / 255.0)) if given is not None and len(given) >= 3 else Surface()

"""Mesh files as triangles: DAE by ``dae``; OBJ, STL and glTF here, by trimesh."""

import re
import struct
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from vsx_ros.errors import InputError, explained
from vsx_ros.limits import DAMAGE, MIB, Allowance, file_bytes
from vsx_ros.sim.gazebo import gltf
from vsx_ros.sim.gazebo.budget import MOST_TRIANGLES, Budget
from vsx_ros.sim.gazebo.dae import dae_parts
from vsx_ros.sim.gazebo.mesh_parts import FindTexture, Mesh, MeshPart, colour_of, uv_of
from vsx_ros.sim.gazebo.paths import below
from vsx_ros.sim.gazebo.pictures import no_picture, picture_of, read_picture, substitute
from vsx_ros.sim.gazebo.surfaces import WHITE, Surface

MOST_BYTES = 512 * MIB
MOST_BESIDE = 128 * MIB  # bytes of the files that a mesh names, each time it does
MOST_TAGS = 500_000  # of a DAE file
KINDS = (".dae", ".obj", ".stl", ".gltf", ".glb")
PICTURES = (".png", ".jpg", ".jpeg", ".tga", ".bmp", ".tif", ".tiff", ".webp", ".dds", ".gif")
_MISSING = "vsx missing"  # the key of a mark in a picture
_COUNT = re.compile(rb"<(?:triangles|polylist|polygons|trifans|tristrips)\b[^>]*\bcount=\"(\d+)\"")

_NUMBER = r"\s+[-+.\deE]+(?=\s)"
_OPTIONS = re.compile(rf"(?:-(?:mm|[ost])(?:{_NUMBER}){{1,3}}\s+|-\w+\s+\S+\s+)*")  # before a picture's name in MTL
_FACE = re.compile(rb"^f[ \t]([^\n]*)", re.MULTILINE)


def read_mesh(path: Path, find_texture: FindTexture, budget: Budget) -> Mesh:
    """A mesh file. Its unit is applied; its up axis is ignored, as Gazebo does. Raises InputError for a file that is
    too large, damaged as a whole, or of an unknown kind."""
    if path.suffix.lower() not in KINDS:
        raise InputError(f"mesh {path} is none of {', '.join(KINDS)}; convert it")
    read = dae_parts if path.suffix.lower() == ".dae" else _trimesh_parts
    mesh = Mesh([], [], [])
    with explained(InputError, f"mesh {path} cannot be read", "export it again", (*DAMAGE, *_foreign_errors())):
        announced = _announced(path)
        if announced > MOST_TRIANGLES:
            most = f"at most {MOST_TRIANGLES} can be drawn"
            raise InputError(f"mesh {path} has {announced} triangles, {most}; simplify it")
        mesh.parts.extend(part for part in read(path, find_texture, budget, mesh) if len(part.corners))
    if any(not np.isfinite(part.corners).all() for part in mesh.parts):
        raise InputError(f"mesh {path} has corners that are not finite; export it again")
    for missing in dict.fromkeys(part.missing for part in mesh.parts if part.missing):
        mesh.remarks.append(f"{path.name}: {no_picture(missing)}")
    for lost in dict.fromkeys(mesh.lost):
        mesh.remarks.append(f"{path.name}: {lost} is damaged and left out")
    return mesh


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


class _Beside:
    """What trimesh takes its files from: finds pictures as for any mesh, and keeps in mind what trimesh would only log.
    missing: names of pictures by their marks."""

    def __init__(self, path: Path, find_texture: FindTexture, mesh: Mesh) -> None:
        self.file_name = path.name
        self.missing: dict[str, str] = {}
        self.refused: list[Exception] = []
        self._path, self._find_texture, self._mesh = path, find_texture, mesh
        self._left = Allowance(MOST_BESIDE, 0, 0)

    def __getitem__(self, name: str) -> bytes:
        return self.get(name)

    def get(self, name: str) -> bytes:
        """The content of a file, or a mark in place of a picture that does not exist."""
        if self.refused:
            raise self.refused[0]
        shown = name.lower().endswith(PICTURES)
        name = name[_OPTIONS.match(name).end() :] if shown else name.strip()  # type: ignore[union-attr]
        file = self._find_texture(name, self._path) if shown else below(self._path.parent, name)
        if file is None and shown:
            key = str(len(self.missing))
            self.missing[key] = name
            return _mark(key)
        if file is None:
            self._mesh.remarks.append(f"{self.file_name}: {name:.80} does not exist and is left out")
            raise FileNotFoundError(name)
        try:
            if shown:
                read_picture(file)
            content = file_bytes(file, MOST_BESIDE)
            self._left.take(len(content), f"{name:.80}, with what else it names,")
        except (InputError, ValueError) as error:
            self.refused.append(error)
            raise
        return content


def _trimesh_parts(path: Path, find_texture: FindTexture, budget: Budget, mesh: Mesh) -> Iterator[MeshPart]:
    import trimesh

    beside = _Beside(path, find_texture, mesh)
    scene = trimesh.load_scene(str(path), resolver=beside, process=False)
    if beside.refused:
        raise beside.refused[0]
    for node in scene.graph.nodes_geometry:
        budget.take("parts of meshes", 1, str(path))
        T, name = scene.graph[node]
        found = scene.geometry[name]
        faces = getattr(found, "faces", None)
        if faces is None or not len(faces):
            continue  # points or lines
        budget.take("triangles", len(faces), str(path))
        corners = (np.asarray(found.vertices, float) @ T[:3, :3].T + T[:3, 3])[faces]
        given = getattr(found.visual, "uv", None)
        uv = uv_of(given, faces) if given is not None else np.zeros((len(faces), 3, 2))
        surface, lost = _trimesh_surface(getattr(found.visual, "material", None), path, beside.missing)
        part = MeshPart(corners=corners, uv=uv, surface=surface, name=str(name), missing=lost, node=str(node))
        yield part.unmirrored(T[:3, :3])


def _mark(key: str) -> bytes:
    """A picture in place of one that does not exist: so the materials that use it are known."""
    from PIL import Image, PngImagePlugin

    info, content = PngImagePlugin.PngInfo(), BytesIO()
    info.add_text(_MISSING, key)
    Image.new("L", (1, 1)).save(content, "PNG", pnginfo=info)
    return content.getvalue()


def _trimesh_surface(material: Any, path: Path, missing: dict[str, str]) -> tuple[Surface, str]:
    """The surface, and the name of its picture if that is among the missing, by their marks."""
    image = getattr(material, "baseColorTexture", None)
    image = getattr(material, "image", None) if image is None else image
    lost = missing.get(image.info.get(_MISSING, ""), "") if image is not None else ""
    if image is not None and not lost:
        return Surface(WHITE, picture_of(f"{path} {getattr(material, 'name', '')}", image)), ""
    given = getattr(material, "baseColorFactor", None)
    given = getattr(material, "diffuse", None) if given is None else given
    coloured = given is not None and len(given) >= 3
    surface = Surface(colour_of(np.asarray(given, float) / 255.0)) if coloured else Surface()
    return (surface._replace(picture=substitute(lost)), lost) if lost else (surface, "")

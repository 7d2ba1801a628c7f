"""DAE (COLLADA) files as triangles, by pycollada, which passes over what is damaged: here it is told."""

from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from vsx_ros.sim.gazebo.budget import Budget
from vsx_ros.sim.gazebo.mesh_parts import FindTexture, Mesh, MeshPart, colour_of, surface_of, uv_of
from vsx_ros.sim.gazebo.pictures import substitute
from vsx_ros.sim.gazebo.surfaces import WHITE, Surface

_SHAPELESS = "asset", "extra", "instance_camera", "instance_light", "evaluate_scene"  # in a node or scene


def dae_parts(path: Path, find_texture: FindTexture, budget: Budget, mesh: Mesh) -> Iterator[MeshPart]:
    """The parts of a file; what is damaged in it is told to ``mesh``."""
    document = _document(path, mesh)
    metres = float(document.assetInfo.unitmeter or 1.0)
    surfaces: dict[Any, tuple[Surface, str]] = {}
    for node, geometry in _scene(document, path, budget):
        if geometry is None:
            mesh.lost.append(node)
            continue
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
                uv = uv_of(triangles.texcoordset[0], triangles.texcoord_indexset[0])
            if triangles.material not in surfaces:
                surfaces[triangles.material] = _surface(triangles.material, path, find_texture)
            surface, missing = surfaces[triangles.material]
            name = str(geometry.original.name or geometry.original.id)
            part = MeshPart(corners=corners, uv=uv, surface=surface, name=name, missing=missing, node=node)
            yield part.unmirrored(geometry.matrix[:3, :3])


def _document(path: Path, mesh: Mesh) -> Any:
    """The file as pycollada reads it. A damaged material would take the geometries that it is bound to with it: then
    the file is read again without it."""
    from collada import Collada
    from collada.common import DaeError

    document = Collada(str(path), ignore=[DaeError])
    known = {f"#{material.id}" for material in document.materials}
    damaged = 0
    for parent in document.xmlnode.iter(document.tag("technique_common")):
        for bound in parent.findall(document.tag("instance_material")):
            if bound.get("target") not in known:
                name = str(bound.get("target")).lstrip("#")
                mesh.remarks.append(f"{path.name}: material {name} cannot be read; grey is drawn in its place")
                parent.remove(bound)
                damaged += 1
    if not damaged:
        return document
    content = BytesIO()
    document.xmlnode.write(content)
    return Collada(BytesIO(content.getvalue()), ignore=[DaeError])


def _scene(document: Any, path: Path, budget: Budget) -> Iterator[tuple[str, Any]]:
    """The geometries of the scene and the names of their nodes; and the names of damaged things, with None."""
    scene = document.scene
    if scene is not None:
        yield from _damaged(scene.xmlnode, scene.nodes)
        yield from _instances(scene.nodes, "", None, path, budget)
    elif document.xmlnode.find(f"{document.tag('scene')}/{document.tag('instance_visual_scene')}") is not None:
        yield "scene", None


def _instances(nodes: Any, name: str, matrix: Any, path: Path, budget: Budget) -> Iterator[tuple[str, Any]]:
    """As ``_scene``, below nodes (name: of the nodes' parent); like ``collada.scene.Scene.objects``, but each node
    counts each time it is used."""
    from collada.scene import ControllerNode, Node

    for node in nodes:
        budget.take("parts of meshes", 1, str(path))
        if isinstance(node, Node):
            inner = node.matrix if matrix is None else np.dot(matrix, node.matrix)
            whole = getattr(node, "node", node)
            yield from _damaged(whole.xmlnode, [*whole.transforms, *whole.children])
            yield from _instances(whole.children, whole.name or "", inner, path, budget)
        elif isinstance(node, ControllerNode):  # a skin at rest
            for bound in node.objects("controller", matrix):
                skin = getattr(bound, "geometry", None)
                yield (name, skin) if skin is not None else (f"controller {node.controller.id}", None)
        else:
            yield from ((name, geometry) for geometry in node.objects("geometry", matrix))


def _damaged(element: Any, loaded: list[Any]) -> Iterator[tuple[str, None]]:
    """The names of what pycollada left out of an element, with None: geometries, nodes, and what moves them."""
    kept = {part.xmlnode for part in loaded}
    for child in element:
        tag = str(child.tag).rpartition("}")[2]
        if child not in kept and isinstance(child.tag, str) and tag not in _SHAPELESS:
            own = child.get("url") or child.get("name") or child.get("id")
            called = own.lstrip("#") if own else f"of {element.get('name') or element.get('id', 'its scene')}"
            yield f"{tag.removeprefix('instance_')} {called}", None


def _surface(material: Any, path: Path, find_texture: FindTexture) -> tuple[Surface, str]:
    """Transparency is ignored: most exporters write it wrong, and Gazebo draws such files opaque."""
    effect = getattr(material, "effect", None)
    diffuse: Any = getattr(effect, "diffuse", None)
    if hasattr(diffuse, "sampler"):
        return surface_of(str(diffuse.sampler.surface.image.path), WHITE, path, find_texture)
    texture = None if effect is None else effect.xmlnode.find(".//{*}diffuse/{*}texture")
    if texture is not None:  # of a picture that is not declared
        name = str(texture.get("texture"))
        return Surface(WHITE, substitute(name)), name
    return Surface() if diffuse is None else Surface(colour_of(diffuse)), ""

"""Elements of SDF: numbers, poses, shapes, materials and lamps. An InputError names an element that is wrong."""

import math
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np

from vsx_ros.arrays import FloatArray
from vsx_ros.errors import InputError, explained
from vsx_ros.limits import TEXT_BYTES, file_bytes
from vsx_ros.sim.gazebo import geometry
from vsx_ros.sim.gazebo.geometry import Triangles
from vsx_ros.sim.gazebo.paths import ModelFolders
from vsx_ros.sim.gazebo.pictures import no_picture, read_picture, substitute
from vsx_ros.sim.gazebo.surfaces import GAZEBO, WHITE, Colour, Surface, gazebo_colour, ogre_material

FAR_M = 1e9  # no coordinate is larger
LONGEST = 500  # letters of a name or address: each is told with all that is inside
MOST_MARKS = 700_000  # tags and attributes of a file
_NO_SCRIPT = "__default__"  # the name of a material's script in SDF where there is none

_NAMING = "name", "uri", "albedo_map"  # elements whose text is a name


class MeshUse(NamedTuple):
    """A mesh file in a shape: path, or None if it does not exist; uri; scale (3,); one submesh, or all if empty."""

    path: Path | None
    uri: str
    scale: FloatArray
    submesh: str
    centred: bool


class Lamp(NamedTuple):
    """A light: position [m] and the unit vector it shines along. kind: point, spot or directional. strength: grey value
    of its colour; attenuation: range [m], constant, linear, quadratic; half angle of a spot [rad]."""

    kind: str
    position: FloatArray
    direction: FloatArray
    strength: float
    attenuation: tuple[float, float, float, float]
    half_angle_rad: float


def xml_root(path: Path) -> Element:
    """The root of an XML file. Raises InputError."""
    with explained(InputError, f"{path} cannot be read", "give an SDF file", (OSError, ValueError, SyntaxError)):
        content = file_bytes(path, TEXT_BYTES)
        if b"<!ENTITY" in content:
            raise ValueError("it defines entities")
        if content.count(b"<") + content.count(b"=") > MOST_MARKS:
            raise ValueError(f"it has more than {MOST_MARKS} tags and attributes")
        root = ElementTree.fromstring(content)
        for element in root.iter():
            said = *element.attrib.values(), element.text or "" if element.tag in _NAMING else ""
            if max(map(len, said)) > LONGEST:
                raise ValueError(f"a <{element.tag:.40}> has more than {LONGEST} letters")
        return root


def text(element: Element | None, tag: str, default: str = "") -> str:
    """The text of a child, or the default."""
    found = element.findtext(tag) if element is not None else None
    return found.strip() if found is not None and found.strip() else default


def numbers(element: Element | None, tag: str, default: tuple[float, ...], where: str) -> tuple[float, ...]:
    """The numbers of a child. Raises InputError unless they are finite and as many as the default's."""
    words = text(element, tag).split()
    if not words:
        return default
    try:
        values = tuple(float(word) for word in words[: len(default)])
    except ValueError:
        values = ()
    if len(values) != len(default) or not all(abs(value) < FAR_M for value in values):
        raise InputError(f"{where}: <{tag}> is {' '.join(words)[:80]!r}; write {len(default)} numbers")
    return values


def pose(element: Element, where: str) -> FloatArray:
    """(4, 4) of the child <pose>; identity without one. Raises InputError."""
    child = element.find("pose")
    if child is None or not (child.text or "").strip():
        return np.eye(4)
    if child.get("rotation_format") == "quat_xyzw":
        return geometry.quaternion_matrix(*numbers(element, "pose", (0.0,) * 6 + (1.0,), where))
    x, y, z, *angles = numbers(element, "pose", (0.0,) * 6, where)
    if child.get("degrees", "false").lower() in ("true", "1"):
        angles = [math.radians(angle) for angle in angles]
    return geometry.pose_matrix(x, y, z, *angles)


def shape(element: Element, folder: Path, find: ModelFolders, where: str) -> MeshUse | Triangles | None:
    """What the child <geometry> holds, or None if it is unsupported or absent. Raises InputError."""
    holder = element.find("geometry")
    for child in holder if holder is not None else ():
        match child.tag:
            case "mesh":
                uri, part = text(child, "uri"), child.find("submesh")
                scale = np.array(numbers(child, "scale", (1.0,) * 3, where))
                centred = text(part, "center", "false").lower() in ("true", "1")
                file = find.find(uri, folder)
                path = file if file is not None and file.is_file() else None
                return MeshUse(path=path, uri=uri, scale=scale, submesh=text(part, "name"), centred=centred)
            case "box":
                return geometry.box(*numbers(child, "size", (1.0,) * 3, where))
            case "cylinder":
                return geometry.cylinder(*_sizes(child, ("radius", "length"), where))
            case "sphere":
                return geometry.sphere(*_sizes(child, ("radius",), where))
            case "plane":
                normal = np.array(numbers(child, "normal", (0.0, 0.0, 1.0), where))
                side = geometry.PLANE_MOST_M if element.tag == "collision" else 1.0  # in physics it has no end
                return geometry.plane(normal, *numbers(child, "size", (side, side), where))
    return None


def _sizes(element: Element, tags: tuple[str, ...], where: str) -> list[float]:
    return [numbers(element, tag, (1.0,), where)[0] for tag in tags]


def kind_of_shape(element: Element) -> str:
    """The name of the shape, for a report of what is unsupported."""
    holder = element.find("geometry")
    return "nothing" if holder is None or not len(holder) else str(holder[0].tag)


def surface(element: Element, folder: Path, find: ModelFolders, where: str) -> tuple[Surface | None, str]:
    """What the child <material> says, or None if it says nothing; and what does not exist of it, in words."""
    material = element.find("material")
    if material is None:
        return None, ""
    script, albedo = material.find("script"), material.findtext(".//albedo_map")
    if albedo:
        file = find.find(albedo, folder) or find.find_texture(albedo, folder / "meshes" / "x")
        if file is None or not file.is_file():
            return Surface(WHITE, substitute(albedo)), no_picture(albedo)
        return Surface(WHITE, read_picture(file)), ""
    name, missing = text(script, "name", _NO_SCRIPT), ""
    if script is not None and name != _NO_SCRIPT:
        for uri in script.findall("uri"):
            place = find.find((uri.text or "").strip(), folder)
            found = ogre_material(place, name, find.find_texture) if place is not None else None
            if found is not None:
                return _ogre_surface(*found)
        if not name.startswith(GAZEBO):
            missing = f"material {name} is in none of its scripts and left out"
        elif material.find("diffuse") is None and material.find("ambient") is None:
            return Surface(gazebo_colour(name)), ""
    for tag in ("diffuse", "ambient"):
        if text(material, tag):
            return Surface(_colour(numbers(material, tag, (0.0,) * 3, where))), missing
    return None, missing


def _colour(values: tuple[float, ...]) -> Colour:
    r, g, b = (min(max(value, 0.0), 1.0) for value in values)
    return r, g, b


def _ogre_surface(colour: Colour, file: Path | None, name: str) -> tuple[Surface, str]:
    if file is not None:
        return Surface(WHITE, read_picture(file)), ""
    return (Surface(colour, substitute(name)), no_picture(name)) if name else (Surface(colour), "")


def lamp(element: Element, T_world: FloatArray, where: str) -> Lamp:
    """A <light> at a pose (4, 4). Raises InputError."""
    fades = element.find("attenuation")
    default = 10.0, 1.0, 1.0, 0.0
    terms = [
        numbers(fades, tag, (value,), where)[0]
        for tag, value in zip(("range", "constant", "linear", "quadratic"), default)
    ]
    down = np.array(numbers(element, "direction", (0.0, 0.0, -1.0), where))
    direction = T_world[:3, :3] @ down
    r, g, b = numbers(element, "diffuse", (1.0, 1.0, 1.0), where)
    intensity = numbers(element, "intensity", (1.0,), where)[0]
    outer = numbers(element.find("spot"), "outer_angle", (math.pi,), where)[0]
    return Lamp(
        kind=element.get("type", "point"),
        position=T_world[:3, 3],
        direction=direction / max(float(np.linalg.norm(direction)), 1e-9),
        strength=(0.299 * r + 0.587 * g + 0.114 * b) * intensity,
        attenuation=(terms[0], terms[1], terms[2], terms[3]),
        half_angle_rad=0.5 * outer,
    )

"""An SDF world file with all that it includes, as a flat list of placed shapes and lamps."""

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple
from xml.etree.ElementTree import Element

import numpy as np

from vsx_ros.arrays import FloatArray
from vsx_ros.errors import InputError
from vsx_ros.sim.gazebo import elements, geometry
from vsx_ros.sim.gazebo.budget import Budget
from vsx_ros.sim.gazebo.elements import Lamp, MeshUse, numbers, text
from vsx_ros.sim.gazebo.geometry import Triangles
from vsx_ros.sim.gazebo.paths import ModelFolders, is_remote
from vsx_ros.sim.gazebo.surfaces import Surface

DEEPEST = 16  # models in models
_SUN = Lamp(
    kind="directional",
    position=np.array([0.0, 0.0, 10.0]),
    direction=np.array([-0.46, 0.09, -0.88]),
    strength=0.8,
    attenuation=(1e3, 0.9, 0.01, 0.0),
    half_angle_rad=3.2,
)
_UNSUPPORTED = "actor", "population", "road"


class Shape(NamedTuple):
    """A visual, or a solid (collision). link: the model and link it belongs to. T_world: (4, 4). surface: in place of
    its mesh's own, or None. missing: name of a picture that does not exist, or empty."""

    name: str
    link: str
    T_world: FloatArray
    solid: bool
    geometry: MeshUse | Triangles
    surface: Surface | None
    missing: str


class Layout(NamedTuple):
    """ambient, sky: grey values of the ambient light and the background. remarks: what is missing or unsupported."""

    shapes: list[Shape]
    lamps: list[Lamp]
    ambient: float
    sky: float
    remarks: list[str]


def read_layout(path: Path, folders: ModelFolders, budget: Budget) -> Layout:
    """Everything that is placed in a world file, or a model file. Raises InputError if it is no SDF, or holds more than
    the budget has."""
    root = elements.xml_root(path)
    if root.tag not in ("sdf", "gazebo"):
        raise InputError(f"{path} is no SDF: its root is <{root.tag}>, not <sdf>; give a Gazebo .world or .sdf file")
    return _Reader(folders, budget).read(root, path)


class _Reader:
    def __init__(self, folders: ModelFolders, budget: Budget) -> None:
        self._folders, self._budget = folders, budget
        self._files: dict[tuple[str, Path], Path | None] = {}
        self._models: dict[Path, tuple[Element | None, int]] = {}
        self._layout = Layout(shapes=[], lamps=[], ambient=0.4, sky=0.7, remarks=[])

    def read(self, root: Element, path: Path) -> Layout:
        self._budget.take("elements", sum(1 for _ in root.iter()), str(path))
        world = root.find("world")
        world = root if world is None else world
        moved = {model.get("name", ""): model for model in world.findall("state/model")}
        for child in world:
            name = self._name(child, path.parent)
            T = elements.pose(moved[name], f"state of {name}") if name in moved and child.tag != "light" else None
            self._part(child, np.eye(4), "", path.parent, 0, T)
        where = f"{path}: <scene>"
        r, g, b = numbers(world.find("scene"), "ambient", (0.4, 0.4, 0.4), where)
        sky = numbers(world.find("scene"), "background", (0.7, 0.7, 0.7), where)
        remarks = list(dict.fromkeys(self._layout.remarks))
        return self._layout._replace(ambient=(r + g + b) / 3.0, sky=sum(sky) / 3.0, remarks=remarks)

    def _part(
        self, element: Element, T_parent: FloatArray, prefix: str, folder: Path, depth: int, T: FloatArray | None
    ) -> None:
        """A child of a world or model. T: its pose in place of the file's, or None."""
        match element.tag:
            case "include":
                self._include(element, T_parent, prefix, folder, depth, T)
            case "model":
                name = prefix + element.get("name", "unnamed")
                T_model = self._pose(element, f"model {name}", "__model__" if depth else "world") if T is None else T
                self._model(element, T_parent @ T_model, name, folder, depth)
            case "light":
                where = f"light {element.get('name', '')}"
                self._lamp(element, T_parent @ elements.pose(element, where), where)
            case tag if tag in _UNSUPPORTED:
                self._remark(f"<{tag}> {prefix}{element.get('name', '')} is not supported and left out")

    def _lamp(self, light: Element, T_world: FloatArray, where: str) -> None:
        self._budget.take("lamps", 1, where)
        if text(light, "light_on", "true").lower() not in ("false", "0"):
            self._layout.lamps.append(elements.lamp(light, T_world, where))

    def _pose(self, element: Element, where: str, parent: str) -> FloatArray:
        """As ``elements.pose``. A frame that is not the parent's, which moves the element in Gazebo, is told."""
        placed = element.get("placement_frame") or text(element, "placement_frame")
        pose = element.find("pose")
        frame = "" if pose is None else pose.get("relative_to") or pose.get("frame") or ""
        for named in [name for name, usual in ((placed, "__model__"), (frame, parent)) if name not in ("", usual)]:
            self._remark(f"{where}: frame {named} is not supported; its pose is taken from its parent")
        return elements.pose(element, where)

    def _remark(self, words: str) -> None:
        self._layout.remarks.append(words)

    def _include(
        self, element: Element, T_parent: FloatArray, prefix: str, folder: Path, depth: int, T: FloatArray | None
    ) -> None:
        uri = text(element, "uri")
        name = prefix + self._name(element, folder)
        where, parent = f"include of {name}", "__model__" if depth else "world"
        file = self._file(uri, folder)
        if file is None:
            own = self._pose(element, where, parent) if T is None else T
            self._built_in(uri, name, T_parent @ own)
            return
        model, size = self._first_model(file)
        self._budget.take("elements", size, name)
        if model is None:
            self._remark(f"model {name}: {file} holds none and is left out")
            return
        posed = element if element.find("pose") is not None else model
        own = self._pose(posed, where, parent) if T is None else T
        if model.tag == "light":
            self._lamp(model, T_parent @ own, where)
            return
        self._model(model, T_parent @ own, name, file.parent, depth)

    def _file(self, uri: str, folder: Path) -> Path | None:
        if (uri, folder) not in self._files:
            found = self._folders.find(uri, folder)
            self._files[uri, folder] = _model_file(found) if found is not None else None
        return self._files[uri, folder]

    def _first_model(self, file: Path) -> tuple[Element | None, int]:
        """The model or light of a file, read once, and how many elements the file has."""
        if file not in self._models:
            root = elements.xml_root(file)
            model = next((child for child in root if child.tag in ("model", "light")), None)
            self._models[file] = model, sum(1 for _ in root.iter())
        return self._models[file]

    def _name(self, element: Element, folder: Path) -> str:
        """Of an include without a <name>, that of the model in its file, else the last word of its address."""
        given = element.get("name") or text(element, "name")
        if given or element.tag != "include":
            return given
        uri = text(element, "uri")
        file = self._file(uri, folder)
        model = self._first_model(file)[0] if file is not None else None
        own = model.get("name") if model is not None else None
        return own or uri.rstrip("/").rpartition("/")[2]

    def _built_in(self, uri: str, name: str, T_world: FloatArray) -> None:
        word = uri.rstrip("/").rpartition("/")[2]
        if word == "sun":
            self._budget.take("lamps", 1, name)
            self._layout.lamps.append(_SUN)
        elif word == "ground_plane":
            floor = geometry.plane(np.array([0.0, 0.0, 1.0]), 100.0, 100.0)
            for solid in (False, True):
                paint = Surface((0.6, 0.6, 0.6))
                self._add(
                    Shape(name=name, link=name, T_world=T_world, solid=solid, geometry=floor, surface=paint, missing="")
                )
        elif is_remote(uri):
            self._remark(f"model {name} is on the network ({uri}): download it, and give its folder with --models")
        else:
            looked = ", ".join(str(folder) for folder in self._folders.folders) or "no folder"
            self._remark(f"model {name} ({uri}) is in none of {looked}: give its folder with --models")

    def _model(self, model: Element, T_world: FloatArray, name: str, folder: Path, depth: int) -> None:
        if depth > DEEPEST:
            raise InputError(f"model {name:.200} is nested more than {DEEPEST} deep; take it apart")
        if len(name) > elements.LONGEST:
            raise InputError(f"model {name:.200}... has a name of {len(name)} letters; rename its models")
        for child in model:
            if child.tag == "link":
                self._link(child, T_world, name, folder)
            else:
                self._part(child, T_world, f"{name}/", folder, depth + 1, None)

    def _link(self, link: Element, T_model: FloatArray, model: str, folder: Path) -> None:
        name = f"{model}/{link.get('name', 'link')}"
        T_link = T_model @ self._pose(link, name, "__model__")
        for child in link:
            if child.tag == "light":
                self._lamp(child, T_link @ elements.pose(child, name), name)
            if child.tag not in ("visual", "collision"):
                continue
            where = f"{child.tag} {name}/{child.get('name', '')}"
            found = elements.shape(child, folder, self._folders, where)
            if found is None:
                kind = elements.kind_of_shape(child)
                self._remark(f"{where} is a <{kind}>, which is not supported, and left out")
                continue
            solid = child.tag == "collision"
            surface, missing = (None, "") if solid else elements.surface(child, folder, self._folders, where)
            self._add(
                Shape(
                    name=where,
                    link=name,
                    T_world=T_link @ self._pose(child, where, link.get("name", "")),
                    solid=solid,
                    geometry=found,
                    surface=surface,
                    missing=missing,
                )
            )

    def _add(self, shape: Shape) -> None:
        self._budget.take("shapes", 1, shape.name)
        if not isinstance(shape.geometry, MeshUse):
            self._budget.take("triangles", len(shape.geometry.corners), shape.name)
        self._layout.shapes.append(shape)


def _model_file(found: Path) -> Path | None:
    """The SDF file of a model's folder: what model.config names, else model.sdf."""
    if found.is_file():
        return found
    named: list[str] = []
    if (found / "model.config").is_file():
        named = list(_named(found / "model.config"))
    for name in [*reversed(named), "model.sdf"]:
        if (found / name).is_file():
            return found / name
    return next(iter(sorted(found.glob("*.sdf"))), None)


def _named(config: Path) -> Iterator[str]:
    """The files that model.config names, the oldest version first."""
    sdf = elements.xml_root(config).findall("sdf")
    for element in sorted(
        sdf, key=lambda e: [int(n) if n.isdecimal() else 0 for n in e.get("version", "0").split(".")]
    ):
        yield (element.text or "").strip() or "model.sdf"

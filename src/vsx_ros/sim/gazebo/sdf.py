"""An SDF world file with all that it includes, as a flat list of placed shapes and lamps."""

from pathlib import Path
from typing import NamedTuple
from xml.etree.ElementTree import Element

import numpy as np

from vsx_ros.arrays import FloatArray
from vsx_ros.errors import InputError
from vsx_ros.sim.gazebo import elements, geometry
from vsx_ros.sim.gazebo.budget import Budget
from vsx_ros.sim.gazebo.elements import Lamp, MeshUse, numbers, text
from vsx_ros.sim.gazebo.frames import Scope
from vsx_ros.sim.gazebo.geometry import Triangles
from vsx_ros.sim.gazebo.models import ModelFiles
from vsx_ros.sim.gazebo.paths import ModelFolders, is_remote
from vsx_ros.sim.gazebo.states import Saved
from vsx_ros.sim.gazebo.surfaces import Surface

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
    """A visual, or a solid (collision). link: the model and link it belongs to. T_world: (4, 4). geometry: None for a
    visual of a kind that cannot be drawn. surface: in place of its mesh's own, or None. missing: what does not exist
    of its material, in words, or empty."""

    name: str
    link: str
    T_world: FloatArray
    solid: bool
    geometry: MeshUse | Triangles | None
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


class _Around(NamedTuple):
    """What a part lies in: a world or model at T_world (4, 4). prefix: of the names of its parts."""

    scope: Scope
    T_world: FloatArray
    prefix: str
    saved: Saved


class _Reader:
    def __init__(self, folders: ModelFolders, budget: Budget) -> None:
        self._folders, self._budget = folders, budget
        self._files = ModelFiles(folders, budget)
        self._layout = Layout(shapes=[], lamps=[], ambient=0.4, sky=0.7, remarks=[])

    def read(self, root: Element, path: Path) -> Layout:
        self._budget.take("elements", sum(1 for _ in root.iter()), str(path))
        world = root.find("world")
        world = root if world is None else world
        saved = Saved(world.findall("state"))
        for tag in filter(saved.holds, ("insertions", "deletions")):
            self._remark(f"<{tag}> of <state> is not supported and left out")
        around = _Around(Scope(world, path.parent, 0, self._files, self._remark), np.eye(4), "", saved)
        for child in world:
            self._part(child, around)
        where = f"{path}: <scene>"
        r, g, b = numbers(world.find("scene"), "ambient", (0.4, 0.4, 0.4), where)
        sky = numbers(world.find("scene"), "background", (0.7, 0.7, 0.7), where)
        remarks = list(dict.fromkeys(self._layout.remarks))
        return self._layout._replace(ambient=(r + g + b) / 3.0, sky=sum(sky) / 3.0, remarks=remarks)

    def _part(self, element: Element, around: _Around) -> None:
        """A child of a world or model."""
        match element.tag:
            case "include":
                self._include(element, around)
            case "model":
                name = element.get("name", "unnamed")
                self._model(element, element, around, name, around.scope.folder)
            case "light":
                name = element.get("name", "")
                self._lamp(element, self._placed(element, around, "light", name), f"light {name}")
            case tag if tag in _UNSUPPORTED:
                self._remark(f"<{tag}> {around.prefix}{element.get('name', '')} is not supported and left out")

    def _placed(self, element: Element, around: _Around, tag: str, name: str) -> FloatArray:
        """T_world of a part: as its state says, else as its pose does."""
        where = f"{'include of' if element.tag == 'include' else tag} {around.prefix}{name}"
        saved = around.saved.part(tag, name).pose(where)
        return around.T_world @ around.scope.place(element, where) if saved is None else saved

    def _lamp(self, light: Element, T_world: FloatArray, where: str) -> None:
        self._budget.take("lamps", 1, where)
        if text(light, "light_on", "true").lower() not in ("false", "0"):
            self._layout.lamps.append(elements.lamp(light, T_world, where))

    def _remark(self, words: str) -> None:
        self._layout.remarks.append(words)

    def _include(self, element: Element, around: _Around) -> None:
        own = self._files.name(element, around.scope.folder)
        name = around.prefix + own
        found = self._files.take(element, around.scope.folder, name)
        if found is None:
            self._built_in(text(element, "uri"), name, element, around)
        elif found.element is None:
            self._remark(f"model {name}: {found.file} holds none and is left out")
        elif found.element.tag == "light":
            self._lamp(found.element, self._placed(element, around, "light", own), f"include of {name}")
        else:
            self._model(found.element, element, around, own, found.file.parent)

    def _built_in(self, uri: str, name: str, element: Element, around: _Around) -> None:
        word = uri.rstrip("/").rpartition("/")[2]
        if word == "sun":
            self._budget.take("lamps", 1, name)
            self._layout.lamps.append(_SUN)
        elif word == "ground_plane":
            T_world = self._placed(element, around, "model", self._files.name(element, around.scope.folder))
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

    def _model(self, model: Element, posed: Element, around: _Around, own: str, folder: Path) -> None:
        """posed: the model, or the include that it comes from. own: its name without prefix. folder: of its file."""
        name = around.prefix + own
        if len(name) > elements.LONGEST:
            raise InputError(f"model {name:.200}... has a name of {len(name)} letters; rename its models")
        scope = around.scope.inner(model, folder)
        saved = around.saved.part("model", own)
        inside = _Around(scope, self._placed(posed, around, "model", own), f"{name}/", saved)
        scale = saved.scale(name)
        if scale.min() <= 0.0:
            self._remark(f"state of {name}: its <scale> is not positive and ignored")
            scale = np.ones(3)
        for child in model:
            if child.tag == "link":
                self._link(child, inside, scale)
            else:
                self._part(child, inside)

    def _link(self, link: Element, model: _Around, scale: FloatArray) -> None:
        """scale: (3,) of each shape in its own axes."""
        own = link.get("name", "link")
        name = model.prefix + own
        T_model_link = model.scope.place(link, name)
        T_saved = model.saved.part("link", own).pose(name)  # moves all that the link holds, whatever frame it names
        T_world_model = model.T_world if T_saved is None else T_saved @ geometry.inverse(T_model_link)
        for child in link:
            if child.tag not in ("visual", "collision", "light"):
                continue
            where = name if child.tag == "light" else f"{child.tag} {name}/{child.get('name', '')}"
            T_world = T_world_model @ model.scope.place(child, where, T_model_link)
            if child.tag == "light":
                self._lamp(child, T_world, name)
            else:
                self._shape(child, name, model.scope.folder, T_world, scale)

    def _shape(self, element: Element, link: str, folder: Path, T_world: FloatArray, scale: FloatArray) -> None:
        solid, where = element.tag == "collision", f"{element.tag} {link}/{element.get('name', '')}"
        found = elements.shape(element, folder, self._folders, where)
        if found is None:
            kind = elements.kind_of_shape(element)
            self._remark(f"{where} is a <{kind}>, which is not supported, and left out")
            if solid or kind in ("nothing", "empty"):
                return
        clear = 0.0 if solid else numbers(element, "transparency", (0.0,), where)[0]
        if clear >= 1.0:
            return
        if clear > 0.0:
            self._remark(f"{where} has transparency {clear:g} and is drawn opaque")
        surface, missing = (None, "") if solid else elements.surface(element, folder, self._folders, where)
        self._add(
            Shape(
                name=where,
                link=link,
                T_world=T_world,
                solid=solid,
                geometry=_scaled(found, scale),
                surface=surface,
                missing=missing,
            )
        )

    def _add(self, shape: Shape) -> None:
        self._budget.take("shapes", 1, shape.name)
        if isinstance(shape.geometry, Triangles):
            self._budget.take("triangles", len(shape.geometry.corners), shape.name)
        self._layout.shapes.append(shape)


def _scaled(found: MeshUse | Triangles | None, scale: FloatArray) -> MeshUse | Triangles | None:
    if found is None:
        return None
    if isinstance(found, MeshUse):
        return found._replace(scale=found.scale * scale)
    return found._replace(corners=found.corners * scale)

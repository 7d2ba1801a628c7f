"""The models that a world includes: which file holds one, and its first model or light."""

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple
from xml.etree.ElementTree import Element

from vsx_ros.sim.gazebo import elements
from vsx_ros.sim.gazebo.budget import Budget
from vsx_ros.sim.gazebo.elements import text
from vsx_ros.sim.gazebo.paths import ModelFolders


class Included(NamedTuple):
    """element: the first <model> or <light> of a file, or None. size: how many elements the file has."""

    element: Element | None
    file: Path
    size: int


class ModelFiles:
    """The models that <include> names; each file is read once."""

    def __init__(self, folders: ModelFolders, budget: Budget) -> None:
        self.folders, self._budget = folders, budget
        self._files: dict[tuple[str, Path], Path | None] = {}
        self._read: dict[Path, Included] = {}

    def take(self, include: Element, folder: Path, name: str) -> Included | None:
        """What an include in a file of this folder names, or None without such a file. Raises InputError for a damaged
        file, or for more elements than the budget has."""
        found = self._find(include, folder)
        if found is not None:
            self._budget.take("elements", found.size, name)
        return found

    def model(self, element: Element, folder: Path) -> Element:
        """Of an include, the model in its file; else, and without a file, the element itself."""
        found = self._find(element, folder) if element.tag == "include" else None
        return element if found is None or found.element is None else found.element

    def name(self, element: Element, folder: Path) -> str:
        """Of an include without a <name>, that of the model in its file, else the last word of its address."""
        given = element.get("name") or text(element, "name")
        if given or element.tag != "include":
            return given
        return self.model(element, folder).get("name") or text(element, "uri").rstrip("/").rpartition("/")[2]

    def _find(self, include: Element, folder: Path) -> Included | None:
        key = text(include, "uri"), folder
        if key not in self._files:
            found = self.folders.find(*key)
            self._files[key] = _model_file(found) if found is not None else None
        file = self._files[key]
        if file is not None and file not in self._read:
            root = elements.xml_root(file)
            model = next((child for child in root if child.tag in ("model", "light")), None)
            self._read[file] = Included(model, file, sum(1 for _ in root.iter()))
        return self._read[file] if file is not None else None


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

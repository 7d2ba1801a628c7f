"""Frames of SDF: where the parts of a world or model are whose poses name each other. As SDFormat 1.12."""

from collections.abc import Callable
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from vsx_ros.arrays import FloatArray
from vsx_ros.errors import InputError
from vsx_ros.sim.gazebo import elements
from vsx_ros.sim.gazebo.elements import text
from vsx_ros.sim.gazebo.geometry import inverse
from vsx_ros.sim.gazebo.models import ModelFiles

DEEPEST = 16  # models in models
_NAMED = "link", "joint", "frame", "model", "include"


class _NoFrameError(Exception):
    """Its words say which frame cannot be found, and why."""


class Scope:
    """The frames inside a world (depth 0) or a model, by name; poses (4, 4) are in the scope's own frame. folder: of
    its file. tell: takes a remark. Raises InputError for models that are nested too deep."""

    def __init__(
        self, element: Element, folder: Path, depth: int, files: ModelFiles, tell: Callable[[str], None]
    ) -> None:
        if depth - 1 > DEEPEST:
            name = element.get("name", "unnamed")
            raise InputError(f"model {name:.200} is nested more than {DEEPEST} deep; take it apart")
        self.element, self.folder, self.depth = element, folder, depth
        self._files, self._tell = files, tell
        self._known = {name: np.eye(4) for name in ("", "__model__" if depth else "world", "__root__")}
        self._lost: dict[str, str] = {}  # names of frames that cannot be found, and why
        self._named: dict[str, Element] | None = None
        self._scopes: dict[str, Scope] = {}

    def inner(self, model: Element, folder: Path) -> "Scope":
        """The scope of a model in this one, from a file in a folder."""
        return Scope(model, folder, self.depth + 1, self._files, self._tell)

    def place(self, element: Element, where: str, T_parent: FloatArray | None = None) -> FloatArray:
        """The pose of a part of this scope, or of a part of its link at T_parent. Frames that cannot be found are
        told; its pose is taken from its parent then."""
        parent = np.eye(4) if T_parent is None else T_parent
        holder = self._posed(element)
        own, frame = elements.pose(holder, where), _relative_to(holder)
        try:
            if holder is not element and frame not in ("", "world", "__root__"):
                raise _NoFrameError(f"frame {frame} is named in another file")
            base = parent if holder is not element or not frame else self._frame(frame)
            return base @ own @ self._placement(element)
        except _NoFrameError as error:
            self._tell(f"{where}: {error}; its pose is taken from its parent")
            return np.asarray(parent @ own)

    def _posed(self, element: Element) -> Element:
        """The element whose <pose> counts: for an include without one, the model in its file."""
        return element if element.find("pose") is not None else self._files.model(element, self.folder)

    def _frame(self, name: str) -> FloatArray:
        chain: dict[str, FloatArray] = {}
        try:
            while name not in self._known:
                if name in self._lost or name in chain:
                    raise _NoFrameError(self._lost.get(name, f"frame {name:.80} is given relative to itself"))
                chain[name], name = self._step(name)
        except _NoFrameError as error:
            self._lost.update(dict.fromkeys([*chain, name], str(error)))
            raise
        T = self._known[name]
        for at, step in reversed(chain.items()):
            T = self._known[at] = T @ step
        return T

    def _step(self, name: str) -> tuple[FloatArray, str]:
        """The pose of a frame in another one, and the name of that one."""
        element = self._children().get(name)
        if element is None:
            return self._step_inside(name)
        holder = self._posed(element)
        own = elements.pose(holder, f"{element.tag} {name:.80}") @ self._placement(element)
        given = _relative_to(element) or (text(element, "child") if element.tag == "joint" else "")
        return own, given or element.get("attached_to", "")

    def _step_inside(self, name: str) -> tuple[FloatArray, str]:
        """Of a frame ``model::frame``, or of a model that is merged into this one."""
        outer, colons, rest = name.partition("::")
        if colons and outer in self._children():
            return self._scope(outer)._frame(rest), outer
        for merged, element in self._children().items():
            if element.get("merge", "false").lower() in ("true", "1") and outer in self._scope(merged)._children():
                return self._scope(merged)._frame(name), merged
        what = f"the model {self.element.get('name', '')}" if self.depth else "the world"
        raise _NoFrameError(f"there is no frame {name:.80} in {what:.80}")

    def _children(self) -> dict[str, Element]:
        if self._named is None:
            parts = [child for child in self.element if child.tag in _NAMED]
            self._named = {self._files.name(child, self.folder): child for child in reversed(parts)}
        return self._named

    def _scope(self, name: str) -> "Scope":
        if name not in self._scopes:
            self._scopes[name] = self._opened(self._children()[name], name)
        return self._scopes[name]

    def _opened(self, element: Element, frame: str) -> "Scope":
        """The scope of a model in which a frame is looked for."""
        if element.tag == "model":
            return self.inner(element, self.folder)
        found = self._files.take(element, self.folder, frame) if element.tag == "include" else None
        if found is None or found.element is None:
            raise _NoFrameError(f"there is no frame {frame:.80}: no model is there")
        return self.inner(found.element, found.file.parent)

    def _placement(self, element: Element) -> FloatArray:
        """The model's frame as its placement frame, which its pose is for, sees it."""
        frame = text(element, "placement_frame") or element.get("placement_frame", "")
        if not frame and element.tag == "include":
            frame = self._files.model(element, self.folder).get("placement_frame", "")
        if frame in ("", "__model__"):
            return np.eye(4)
        return inverse(self._opened(element, frame)._frame(frame))


def _relative_to(element: Element) -> str:
    """What the pose is relative to; ``frame`` is the older word for it."""
    pose = element.find("pose")
    return "" if pose is None else pose.get("relative_to") or pose.get("frame") or ""

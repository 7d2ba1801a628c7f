"""What <state> of a saved world says: where its models, links and lamps are, and how large."""

from collections.abc import Sequence
from xml.etree.ElementTree import Element

import numpy as np

from vsx_ros.arrays import FloatArray
from vsx_ros.sim.gazebo import elements


class Saved:
    """The states of a world or model (elements), or of none."""

    def __init__(self, states: Sequence[Element] = ()) -> None:
        self._states = states
        self._parts: dict[tuple[str, str], list[Element]] = {}
        for child in (child for state in states for child in state):
            self._parts.setdefault((child.tag, child.get("name", "")), []).append(child)

    def part(self, tag: str, name: str) -> "Saved":
        """The state of a model, link or light in it."""
        found = self._parts.get((tag, name))
        return Saved(found) if found else NOTHING

    def holds(self, tag: str) -> bool:
        """Whether it has such a list that is not empty."""
        return any(len(part) for part in self._parts.get((tag, ""), ()))

    def pose(self, where: str) -> FloatArray | None:
        """(4, 4) in the world, also of a link, as Gazebo saves it; None if nothing is saved. Raises InputError."""
        posed = [state for state in self._states if state.find("pose") is not None]
        return elements.pose(posed[-1], f"state of {where}") if posed else None

    def scale(self, where: str) -> FloatArray:
        """(3,) of each shape of a model, in the shape's axes. Raises InputError."""
        state = self._states[-1] if self._states else None
        return np.array(elements.numbers(state, "scale", (1.0,) * 3, f"state of {where}"))


NOTHING = Saved()

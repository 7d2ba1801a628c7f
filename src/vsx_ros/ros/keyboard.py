"""The keys of teleop: what each asks for, and how a terminal sends them."""

from __future__ import annotations

import re

KEYS = "arrows or w a s d: drive   space: stop   + -: speed   q: quit"
MOTIONS = {
    "w": (1.0, 0.0),
    "s": (-1.0, 0.0),
    "a": (0.0, 1.0),
    "d": (0.0, -1.0),
    "\x1b[A": (1.0, 0.0),
    "\x1b[B": (-1.0, 0.0),
    "\x1b[D": (0.0, 1.0),
    "\x1b[C": (0.0, -1.0),
}
"""Forward and left, of -1, 0 and 1."""
_ARROW = re.compile(r"\x1b[\[O]([A-D])|.", re.DOTALL)


def keys(text: str) -> list[str]:
    """The keys of what a terminal sent; arrows are three characters, in either of a terminal's two modes."""
    return [f"\x1b[{match[1]}" if match[1] else match[0] for match in _ARROW.finditer(text)]

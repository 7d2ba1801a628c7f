"""What a check of ``vsx doctor`` found, how bad it is, and what to do about it."""

from typing import NamedTuple

OK, NOTE, WARN, FAIL = "ok", "note", "warn", "fail"
"""Fine; nothing wrong but worth knowing; works, though worse than it could; does not work."""


class Finding(NamedTuple):
    """One line of the doctor. remedy: what to type or to do; empty where nothing is to be done."""

    area: str
    level: str
    text: str
    remedy: str = ""


def from_error(area: str, level: str, error: Exception) -> Finding:
    """The finding of an error whose sentence says what is wrong and, behind a semicolon, what to do."""
    text, _, remedy = str(error).partition("; ")
    return Finding(area, level, text, remedy)

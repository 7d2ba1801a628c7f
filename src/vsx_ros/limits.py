"""Limits on what a file may request: the declared size is compared with a limit before memory is allocated.

Every refusal is a ValueError whose text fits into the sentence of the reading function. The limits are far above the
sizes of this stack's own files and of a building's recordings. What may be unpacked grows with the file."""

import json
import os
import stat
import struct
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import yaml

from vsx_ros.errors import reason_of

MIB = 2**20  # bytes
TEXT_BYTES = 16 * MIB  # Parameters, worlds, calibrations: a building's world has a quarter of a MiB
LOG_BYTES = 1024 * MIB  # Files that grow with a run: trajectories, journals, lists of images
DATA_BYTES = 8192 * MIB  # Maps and point clouds
FAR_M = 1e4  # larger than any building: no place is farther away
YAML_DEPTH, YAML_NODES = 64, 300_000  # several times those of the largest file here
YAML_TEXT, YAML_NUMBER = MIB, 8192
"""Most characters of a value in quotes, and of one without. The latter may be a number (1:59:59 takes quadratic time)
and gets a lower limit."""

DAMAGE = (
    ArithmeticError, AssertionError, AttributeError, EOFError, LookupError, MemoryError, OSError, RuntimeError,
    SyntaxError, TypeError, ValueError, struct.error, zlib.error,
)  # fmt: skip
"""What parsers raise when a file's content is not what they expect."""

_END = "# end"
_ENDS = f"# The last line of this file is '{_END}'; without it, the file was cut short.\n"

_LOADER: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


class OverLimitError(ValueError):
    """An input asks for more than is allowed; it need not be damaged."""


class Allowance:
    """The number of bytes that may still be created from an input."""

    def __init__(self, floor: int, given: int, ratio: int) -> None:
        """floor: allowed for any input. given: the input's size; each of its bytes allows ratio more."""
        self.left = floor + ratio * given

    def take(self, count: int, what: str) -> None:
        """Use count bytes. Raises OverLimitError, before anything is created, if that is more than is left."""
        if count > self.left:
            raise OverLimitError(f"{what} asks for {count} bytes, where {self.left} are left for a file of its size")
        self.left -= count


def file_bytes(path: Path, most: int) -> bytes:
    """The content of a file of at most ``most`` bytes; of a pipe or device at most ``TEXT_BYTES``. Raises ValueError
    for a larger one, OSError."""
    with path.open("rb") as file:
        status = os.fstat(file.fileno())
        regular = stat.S_ISREG(status.st_mode)
        most = most if regular else min(most, TEXT_BYTES)
        if regular and status.st_size > most:
            raise ValueError(f"it has {status.st_size} bytes, at most {most} are read")
        content = file.read((status.st_size if regular else most) + 1)  # one more byte shows that it grows
    if len(content) > most:
        raise ValueError(f"it has more than {most} bytes, the most that are read")
    return content


def file_text(path: Path, most: int = TEXT_BYTES) -> str:
    """As ``file_bytes``, but text in UTF-8, without the mark that editors of Windows begin it with. Raises ValueError,
    OSError."""
    return file_bytes(path, most).decode("utf-8-sig")


def json_tree(text: str | bytes) -> Any:
    """The result of ``json.loads``. Raises ValueError, also if the text is nested too deeply."""
    try:
        return json.loads(text)
    except RecursionError as error:
        raise ValueError("it is nested too deeply") from error


def with_end(text: str) -> str:
    """The text of a YAML with a last line that shows whether it is whole: a part of a list is a valid list."""
    return f"{_ENDS}{text}{_END}\n"


def yaml_tree(text: str) -> Any:
    """The result of ``yaml.safe_load``. Raises ValueError, also for a tree of more than ``YAML_NODES``; an alias counts
    each time it is used; and for a text ``with_end`` that lacks it."""
    if text.startswith(_ENDS) and _END not in text.splitlines():
        raise ValueError(f"it is cut short: its last line, '{_END}', is missing")
    try:
        _check_yaml(text)
        return yaml.load(text, _LOADER)  # noqa: S506  # a safe one
    except yaml.YAMLError as error:
        raise ValueError(reason_of(error)) from error
    except ValueError:
        raise
    except DAMAGE as error:  # raised by constructors of YAML, e.g. a LookupError for "!!int ''"
        raise ValueError(f"it holds a value that is none ({type(error).__name__}: {error})") from error


def _line(event: Any) -> int:
    return int(event.start_mark.line) + 1


def _check_yaml(text: str) -> None:
    open_sizes: list[tuple[str | None, int]] = []
    sizes: dict[str, int] = {}
    total = 0
    events: Iterator[Any] = yaml.parse(text, Loader=_LOADER)
    for event in events:
        if isinstance(event, yaml.CollectionEndEvent):
            anchor, before = open_sizes.pop()
            if anchor is not None:
                sizes[anchor] = total - before
            continue
        if isinstance(event, yaml.AliasEvent):
            if event.anchor in sizes:
                total += sizes[event.anchor]
            elif any(anchor == event.anchor for anchor, _ in open_sizes):
                raise ValueError(f"line {_line(event)}: *{event.anchor} holds itself")
        elif isinstance(event, yaml.CollectionStartEvent):
            open_sizes.append((event.anchor, total))
            total += 1
        elif isinstance(event, yaml.ScalarEvent):
            total += 1
            if event.anchor is not None:
                sizes[event.anchor] = 1
            most = YAML_TEXT if event.implicit[1] else YAML_NUMBER
            if len(event.value) > most:
                raise ValueError(f"line {_line(event)}: a value has more than {most} characters")
        if total > YAML_NODES or len(open_sizes) > YAML_DEPTH:
            raise ValueError(f"line {_line(event)}: more than {YAML_NODES} values, or more than {YAML_DEPTH} deep")

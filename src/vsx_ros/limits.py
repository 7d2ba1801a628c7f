"""How much a file may ask for: what it declares is compared with a limit before memory is taken.

Every refusal is a ValueError whose text fits into its reader's sentence. Limits are far above what this stack's own
files and a building's recordings hold, and what may be unpacked grows with the file."""

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
LOG_BYTES = 1024 * MIB  # What grows with a run: trajectories, journals, lists of images
DATA_BYTES = 8192 * MIB  # Maps and point clouds
YAML_DEPTH, YAML_NODES = 64, 300_000  # several times what the largest file here has
YAML_TEXT, YAML_NUMBER = MIB, 8192
"""Characters of a value in quotes, and of one without, which may be a number (1:59:59, say, takes its square)."""

DAMAGE = (
    ArithmeticError, AssertionError, AttributeError, EOFError, LookupError, MemoryError, OSError, RuntimeError,
    SyntaxError, TypeError, ValueError, struct.error, zlib.error,
)  # fmt: skip
"""What parsers raise where a file's content is not what they expect."""

_LOADER: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


class Allowance:
    """The bytes that may still be made of an input."""

    def __init__(self, floor: int, given: int, ratio: int) -> None:
        """floor: for any input. given: its size; of each of these bytes, ratio more may be made."""
        self.left = floor + ratio * given

    def take(self, count: int, what: str) -> None:
        """Raises ValueError, before anything is made, where it is more than is left."""
        if count > self.left:
            raise ValueError(f"{what} asks for {count} bytes, where {self.left} are left for a file of its size")
        self.left -= count


def file_bytes(path: Path, most: int) -> bytes:
    """The content of a file of at most so many bytes; of a pipe or device at most ``TEXT_BYTES``. Raises ValueError for
    a larger one, OSError."""
    with path.open("rb") as file:
        status = os.fstat(file.fileno())
        regular = stat.S_ISREG(status.st_mode)
        most = most if regular else min(most, TEXT_BYTES)
        if regular and status.st_size > most:
            raise ValueError(f"it has {status.st_size} bytes, at most {most} are read")
        content = file.read((status.st_size if regular else most) + 1)  # one more would tell that it grows
    if len(content) > most:
        raise ValueError(f"it has more than {most} bytes, the most that are read")
    return content


def file_text(path: Path, most: int = TEXT_BYTES) -> str:
    """The same as text, UTF-8. Raises ValueError, OSError."""
    return file_bytes(path, most).decode("utf-8")


def json_tree(text: str | bytes) -> Any:
    """What ``json.loads`` makes of it. Raises ValueError, also where it is nested too deeply."""
    try:
        return json.loads(text)
    except RecursionError as error:
        raise ValueError("it is nested too deeply") from error


def yaml_tree(text: str) -> Any:
    """What ``yaml.safe_load`` makes of it, in which aliases count as often as they are used. Raises ValueError, also
    for more than a tree of ``YAML_NODES``."""
    try:
        _check_yaml(text)
        return yaml.load(text, _LOADER)  # noqa: S506  # a safe one
    except yaml.YAMLError as error:
        raise ValueError(reason_of(error)) from error
    except ValueError:
        raise
    except DAMAGE as error:  # what its constructors raise, e.g. a LookupError for "!!int ''"
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

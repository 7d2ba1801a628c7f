"""Files that are whole or not there: written beside their place, then renamed."""

from __future__ import annotations

import os
from pathlib import Path


def write_bytes(path: Path, content: bytes) -> None:
    """Replace the file in one step."""
    beside = path.with_name(f".{path.name}.part")
    beside.write_bytes(content)
    os.replace(beside, path)


def write_text(path: Path, content: str) -> None:
    """Replace the file in one step, UTF-8."""
    write_bytes(path, content.encode("utf-8"))

"""Files that are whole or not there: written beside their place, then renamed."""

import errno
import os
from contextlib import suppress
from pathlib import Path


def write_bytes(path: Path, content: bytes, *, durable: bool = False) -> None:
    """Replace the file in one step; a durable one outlives a power cut from then on. Raises OSError that names the
    path; what was there stays, and nothing is left beside it."""
    beside = path.with_name(f".{path.name}.part")
    try:
        with beside.open("wb") as file:
            file.write(content)
            if durable:
                file.flush()
                os.fsync(file.fileno())
        os.replace(beside, path)
        if durable:
            sync(path.parent)
    except OSError as error:
        with suppress(OSError):
            beside.unlink()
        raise OSError(error.errno, error.strerror, str(path)) from error


def write_text(path: Path, content: str, *, durable: bool = False) -> None:
    """The same with text, UTF-8."""
    write_bytes(path, content.encode("utf-8"), durable=durable)


def sync(path: Path) -> None:
    """Let a file as it is now, or the names in a folder, outlive a power cut from then on. Raises OSError."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    except OSError as error:
        if error.errno != errno.EINVAL:  # a file system without this for folders
            raise
    finally:
        os.close(descriptor)

"""Files that are either complete or absent: written under another name, then renamed."""

import errno
import os
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import BinaryIO

_TRIAL_BYTES = 1 << 15  # as a run begins: parameters and world


@contextmanager
def replacing(path: Path, *, durable: bool = False) -> Iterator[BinaryIO]:
    """An empty file to write and read; at the end it replaces the one at the path in one step. durable: it survives a
    power cut after that. Raises OSError with the path; then, and after any other error, the old file stays, and no
    temporary file. A device is never replaced."""
    beside = path.with_name(f".{path.name}.part")
    if path.exists() and not (path.is_file() or path.is_dir()):
        raise OSError(errno.EINVAL, "it is a device or a pipe, not a file", str(path))
    try:
        with beside.open("w+b") as file:
            yield file
            if durable:
                file.flush()
                os.fsync(file.fileno())
        os.replace(beside, path)
        if durable:
            sync(path.parent)
    except BaseException as error:
        with suppress(OSError):
            beside.unlink()
        if isinstance(error, OSError):
            raise OSError(error.errno, error.strerror, str(path)) from error
        raise


def write_together(contents: Mapping[Path, bytes], *, durable: bool = False) -> None:
    """The same with files of which the last one names the others. It is removed before these change, so that whenever
    this is interrupted, it is there with what it names, or absent. Raises OSError; all old files stay if the disk is
    full."""
    *_, index = contents
    with ExitStack() as stack:
        for path, content in reversed([*contents.items()]):  # renamed in the opposite order
            file = stack.enter_context(replacing(path, durable=durable))
            file.write(content)
            file.flush()
        index.unlink(missing_ok=True)


def write_bytes(path: Path, content: bytes, *, durable: bool = False) -> None:
    """The same with bytes that are known."""
    with replacing(path, durable=durable) as file:
        file.write(content)


def write_text(path: Path, content: str, *, durable: bool = False) -> None:
    """The same with text, UTF-8; of file names that are not UTF-8 the other bytes are written in words: \\udce9."""
    write_bytes(path, content.encode("utf-8", "backslashreplace"), durable=durable)


def sync(path: Path) -> None:
    """Write a file, or the names in a folder, to the disk, so that they survive a power cut. Raises OSError."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    except OSError as error:
        if error.errno != errno.EINVAL:  # the file system does not support it for folders
            raise
    finally:
        os.close(descriptor)


def try_to_make(folder: Path) -> None:
    """Write a file into a folder that exists or is to be made, and remove it again. Raises OSError."""
    wanted = folder.absolute()
    there = next(path for path in (wanted, *wanted.parents) if os.path.lexists(path))
    with TemporaryDirectory(prefix=".vsx", dir=there) as trial:
        Path(trial, "trial").write_bytes(bytes(_TRIAL_BYTES))

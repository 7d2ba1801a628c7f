"""The errors of vsx_ros. Expected outcomes (lost, refused, unreachable) are values, never exceptions.

Every message names the thing, the value found and the remedy."""

import difflib
import errno
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any, TypeAlias

_Causes: TypeAlias = type[Exception] | tuple[type[Exception], ...]
_LONGEST_MESSAGE, _LONGEST_REASON = 1200, 300  # an error may quote megabytes of a file

_DISK_REMEDIES = {
    errno.ENOSPC: "free some space ('df -h' shows where), or choose another disk",
    errno.EFBIG: "raise the limit on the size of a file ('ulimit -f'), or choose another disk",
    errno.EIO: "the disk fails: save what is on it, and choose another",
    errno.EDQUOT: "free some of your quota, or choose another disk",
    errno.EROFS: "choose a folder on a disk that may be written",
    errno.ENAMETOOLONG: "give a shorter one",
    errno.EACCES: "choose a folder of your own, or have its owner admit you",
    errno.EPERM: "choose a folder of your own, or have its owner admit you",
}


class VsxError(Exception):
    """Base class of all errors that vsx_ros raises on purpose; the command line prints it as one sentence."""

    def __init__(self, message: str = "") -> None:
        """A very long message, which quotes a file, is cut in its middle."""
        super().__init__(_cut(message))


class ConfigError(VsxError, ValueError):
    """A parameter, option or configuration file has an impossible value or an unknown name."""


class CalibrationError(VsxError, ValueError):
    """A calibration is missing, malformed or does not fit the images."""


class InputError(VsxError, ValueError):
    """A recording, image, message or trajectory cannot be used."""


class MapFileError(VsxError, ValueError):
    """A map file cannot be read or written."""


class PlanningError(VsxError, ValueError):
    """The planner's input makes no sense (NaN pose, phi <= 0)."""


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """The known word that resembles this one most, as a remark in brackets; empty if none does."""
    near = difflib.get_close_matches(word, list(known), 1)
    return f" (did you mean {near[0]!r}?)" if near else ""


def reason_of(error: Exception) -> str:
    """The reason of an error of a library or the operating system with a file, on one line. It includes the line in the
    file if YAML knows it, but no error number."""
    if isinstance(error, OSError):
        return error.strerror or str(error)
    mark: Any = getattr(error, "problem_mark", None)
    if mark is not None:
        return f"line {mark.line + 1}: {getattr(error, 'problem', '')}"[:_LONGEST_REASON]
    return next(iter(str(error).splitlines()), type(error).__name__)[:_LONGEST_REASON]


@contextmanager
def explained(kind: type[VsxError], what: str, remedy: str, causes: _Causes = (OSError, ValueError)) -> Iterator[None]:
    """Turns one of the causes raised inside, but no VsxError, into an error of this kind: what (why); remedy."""
    try:
        yield
    except VsxError:
        raise
    except causes as error:
        raise kind(f"{what} ({reason_of(error)}); {remedy}") from error


def disk_trouble(error: OSError) -> str:
    """The sentence for a full disk, a forbidden file or too long a name, wherever the error occurred; empty for a
    mistake of this program."""
    remedy = _DISK_REMEDIES.get(error.errno or 0, "")
    return _cut(f"{error.filename or 'a file'} cannot be used ({error.strerror}); {remedy}") if remedy else ""


def _cut(message: str) -> str:
    half = _LONGEST_MESSAGE // 2
    return message if len(message) <= 2 * half else f"{message[:half]} ... {message[-half:]}"

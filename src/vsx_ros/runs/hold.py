"""One run at a time in a run folder."""

import fcntl
import os
from contextlib import ExitStack
from pathlib import Path

from vsx_ros.errors import InputError, explained


def hold(folder: Path) -> ExitStack:
    """Refuse the folder to the runs of other processes until the result is closed or this process ends, however it
    ends; a file system without locks refuses nothing. Readers, and the nodes of the run, need no hold. Raises
    InputError if a run works in the folder."""
    with ExitStack() as stack:
        with explained(InputError, f"run folder {folder} cannot be opened", "choose another with --out", OSError):
            descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)  # no program that is started inherits it
        stack.callback(os.close, descriptor)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise InputError(f"a run still works in {folder}; end that first, or choose another with --out") from error
        except OSError:  # the file system has no locks
            pass
        return stack.pop_all()

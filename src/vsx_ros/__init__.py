"""vsx_ros: autonomous exploration of a building with one ordinary camera."""

import logging
import sys
from importlib import resources

if sys.version_info < (3, 10):  # noqa: UP036  # only pip compares versions
    raise ImportError(
        f"vsx_ros needs Python 3.10 or newer, and {sys.executable} is older; use a container (docs/how-to/install.md)"
    )

__version__ = resources.files(__name__).joinpath("version.txt").read_text(encoding="utf-8").strip()

logging.getLogger(__name__).addHandler(logging.NullHandler())

"""vsx_ros: autonomous exploration of a building with one ordinary camera."""

import logging
from importlib import resources

__version__ = resources.files(__name__).joinpath("version.txt").read_text(encoding="utf-8").strip()

logging.getLogger(__name__).addHandler(logging.NullHandler())

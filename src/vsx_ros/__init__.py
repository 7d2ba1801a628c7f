"""vsx_ros: autonomous exploration of a building with one ordinary camera."""

import logging
import os
import re
import sys
from importlib import resources

if sys.version_info < (3, 10):  # noqa: UP036  # only pip compares versions
    raise ImportError(
        f"vsx_ros needs Python 3.10 or newer, and {sys.executable} is older; use a container (docs/how-to/install.md)"
    )

__version__ = resources.files(__name__).joinpath("version.txt").read_text(encoding="utf-8").strip()

logging.getLogger(__name__).addHandler(logging.NullHandler())

MAX_PIXELS = 2**25  # no image is larger: twice that of a 16 megapixel camera
_OPENCV_LIMIT = "OPENCV_IO_MAX_IMAGE_PIXELS"  # it is read when cv2 is imported, which only modules below this do
_OPENCV_UNITS = {"": 1, "kb": 2**10, "mb": 2**20}


def _limit_opencv() -> None:
    """Let OpenCV decode no larger image, whatever a file says of its size. A user's lower limit stays. A cv2 that was
    imported before this package keeps its own; ``io.image_file`` checks each file without this one."""
    told = re.fullmatch(r"([0-9]{1,18})(|KB|Kb|kb|MB|Mb|mb)", os.environ.get(_OPENCV_LIMIT, ""))
    if told is None or int(told[1]) * _OPENCV_UNITS[told[2].lower()] > MAX_PIXELS:
        os.environ[_OPENCV_LIMIT] = str(MAX_PIXELS)


_limit_opencv()

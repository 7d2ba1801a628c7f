"""The versions that made a run, for its config.yaml."""

import platform
from contextlib import suppress
from importlib import metadata

from vsx_ros import __version__

_PACKAGES = ("numpy", "numba", "opencv-python-headless", "scipy", "daqp", "ruckig", "rosbags", "msgspec")


def installed_versions() -> dict[str, str]:
    """Versions of this package, Python and the computing packages."""
    versions = {"vsx_ros": __version__, "python": platform.python_version(), "machine": platform.machine()}
    versions |= dict.fromkeys(_PACKAGES, "not installed")
    for name in _PACKAGES:
        with suppress(metadata.PackageNotFoundError):
            versions[name] = metadata.version(name)
    return versions

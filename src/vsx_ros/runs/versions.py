"""The versions that made a run, for its config.yaml."""

import platform
from contextlib import suppress
from importlib import metadata
from pathlib import Path

from vsx_ros import __version__
from vsx_ros.limits import TEXT_BYTES, file_bytes

_PACKAGES = ("numpy", "numba", "opencv-python-headless", "scipy", "daqp", "ruckig", "rosbags", "msgspec")


def installed_versions() -> dict[str, str]:
    """Versions of this package, Python and the computing packages."""
    versions = {"vsx_ros": __version__, "python": platform.python_version(), "machine": platform.machine()}
    versions |= dict.fromkeys(_PACKAGES, "not installed")
    for name in _PACKAGES:
        with suppress(metadata.PackageNotFoundError):
            versions[name] = metadata.version(name)
    return versions


def is_of_a_run(config: Path) -> bool:
    """Whether a run wrote this config.yaml; the configuration of another program, or the user's own, has no versions in
    it."""
    with suppress(OSError, ValueError):
        names = {line.partition(b":")[0] for line in file_bytes(config, TEXT_BYTES).splitlines()}
        return {b"versions", b"config"} <= names
    return False

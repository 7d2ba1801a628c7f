"""The environment that ROS reads: where this package is, and under which name other machines find this one."""

import importlib.util
import os
import re
import socket
from pathlib import Path
from urllib.parse import urlparse

from vsx_ros.errors import ConfigError
from vsx_ros.runs.parameters import ros_home

MASTER_PORT = 11311  # roscore's default
DEFAULT_MASTER = f"http://localhost:{MASTER_PORT}"

# We run processes in parallel; threads inside libraries would only compete for the same cores.
THREADS = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"}


def host_address(master_uri: str) -> str:
    """This machine's address as seen from the master. 'localhost' if the master is local or has no address."""
    master = urlparse(master_uri)
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.connect((master.hostname or "localhost", master.port or MASTER_PORT))  # sends nothing
            address = str(probe.getsockname()[0])
    except (OSError, ValueError):
        return "localhost"
    return "localhost" if address.startswith("127.") else address


def export_ros_address() -> None:
    """Set ROS_IP or ROS_HOSTNAME for this process and its children, unless the user did. Reason: other machines often
    cannot resolve a machine's host name."""
    if os.environ.get("ROS_IP") or os.environ.get("ROS_HOSTNAME"):
        return
    address = host_address(os.environ.get("ROS_MASTER_URI", DEFAULT_MASTER))
    os.environ["ROS_HOSTNAME" if address == "localhost" else "ROS_IP"] = address


def path_of_url(url: str) -> str:
    """The file of a camera_info_url: a file:// URL or a path. ${ROS_HOME}, with ROS' default where it is not set, other
    variables and ~ are expanded."""
    path = re.sub(r"\$(\{ROS_HOME\}|ROS_HOME\b)", lambda _: str(ros_home()), url.removeprefix("file://"))
    return os.path.expanduser(os.path.expandvars(path))


def package_environment() -> None:
    """Let rospack and roslaunch find ``vsx_ros``. Raises ConfigError when the package manifest is missing, and
    ModuleNotFoundError without ROS."""
    if importlib.util.find_spec("rospy") is None:
        raise ModuleNotFoundError("No module named 'rospy'", name="rospy")
    export_ros_address()
    checkout = Path(__file__).resolve().parents[3]
    if not (checkout / "package.xml").exists():
        raise ConfigError(f"no package.xml in {checkout}: the live run needs a checkout; use --fast without one")
    others = os.environ.get("ROS_PACKAGE_PATH", "/usr/share")
    if str(checkout) not in others.split(":"):
        os.environ["ROS_PACKAGE_PATH"] = f"{checkout}:{others}"

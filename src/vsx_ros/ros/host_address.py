"""The name under which other machines find the nodes of this machine."""

import os
import socket
from urllib.parse import urlparse

MASTER_PORT = 11311  # roscore's default
DEFAULT_MASTER = f"http://localhost:{MASTER_PORT}"


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

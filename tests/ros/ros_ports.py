"""Ports that nobody uses."""

from __future__ import annotations

import socket

HOST = "localhost"


def free_port() -> int:
    """A TCP port of this machine that is free now."""
    with socket.socket() as probe:
        probe.bind((HOST, 0))
        return int(probe.getsockname()[1])

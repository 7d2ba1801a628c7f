"""Ports that nobody uses."""

import contextlib
import random
import socket


def free_port() -> int:
    """A TCP port of this machine that is free now, and below those that the kernel gives away by itself: a client that
    knocks at one of those while nobody listens may be given it, and connect to itself."""
    for port in random.sample(range(20_000, 32_000), 100):
        with socket.socket() as probe, contextlib.suppress(OSError):
            probe.bind(("localhost", port))
            return port
    raise OSError("no port is free")

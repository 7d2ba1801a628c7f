"""Ports that nobody uses."""

from free_ports import free_port

__all__ = ["HOST", "free_port"]

HOST = "localhost"

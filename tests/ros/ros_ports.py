"""Ports that nobody uses."""

from __future__ import annotations

from free_ports import free_port

__all__ = ["HOST", "free_port"]

HOST = "localhost"

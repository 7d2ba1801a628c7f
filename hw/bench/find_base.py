"""find_base.py PORT: you should see the kind of base and its baud rate within three seconds. No wheel turns."""

import sys

from vsx_hw.bases import BASES, detect_base


def find_base(port: str) -> str:
    """Find out the kind of base at a port, and say it."""
    kind = detect_base(port)
    print(f"{port}: {kind} at {BASES[kind].baud} baud", flush=True)
    return kind


if __name__ == "__main__":
    find_base(sys.argv[1])

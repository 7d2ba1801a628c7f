"""What the exit code of every command means."""

DONE = 0
"""The job is done."""
FAILED = 1
"""Wrong usage, unusable input or a failed check."""
HARDWARE = 2
"""A device is missing or misbehaves."""
LOST = 3
"""Tracking was lost for good."""
STOPPED = 4
"""The operator stopped it."""
INTERNAL = 5
"""A mistake in this program."""


def ended_well(code: int) -> bool:
    """Whether a run that ended with this code went as it should."""
    return code in (DONE, STOPPED)

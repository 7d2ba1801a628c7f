"""Trajectories in the format of the TUM RGB-D benchmark: ``stamp tx ty tz qx qy qz qw``, seconds and metres."""

import io
import math
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from vsx_ros.errors import InputError, explained
from vsx_ros.geometry.se3 import SE3, StampedPose
from vsx_ros.io.atomic import write_text
from vsx_ros.limits import LOG_BYTES, file_text

HEADER = "# stamp tx ty tz qx qy qz qw\n"
FARTHEST_M = 1e7
"""Larger than any trajectory on Earth; squares of such numbers are still safe in linear algebra."""


def format_stamp(stamp_ns: int) -> str:
    """Seconds with nine decimals, exactly; the inverse of ``parse_stamp``."""
    sign = "-" if stamp_ns < 0 else ""
    seconds, rest = divmod(abs(stamp_ns), 1_000_000_000)
    return f"{sign}{seconds}.{rest:09d}"


def parse_stamp(text: str) -> int:
    """Nanoseconds of a decimal number of seconds, without rounding through a float. Raises ValueError when the text is
    no number, or does not fit 64 bits."""
    whole, _, fraction = text.strip().partition(".")
    if fraction.isdigit() and whole.lstrip("-").isdigit():
        stamp_ns = int(whole.lstrip("-")) * 1_000_000_000 + int(fraction[:9].ljust(9, "0"))
        stamp_ns = -stamp_ns if whole.startswith("-") else stamp_ns
    else:
        stamp_ns = round(float(text) * 1e9)
    if abs(stamp_ns) >= 2**63:
        raise ValueError(f"stamp {text[:40]} lies outside of time")
    return stamp_ns


def write_trajectory(path: Path, poses: Iterable[StampedPose]) -> None:
    """Write poses with nine decimals, so that equal runs give equal bytes."""
    lines = [HEADER]
    for pose in poses:
        numbers = (*pose.T.translation, *pose.T.quaternion())
        # adding 0.0 turns -0.0 into 0.0; its sign would be a meaningless difference
        lines.append(" ".join([format_stamp(pose.stamp_ns), *(f"{float(n) + 0.0:.9f}" for n in numbers)]) + "\n")
    write_text(path, "".join(lines))


def read_trajectory(path: Path) -> list[StampedPose]:
    """All poses of a file, in its order. Raises InputError with file and line when a line is not a stamp, a position
    within FARTHEST_M and a unit quaternion."""
    with explained(InputError, f"trajectory {path} cannot be read", "give a text file in TUM format"):
        text = file_text(path, LOG_BYTES)
    poses = []
    for number, line in enumerate(io.StringIO(text), start=1):
        if line.strip() and not line.lstrip().startswith("#"):
            poses.append(_pose_of(line, f"trajectory {path}, line {number}"))
    return poses


def _pose_of(line: str, where: str) -> StampedPose:
    fields = line.replace(",", " ").split()
    try:
        stamp_ns = parse_stamp(fields[0])
        x, y, z, qx, qy, qz, qw = (float(field) for field in fields[1:])
    except (ValueError, OverflowError) as error:
        expected = "expected 'stamp tx ty tz qx qy qz qw' in seconds and metres"
        raise InputError(f"{where}: {expected}, got {line.strip()[:80]!r}") from error
    quaternion = (qx, qy, qz, qw)
    norm = math.sqrt(sum(q * q for q in quaternion))
    if not (all(abs(v) <= FARTHEST_M for v in (x, y, z)) and abs(norm - 1.0) < 0.05):
        raise InputError(
            f"{where}: positions must be within {FARTHEST_M:g} m and the quaternion of length 1, "
            f"got {line.strip()[:80]!r}"
        )
    return StampedPose(stamp_ns, SE3.from_quaternion(np.array([x, y, z]), quaternion))

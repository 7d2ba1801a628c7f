"""Point clouds as binary PLY, which MeshLab, CloudCompare and Blender read."""

from pathlib import Path

import numpy as np

from vsx_ros.arrays import Points3
from vsx_ros.errors import InputError, explained
from vsx_ros.io.atomic import write_bytes
from vsx_ros.limits import DATA_BYTES, file_bytes

_HEADER = "ply\nformat binary_little_endian 1.0\nelement vertex {count}\n{properties}end_header\n"
_PROPERTIES = "".join(f"property float {axis}\n" for axis in "xyz")


def write_ply(path: Path, points: Points3) -> None:
    """(N, 3) points [m], stored as 32-bit floats."""
    vertices = np.asarray(points, np.float64).reshape(-1, 3).astype("<f4")
    header = _HEADER.format(count=len(vertices), properties=_PROPERTIES)
    write_bytes(path, header.encode("ascii") + vertices.tobytes())


def read_ply(path: Path) -> Points3:
    """The (N, 3) points of a file that ``write_ply`` wrote. Raises InputError for anything else."""
    with explained(InputError, f"point cloud {path} cannot be read", "check the path"):
        header, _, body = file_bytes(path, DATA_BYTES).partition(b"end_header\n")
    wrong = f"point cloud {path} is not a PLY that this program wrote"
    with explained(InputError, wrong, "give one that it wrote", (IndexError, ValueError)):
        count = int(header.split(b"element vertex")[1].split()[0])
        expected = _HEADER.format(count=count, properties=_PROPERTIES).encode("ascii")
        if header + b"end_header\n" != expected:
            raise ValueError("other properties")
        if len(body) != 12 * count:
            raise ValueError(f"{len(body)} bytes are not {count} points")
        return np.frombuffer(body, "<f4").reshape(-1, 3).astype(np.float64)

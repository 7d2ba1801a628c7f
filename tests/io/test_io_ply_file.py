import numpy as np
import pytest

from vsx_ros.errors import InputError
from vsx_ros.io.map_export import read_ply, write_ply


@pytest.mark.parametrize("count", [0, 1, 1000])
def test_points_survive_as_floats(tmp_path, count):
    points = np.random.default_rng(count).normal(0, 5, (count, 3))
    write_ply(tmp_path / "p.ply", points)
    assert np.array_equal(read_ply(tmp_path / "p.ply"), points.astype(np.float32).astype(float).reshape(-1, 3))


def test_grey_points_are_coloured(tmp_path):
    points, grey = np.arange(12.0).reshape(4, 3), np.array([0, 50, 128, 255], np.uint8)
    write_ply(tmp_path / "p.ply", points, grey)
    assert np.array_equal(read_ply(tmp_path / "p.ply"), points)
    header, _, body = (tmp_path / "p.ply").read_bytes().partition(b"end_header\n")
    assert b"property uchar red\nproperty uchar green\nproperty uchar blue\n" in header
    assert body[15 + 12 : 15 + 15] == bytes([50, 50, 50])


def test_the_header_is_a_ply_header(tmp_path):
    write_ply(tmp_path / "p.ply", np.zeros((2, 3)))
    header, _, body = (tmp_path / "p.ply").read_bytes().partition(b"end_header\n")
    assert header.startswith(b"ply\nformat binary_little_endian 1.0\nelement vertex 2\nproperty float x\n")
    assert len(body) == 2 * 3 * 4


@pytest.mark.parametrize("content", [b"", b"ply\nformat ascii 1.0\nelement vertex 1\nend_header\n1 2 3"])
def test_other_files_are_refused(tmp_path, content):
    (tmp_path / "p.ply").write_bytes(content)
    with pytest.raises(InputError, match=r"p\.ply"):
        read_ply(tmp_path / "p.ply")


def test_a_short_file_is_refused(tmp_path):
    write_ply(tmp_path / "p.ply", np.ones((5, 3)))
    whole = (tmp_path / "p.ply").read_bytes()
    (tmp_path / "p.ply").write_bytes(whole[:-3])
    with pytest.raises(InputError, match="not a PLY"):
        read_ply(tmp_path / "p.ply")

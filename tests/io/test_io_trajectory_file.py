import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vsx_ros.errors import InputError
from vsx_ros.geometry.se3 import SE3, StampedPose
from vsx_ros.io.trajectory_file import format_stamp, parse_stamp, read_trajectory, write_trajectory


@given(st.integers(-(10**18), 2**62))
def test_stamps_survive_exactly(stamp_ns):
    assert parse_stamp(format_stamp(stamp_ns)) == stamp_ns


@pytest.mark.parametrize(
    ("text", "stamp_ns"),
    [
        ("1403715273.262143", 1403715273262143000),
        ("0.5", 500000000),
        ("7", 7 * 10**9),
        ("1e-3", 10**6),
        ("-0.1", -(10**8)),
    ],
)
def test_stamps_as_people_write_them(text, stamp_ns):
    assert parse_stamp(text) == stamp_ns


def test_poses_survive_and_bytes_repeat(tmp_path):
    rng = np.random.default_rng(3)
    poses = [StampedPose(10**18 + i, SE3.exp(rng.normal(0, 1, 6))) for i in range(20)]
    write_trajectory(tmp_path / "a.txt", poses)
    read = read_trajectory(tmp_path / "a.txt")
    write_trajectory(tmp_path / "b.txt", poses)
    assert (tmp_path / "a.txt").read_bytes() == (tmp_path / "b.txt").read_bytes()
    for before, after in zip(poses, read, strict=True):
        assert before.stamp_ns == after.stamp_ns
        assert np.allclose(before.T.matrix(), after.T.matrix(), atol=5e-9)


def test_minus_zero_is_written_as_zero(tmp_path):
    write_trajectory(tmp_path / "z.txt", [StampedPose(0, SE3(np.eye(3), np.array([-0.0, 0.0, 0.0])))])
    assert "-" not in (tmp_path / "z.txt").read_text()


@pytest.mark.parametrize(
    "line",
    [
        "1 2 3", "1 0 0 0 0 0 0 0", "1 0 0 nan 0 0 0 1", "1 0 nan 0 0 0 0 1", "1 0 0 0 0 0 0 5", "x 0 0 0 0 0 0 1",
        "1 0 0 0 0 0 0 1 9", "1 0 -1e290 0 0 0 0 1", "1 inf 0 0 0 0 0 1",
    ],
)  # fmt: skip
def test_wrong_lines_are_named(tmp_path, line):
    (tmp_path / "t.txt").write_text("# header\n" + line + "\n")
    with pytest.raises(InputError, match="line 2"):
        read_trajectory(tmp_path / "t.txt")


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(InputError, match=r"absent\.txt"):
        read_trajectory(tmp_path / "absent.txt")

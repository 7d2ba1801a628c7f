"""A journal tells what happened up to the last moment, whatever the disk or the end of the program did to it."""

import errno
import os
import resource
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest

from vsx_ros.errors import InputError
from vsx_ros.geometry.se3 import SE3
from vsx_ros.runs.journal import FrameLine, Journal, RunEvent, read_journal, unflat
from vsx_ros.slam.anchor import Anchor
from vsx_ros.slam.state import TrackingResult, TrackingState

LINES = [RunEvent(stamp_ns=i, source="mission", state="mapping", reason="x" * 100) for i in range(5)]


@contextmanager
def files_no_longer_than(size: int) -> Iterator[None]:
    """As on a disk that is nearly full: what still fits is written."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def test_lines_are_read_back_and_gone_on_with(tmp_path: Path) -> None:
    path = tmp_path / "resume" / "journal.jsonl"
    assert read_journal(path) == []
    Journal(path).add(*LINES[:2])
    Journal(path, LINES[:2]).add(LINES[2])
    assert read_journal(path) == LINES[:3]


def test_a_frame_is_read_back_with_what_carries_its_pose(tmp_path: Path) -> None:
    path, T = tmp_path / "journal.jsonl", SE3.exp(np.array([0.1, 0.2, 0.3, 0.4, -0.5, 0.6]))
    told = TrackingResult(7, TrackingState.GOOD, T, 9, 8, False, "", T_map_cam=T, anchor=Anchor(3, T.inverse(), 0.5))
    lost = TrackingResult(8, TrackingState.LOST, None, 9, 0, False, "dark")
    Journal(path).add(*(FrameLine.of(result, None, 1.0, None) for result in (told, lost)))
    first, second = (line for line in read_journal(path) if isinstance(line, FrameLine))
    assert first.anchor is not None
    keyframe, T_keyframe_this, scale = first.anchor
    assert (keyframe, scale, second.anchor) == (3, 0.5, None)
    assert np.allclose(unflat(T_keyframe_this).matrix(), T.inverse().matrix(), atol=1e-12)
    path.write_text(path.read_text().replace("[3,[", "[-3,["))
    with pytest.raises(InputError, match="is damaged"):
        read_journal(path)


def test_half_a_line_on_a_full_disk_is_taken_back_and_told(tmp_path: Path) -> None:
    path = tmp_path / "journal.jsonl"
    journal = Journal(path)
    journal.add(LINES[0])
    size = path.stat().st_size
    with files_no_longer_than(2 * size + size // 2), pytest.raises(InputError, match="cannot be written"):
        journal.add(*LINES[1:3])
    assert path.stat().st_size == size
    journal.add(LINES[3])  # once there is room again
    assert read_journal(path) == [LINES[0], LINES[3]]


def test_half_a_line_that_the_disk_kept_is_taken_back_when_it_takes_lines_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "journal.jsonl"
    journal = Journal(path)
    journal.add(LINES[0])
    size = path.stat().st_size
    with monkeypatch.context() as read_only, files_no_longer_than(2 * size + size // 2):
        read_only.setattr(os, "ftruncate", Mock(side_effect=OSError(errno.EROFS, "Read-only file system")))
        with pytest.raises(InputError, match="cannot be written"):
            journal.add(*LINES[1:3])
    assert path.stat().st_size > 2 * size
    journal.add(LINES[3])
    assert read_journal(path) == [LINES[0], LINES[3]]


def test_a_last_line_that_was_cut_off_is_left_out_and_any_other_damage_told(tmp_path: Path) -> None:
    path = tmp_path / "journal.jsonl"
    Journal(path).add(*LINES)
    content = path.read_bytes()
    path.write_bytes(content[:-30])
    assert read_journal(path) == LINES[:4]
    path.write_bytes(content[30:])
    with pytest.raises(InputError, match="is damaged"):
        read_journal(path)

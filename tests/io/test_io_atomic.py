"""Files that are whole or not there, on the system's own full disk."""

import errno
import os
from pathlib import Path

import pytest

from vsx_ros.cli import main
from vsx_ros.io.atomic import write_bytes

FULL = Path("/dev/full")


def test_a_failed_write_leaves_what_was_there_and_nothing_beside_it(tmp_path):
    file = tmp_path / "map"
    write_bytes(file, b"before")
    (tmp_path / ".map.part").symlink_to(FULL)
    with pytest.raises(OSError) as caught:
        write_bytes(file, b"after")
    assert (caught.value.errno, caught.value.filename) == (errno.ENOSPC, str(file))
    assert file.read_bytes() == b"before"
    assert list(tmp_path.iterdir()) == [file]


def test_a_durable_file_and_its_name_are_brought_to_the_disk(tmp_path, monkeypatch):
    brought: list[tuple[str, list[str]]] = []
    sync = os.fsync

    def watched(descriptor):
        there = sorted(path.name for path in tmp_path.iterdir())
        brought.append((Path(f"/proc/self/fd/{descriptor}").readlink().name, there))
        sync(descriptor)

    monkeypatch.setattr(os, "fsync", watched)
    write_bytes(tmp_path / "map", b"map", durable=True)
    assert brought == [(".map.part", [".map.part"]), (tmp_path.name, ["map"])]


def test_a_command_on_a_full_disk_says_so(tmp_path, capsys):
    run = tmp_path / "run"
    run.mkdir()
    (run / "summary.json").write_text("{}", encoding="utf-8")
    (run / ".config.yaml.part").symlink_to(FULL)
    assert main.execute(["explore", "--fast", "--time", "1", "--out", str(run)]) == 1
    assert "config.yaml cannot be used (No space left on device); free some space" in capsys.readouterr().err

"""The set-up script says what it does, and what to do where it may not."""

import shutil
import subprocess
from pathlib import Path

import pytest
from waiting import PATIENCE_S

CHECKOUT = Path(__file__).resolve().parents[2]
APT = """\
Reading package lists...
dlstatus:1:0:Retrieving file 1 of 2
dlstatus:2:50.5:Retrieving file 2 of 2
pmstatus:dpkg-exec:0:Running dpkg
Unpacking sl (5.02-1) ...
pmstatus:sl:33.3:Unpacking sl (amd64)
pmstatus:sl:50:Installed sl (amd64)
pmstatus:cowsay:100:Installed cowsay (all)
"""
PIP = """\
Collecting numpy==2.4.6 (from -r requirements.txt (line 2))
  Downloading numpy-2.4.6-cp311.whl
Collecting llvmlite<0.50 (from numba==0.68.1)
Installing collected packages: numpy, llvmlite, numba
Successfully installed llvmlite-0.49 numba-0.68.1 numpy-2.4.6
"""


def shell(code: str, said: str = "", **variables: str) -> subprocess.CompletedProcess[str]:
    bash = shutil.which("bash")
    assert bash is not None
    command = [bash, "-euo", "pipefail", "-c", f'. "{CHECKOUT}/scripts/setup.sh"; {code}']
    return subprocess.run(
        command, input=said, env=variables or None, capture_output=True, text=True, timeout=PATIENCE_S, check=False
    )


def test_packages_of_apt_are_counted() -> None:
    told = shell("vsx_apt_words 2", APT).stdout.splitlines()
    assert told == [
        "file 1 of 2 fetched", "file 2 of 2 fetched", "1 of 2 packages installed", "2 of 2 packages installed"
    ]  # fmt: skip


def test_packages_of_pip_are_counted(tmp_path: Path) -> None:
    (tmp_path / "pip-26.dist-info").mkdir()
    told = shell(f"vsx_pip_words 15 {tmp_path}", PIP).stdout.splitlines()
    assert told == [
        "1 of 15 or more packages fetched",
        "2 of 15 or more packages fetched",
        "0 of 3 packages installed",
        "3 of 3 packages installed",
    ]


def test_the_newest_count_stays_with_its_seconds() -> None:
    done = shell("vsx_count apt", "1 of 2\n2 of 2\n")
    assert done.returncode == 0
    assert done.stderr == "[setup] apt: 2 of 2, 0 s\n"


def test_a_failure_before_a_count_is_a_failure() -> None:
    assert shell("{ echo 1 of 2; exit 7; } | vsx_count apt").returncode == 7


@pytest.mark.skipif(shutil.which("dpkg-query") is None, reason="needs a system with dpkg")
def test_without_root_and_sudo_all_that_is_to_be_typed_is_said(tmp_path: Path) -> None:
    for name in ("sed", "grep", "uname", "dirname", "readlink"):
        (tmp_path / name).symlink_to(str(shutil.which(name)))
    for name, code in {"id": "echo 1000", "dpkg-query": "exit 0"}.items():
        (tmp_path / name).write_text(f"#!/bin/sh\n{code}\n")
        (tmp_path / name).chmod(0o755)
    done = shell(f"root={CHECKOUT}; vsx_system_packages", PATH=str(tmp_path))
    assert done.returncode == 1
    assert "As root, run: apt-get update && apt-get install --no-install-recommends python3-venv " in done.stderr
    assert done.stderr.endswith("; then run this again\n")

"""Source distribution and wheel: the one builds from the other, and works from a folder with nothing else in it."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from waiting import PATIENCE_S

CHECKOUT = Path(__file__).resolve().parents[2]
SOURCES = "src", "hw", "setup.py", "pyproject.toml", "README.md", "LICENSE"


def python(*arguments: str, cwd: Path, path: str = "") -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "PYTHONPATH": path}
    command = [sys.executable, *arguments]
    return subprocess.run(
        command, cwd=cwd, env=environment, capture_output=True, text=True, timeout=PATIENCE_S, check=False
    )


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the wheel, built from the source distribution, is installed without what it depends on."""
    folder = tmp_path_factory.mktemp("wheel")
    source, dist = folder / "source", folder / "dist"
    source.mkdir()
    for name in SOURCES:
        copy = shutil.copytree if (CHECKOUT / name).is_dir() else shutil.copy
        copy(CHECKOUT / name, source / name)
    pip = "-m", "pip", "-q", "--disable-pip-version-check"
    steps = [
        ("setup.py", "-q", "sdist", "-d", str(dist)),
        (*pip, "wheel", "--no-deps", "--no-build-isolation", "-w", str(dist), "--no-index", "-f", str(dist), "vsx_ros"),
        (*pip, "install", "--no-deps", "--no-index", "-f", str(dist), "--target", str(folder / "site"), "vsx_ros"),
    ]
    for step in steps:
        done = python(*step, cwd=source)
        assert done.returncode == 0, done.stderr
    assert len(list(dist.glob("*.whl"))) == len(list(dist.glob("*.tar.gz"))) == 1
    return folder / "site"


def test_the_command_of_the_wheel_is_the_wheels(site: Path, tmp_path: Path) -> None:
    said = python(str(site / "bin/vsx"), "config", cwd=tmp_path, path=str(site))
    assert said.stdout == (CHECKOUT / "config/default.yaml").read_text(encoding="utf-8"), said.stderr
    where = python(
        "-c", "import vsx_ros, vsx_hw; print(vsx_ros.__file__, vsx_hw.__file__)", cwd=tmp_path, path=str(site)
    )
    assert where.stdout.count(str(site)) == 2


PAGE, NOT_MODULES = "ros/dashboard/page", ("ros/python_logging.conf", "evaluation/scrubber.html")


@pytest.mark.parametrize("file", [f"{PAGE}/index.html", f"{PAGE}/map.js", *NOT_MODULES])
def test_it_brings_the_files_that_are_no_modules(site: Path, file: str) -> None:
    assert (site / "vsx_ros" / file).read_bytes() == (CHECKOUT / "src/vsx_ros" / file).read_bytes()


def test_a_live_run_says_that_it_needs_a_checkout(site: Path, tmp_path: Path) -> None:
    pytest.importorskip("rospy")
    said = python("-m", "vsx_ros.cli.main", "explore", "--world", "lab", cwd=tmp_path, path=str(site))
    assert said.returncode == 1
    assert "needs a checkout" in said.stderr

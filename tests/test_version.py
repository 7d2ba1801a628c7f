"""One version, wherever it is told."""

import re
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import vsx_ros

CHECKOUT = Path(__file__).resolve().parents[1]


def test_all_say_the_same_version():
    assert re.fullmatch(r"\d+\.\d+\.\d+", vsx_ros.__version__)
    package = ElementTree.parse(CHECKOUT / "package.xml").findtext("version")
    assert package == vsx_ros.__version__
    named = subprocess.run(
        [sys.executable, "setup.py", "--name", "--version"], cwd=CHECKOUT, capture_output=True, text=True, check=True
    )
    assert named.stdout.split()[-2:] == ["vsx_ros", vsx_ros.__version__]


def test_the_changelog_knows_the_version():
    headings = re.findall(r"^## \[(.+?)\]", (CHECKOUT / "CHANGELOG.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert vsx_ros.__version__ in headings
    assert len(set(headings)) == len(headings)

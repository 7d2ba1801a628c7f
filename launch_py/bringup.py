#!/usr/bin/env python3
"""The robot itself: base and camera. --help lists the options."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "scripts"))

import boot

boot.into("vsx_ros.cli.launching")

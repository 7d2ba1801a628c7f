"""A bag of a drive. The samples and damages of benchmarks/fuzz_files.py are used here, too."""

import sys
from pathlib import Path

import pytest
from ros1_bags import write_drive

sys.path.append(str(Path(__file__).resolve().parents[2] / "benchmarks"))


@pytest.fixture
def drive(tmp_path):
    return write_drive(tmp_path / "drive.bag")

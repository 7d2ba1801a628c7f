"""The samples and damages of benchmarks/fuzz_files.py are used here, too."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[2] / "benchmarks"))

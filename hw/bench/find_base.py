"""find_base.py PORT: you should see the kind of base and its baud rate within three seconds. No wheel turns."""

import sys

from bench_base import BenchBase

BenchBase(sys.argv[1])
